"""Import of matplotlib without the backend that MPLBACKEND selects: figures of this package need none."""

import os
import sys

try:
    import matplotlib as mpl
except ValueError:  # a notebook sets MPLBACKEND for all its child processes, where that backend may be missing
    del os.environ["MPLBACKEND"]
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:  # partly imported
        del sys.modules[name]
    import matplotlib as mpl

__all__ = ["mpl"]
