"""Key numbers of IMU, receiver and filter: of the case's own resolved cards, in the units of data sheets."""

from __future__ import annotations

import pytest

from lvnav_trade.report.assumptions import configuration
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.tables.read import load
from tests import synthetic

BASE = """\
base:
  imu: {name: none}
  receiver: {name: patch, rate: 1.0 Hz, latency: 0.0 s, pseudorange_sigma: 2.0 m, solution: {position_sigma: 3.0 m}}
  filter: {name: tight one, measurements: [pseudorange, range_rate], update_rate: 1.0 Hz}
axes:
  - path: imu
    labels: [fine, coarse]
    values:
      - {name: fine, rate: 200.0 Hz,
         gyro: {bias_repeatability: 4.84813681109536e-06 rad/s}, accel: {scale_factor: 3e-4}}
      - {name: pair, units: [{name: a, rate: 100.0 Hz}, {name: b, rate: 100.0 Hz}]}
"""


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    head = synthetic.CAMPAIGN.partition("requirements:")[0]
    base = BASE.replace("scale_factor: 3e-4", "scale_factor: 0.0003 dimensionless")
    return load(synthetic.results(tmp_path_factory.mktemp("configured"), n_run=8, campaign=head + base))


def test_key_numbers_are_those_of_each_case(tables) -> None:
    frame = METRICS["configuration"](tables)
    fine = frame[frame.case == "imu=fine"].set_index(["device", "term"])
    assert fine.loc["IMU", "gyro bias, turn-on"].value_text == "1 deg/h"
    assert fine.loc["IMU", "gyro bias, turn-on"].value_si == 4.84813681109536e-06
    assert fine.loc["IMU", "gyro bias, turn-on"].unit_si == "rad/s"
    assert fine.loc["IMU", "accel. scale factor"].value_text == "300 ppm"
    assert fine.loc["IMU", "ARW"].value_text == "–"
    assert fine.loc["receiver", "latency"].value_text == "none"
    assert fine.loc["filter", "coupling"].value_text == "tight"
    assert set(frame[frame.case == "imu=coarse"].device) == {"IMU 1", "IMU 2", "receiver", "filter"}


def test_a_configuration_is_in_one_line_with_its_cases(tables) -> None:
    imus, receivers, filters = configuration(tables)
    assert [(row[0], row[-1]) for row in imus.rows] == [("fine", "imu=fine"), ("a", "imu=coarse"), ("b", "imu=coarse")]
    assert [(row[0], row[-1]) for row in receivers.rows] == [("patch", "all")]
    assert filters.head[:3] == ("filter", "estimated states", "coupling")
