"""A failure of the inertial unit that persists is none of satellites: all stay in use, and the error stays small."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

import pytest

from lvnav_trade.quantities.records import OF_CHANNEL, OF_CLOCK, OF_INERTIAL

ROOT = Path(__file__).parents[4]
UNIT, SEEDS = ("vertical acceleration", "rate"), (1, 2)
POOR = (1, 6)  # geometries of four satellites that dilute the precision by 239 and 24
CASES = [
    *((name, count, seed, True) for name in UNIT for count in (4, 6) for seed in SEEDS),
    *((name, 7, 1, False) for name in UNIT),
    *((name, 9, seed, True) for name in ("satellite", "clock", "none") for seed in SEEDS),
    *((name, 4, seed, True) for name in ("clock", "none") for seed in POOR),
]


@lru_cache(maxsize=1)
def all_flights():
    """Fly every case in ordinary Python, where the kernels need not be compiled."""
    found = subprocess.run(
        [sys.executable, "-m", "tests.filter.policies.integrity.dense", json.dumps(CASES)],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)},
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return dict(zip(CASES, json.loads(found.stdout), strict=True))


@pytest.mark.parametrize("count", [4, 6])
@pytest.mark.parametrize("name", UNIT)
def test_a_unit_that_stays_wrong_has_no_satellite_excluded_for_long(name, count):
    for seed in SEEDS:
        found, without = all_flights()[name, count, seed, True], all_flights()[name, 7, 1, False]
        assert found["kinds"].count(OF_INERTIAL) >= 3, found
        assert OF_CLOCK not in found["kinds"], found
        assert found["kinds"].count(OF_CHANNEL) <= (0 if count > 4 else 3), found
        assert found["largest"] < 40.0 < 2.0 * without["largest"], (found, without)
        if count > 4:
            assert found["used"] == count, found
            assert found["largest"] < 10.0, found


@pytest.mark.parametrize(("name", "kind"), [("satellite", OF_CHANNEL), ("clock", OF_CLOCK), ("none", 0)])
def test_failures_of_the_receiver_remain_what_they_are(name, kind):
    for seed in SEEDS:
        found = all_flights()[name, 9, seed, True]
        assert set(found["kinds"]) <= {kind}, found
        assert (found["first"] == 50) == (kind != 0), found
        assert found["named"] == ([1] if name == "satellite" else []), found
        assert found["largest"] < 5.0, found


@pytest.mark.parametrize("seed", POOR)
def test_ranges_of_four_satellites_that_jump_alone_have_jumped_with_the_clock(seed):
    """Four fit exactly, so a poor geometry takes a jump for one of position; but range rates have seen no motion."""
    found, without = all_flights()["clock", 4, seed, True], all_flights()["none", 4, seed, True]
    assert found["kinds"] == [OF_CLOCK], found
    assert found["used"] == 4, found
    assert abs(found["largest"] - without["largest"]) < 1.0, (found, without)
