"""Numbers that cards mark as assumed or second hand: a line for each case, and those in which the cases differ."""

from __future__ import annotations

import pytest

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.assumed_numbers import varied_assumptions
from lvnav_trade.results.tables.read import load
from tests import synthetic

BASE = """\
base:
  imu: {name: fine, rate: 200.0 Hz}
  receiver: {name: patch, rate: 1.0 Hz, assumed: {rate: usual}, antennas: [
    {name: a, assumed: {cutoff: hidden}, cutoff: 1.7453292519943295 rad},
    {name: b, assumed: {cutoff: hidden}, cutoff: 1.7453292519943295 rad}]}
  filter: {name: tight, assumed: {update_rate: usual}, update_rate: 1.0 Hz}
axes:
  - path: imu
    labels: [fine, coarse]
    values:
      - {name: fine, rate: 200.0 Hz, assumed: {rate: usual, resources: no price},
         second_hand: {gyro.bias_repeatability: a paper}, resources: {cost: 5.0, mass: 1.0 kg, mtbf: null},
         gyro: {bias_repeatability: 4.84813681109536e-06 rad/s}}
      - {name: coarse, rate: 200.0 Hz, assumed: {rate: usual}, resources: {cost: 3.0, mass: 1.0 kg},
         gyro: {bias_repeatability: 0.017453292519943295 rad/s}}
"""


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    head = synthetic.CAMPAIGN.partition("requirements:")[0]
    return load(synthetic.results(tmp_path_factory.mktemp("marked"), n_run=8, campaign=head + BASE))


def test_every_marked_number_is_listed_with_its_case_value_and_reason(tables) -> None:
    frame = METRICS["assumptions"](tables)
    fine = frame[frame.case == "imu=fine"].set_index(["place", "field"])
    assert list(fine.loc["imu", "gyro.bias_repeatability"]) == ["imu=fine", "fine", "second hand", "1 deg/h", "a paper"]
    assert fine.loc["imu", "resources"].value_text == "cost 5, mass 1 kg"
    assert fine.loc["receiver.antennas.1", "cutoff"].value_text == "100 deg"
    assert fine.loc["filter", "update_rate"].mark == "assumed"
    coarse = frame[(frame.case == "imu=coarse") & (frame.place == "imu")]
    assert list(coarse.field) == ["rate"]


def test_products_are_compared_by_marked_numbers_only_where_these_differ(tables) -> None:
    """Rate and mass are the same in both cases; the filter is no product."""
    frame = varied_assumptions(tables)
    assert list(frame.itertuples(index=False, name=None)) == [
        ("imu", "resources.cost", "assumed", 1, 2),
        ("imu", "gyro.bias_repeatability", "second hand", 1, 2),
    ]
