"""Both engines index no array outside its bounds, whatever is combined."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.both_engines.small_campaigns import CAMPAIGNS

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_no_index_is_out_of_bounds(root, tmp_path, name):
    command = [sys.executable, "-m", "tests.both_engines.small_campaigns", str(tmp_path), name]
    environment = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "PYTHONPATH": str(root)}
    found = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    assert (found.returncode, found.stdout) == (0, f"{name}\n"), found.stderr[-3000:]
