"""Help does not wait for the compiler, the tables or the figures: none of them is loaded, and little else."""

from __future__ import annotations

import subprocess
import sys

HEAVY = ("jinja2", "matplotlib", "numba", "numpy", "pandas", "pyarrow", "pydantic", "ruamel", "scipy")
ASK = """\
import sys
from lvnav_trade.cli import main
try:
    main()
finally:
    print(*sys.modules, file=sys.stderr)
"""


def test_help_loads_no_heavy_library_and_few_modules(root, record_property):
    answer = subprocess.run([sys.executable, "-c", ASK, "--help"], cwd=root, capture_output=True, text=True, check=True)
    loaded = answer.stderr.split()
    record_property("modules loaded for the console's help", len(loaded))
    assert "run" in answer.stdout.split()
    assert "lvnav_trade.cli" in loaded
    assert [name for name in HEAVY if name in loaded] == []
    assert len(loaded) < 400
