"""A small campaign of many designs."""

from __future__ import annotations

from pathlib import Path

import pytest

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load

TEXT = """
name: many
seed: 3
base:
  trajectory: trajectories/two_stage_leo
  imu: imu/tactical_fog
  constellation: constellations/gps_24
  receiver: receivers/l1_two_metre
  filter: filters/tight
  initial: {tilt: "0.1 deg", heading: "0.05 deg", position: "1 m", velocity: "0.01 m/s"}
axes:
  - {path: imu.gyro.bias_repeatability, between: [0.01 deg/h, 10 deg/h], log: true}
  - {path: initial.heading, between: [0.01 deg, 1 deg]}
  - {path: filter, cards: [filters/loose, filters/tight]}
design: latin_hypercube
samples: 40
store: metrics
requirements:
  - {name: fast, metric: velocity_error_3d, at: injection, probability: 0.9973, below: 0.6 m/s}
"""


@pytest.fixture(scope="session")
def text() -> str:
    """Return the text of the campaign."""
    return TEXT


@pytest.fixture
def written(tmp_path: Path) -> Path:
    path = tmp_path / "many.yaml"
    path.write_text(TEXT)
    return path


@pytest.fixture
def campaign(written: Path) -> Campaign:
    return load(written)
