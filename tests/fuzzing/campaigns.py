"""Mutants of a campaign, checked as `check` does: flights and effects of settings too."""

from __future__ import annotations

import random
from pathlib import Path

from lvnav_trade import api
from tests.fuzzing.mutants import Outcome, mutated, outcome_of

CAMPAIGN = """\
name: mutant
seed: 7
base:
  trajectory: trajectories/two_stage_leo
  imu:
    card: imu/tactical_fog
    gyro: {bias_repeatability: "0.5 deg/h", random_walk: "0.02 deg/sqrt(h)", scale_factor: "100 ppm"}
    accel: {bias_repeatability: "300 ug", random_walk: "30 ug/sqrt(Hz)", scale_factor: "150 ppm"}
    rate: "100 Hz"
  constellation: constellations/gps_24
  receiver: {card: receivers/l1_two_metre, pseudorange_sigma: "2 m", range_rate_sigma: "0.05 m/s"}
  filter: {card: filters/tight, gate: 5}
  initial: {tilt: "0.1 deg", heading: "0.05 deg", position: "1 m", velocity: "0.01 m/s"}
  faults:
    - {kind: satellite_outage, start: "stage1_cutoff + 20 s", duration: "30 s", keep: 2}
axes:
  - {path: initial.tilt, values: ["0.1 deg", "0.2 deg"]}
design: grid
monte_carlo: {runs: 8}
keep: {history: "5 s"}
requirements:
  - {name: speed, metric: velocity_error_3d, at: injection, probability: 0.95, below: "0.3 m/s"}
"""


def try_one(seed: int, folder: Path) -> Outcome:
    """Make the mutant of a seed and check it."""
    text, change = mutated(CAMPAIGN, random.Random(f"campaign {seed}"))
    path = folder / "campaign.yaml"
    path.write_text(text, encoding="utf-8", errors="replace", newline="")
    return outcome_of(lambda: api.check(path), change)
