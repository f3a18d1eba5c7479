"""matplotlib, imported where MPLBACKEND names a backend that is not installed: figures here need none."""

import os
import sys

try:
    import matplotlib as mpl
except ValueError:  # a notebook sets the variable for every command that it starts, in other installations too
    del os.environ["MPLBACKEND"]
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:  # half imported
        del sys.modules[name]
    import matplotlib as mpl

__all__ = ["mpl"]
