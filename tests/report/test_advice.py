"""What makes a design comply is said as an engineer would say it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from lvnav_trade.report.advice import advice, missing_state, missing_states, ways_to_comply
from lvnav_trade.report.validity import sigma_warnings
from lvnav_trade.results.tables.read import Tables, load
from tests import synthetic
from tests.injections import with_injections

IMU = {"accel": {"scale_factor": "0.0015 dimensionless", "bias_repeatability": "0.0196133 m/s**2"},
       "gyro": {"random_walk": "8.726646259971647e-06 rad/s**0.5", "bias_repeatability": [1.0, 2.0, 3.0]}}  # fmt: skip
TIGHT = ["pseudorange", "range_rate"]


def scenario(measurements: list[str] = TIGHT, **fields: Any) -> dict[str, Any]:
    return {"imu": IMU, "filter": {"measurements": measurements, "extra_states": [], **fields},
            "initial": {"tilt": "0.0017453 rad", "heading": "0.00087266 rad"}}  # fmt: skip


@pytest.fixture(scope="module")
def tables(tmp_path_factory) -> Tables:
    found = load(synthetic.results(tmp_path_factory.mktemp("advice"), n_run=8))
    found.__dict__["campaign"] = {**found.campaign, "base": scenario()}
    return found


def said(tables: Tables, source: str, factor: float, share: float, remark: str = "") -> str:
    row = SimpleNamespace(case="imu=fine", requirement="loose bound", source=source, factor_ratio=factor,
                          share_ratio=share, remark=remark)  # fmt: skip
    return advice(tables, row)


def test_a_shipped_filter_that_models_the_source_comes_before_a_better_sensor(tables):
    assert said(tables, "accelerometer scale factor", 0.6727, 0.9555) == (
        "imu=fine: use the filter card filters/tight_extended, which models the accelerometer scale-factor error (this "
        "filter does not), or reduce this error from 1500 to 1010 ppm (1 sigma), estimated with frozen gains. This "
        "error contributes 96 % of the mean-square velocity error at injection."
    )


@pytest.mark.parametrize(
    ("source", "factor", "words"),
    [
        ("accelerometer bias repeatability", 0.5, "reduce the accelerometer bias repeatability from 2.00 to 1.00 mg"),
        ("gyro random walk", 0.5, "reduce the gyro random walk from 0.0300 to 0.0150 deg/sqrt(h)"),
        ("initial attitude", 0.25, "tilt from 0.100 to 0.0250 deg, heading from 0.0500 to 0.0125 deg (1 sigma)"),
        ("gyro bias repeatability", 0.25, "reduce the gyro bias repeatability to 25 % of the present size (1 sigma)"),
        ("an unknown source", 0.25, "reduce the an unknown source to 25 % of the present size (1 sigma)"),
    ],
)
def test_a_better_sensor_is_stated_in_the_units_of_its_datasheet(tables, source, factor, words):
    assert words in said(tables, source, factor, 0.4)


def test_the_share_is_of_the_error_that_the_requirement_is_on(tables):
    """That of a normalised error differs from that of the error itself."""
    found = tables.with_frames()
    stated = {"name": "loose bound", "metric": "normalised_velocity_error", "below": "2 sigma", "probability": 0.9}
    found.__dict__["campaign"] = {**tables.campaign, "requirements": [{**stated, "at": "stage1_cutoff"}]}
    text = said(found, "accelerometer bias repeatability", 0.5, 0.97)
    assert "97 % of the mean-square normalised velocity error at stage1 cutoff." in text
    found.__dict__["campaign"] = {**tables.campaign, "requirements": [{**stated, "during": "flight"}]}
    text = said(found, "accelerometer bias repeatability", 0.5, 0.97, "to keep it at max_q")
    assert "97 % of the mean-square normalised velocity error, to keep it at max_q." in text


def test_a_source_of_the_vehicle_is_a_dispersion(tables):
    """A smaller thrust dispersion is meant, not a smaller thrust."""
    text = said(with_injections(tables), "thrust, gyro bias", 0.5, 0.9, "together")
    assert "reduce the thrust dispersion and gyro bias together to 50 % of the present size" in text
    assert "reduce the thrust dispersion to 50 %" in said(with_injections(tables), "thrust", 0.5, 0.9)


def test_several_sources_are_improved_together(tables):
    assert said(tables, "gyro bias, range noise", 0.5, 0.9, "together") == (
        "imu=fine: reduce the gyro bias and range noise together to 50 % of the present size (1 sigma), estimated "
        "with frozen gains. These errors contribute 90 % of the mean-square velocity error at injection."
    )
    assert said(tables, "", float("nan"), float("nan"), "nothing would do") == "imu=fine: nothing would do."


@pytest.mark.parametrize(
    ("data", "share", "card"),
    [
        (scenario(), 0.9, "filters/tight_extended"),
        (scenario(["position", "velocity"]), 0.9, "filters/loose_extended"),
        (scenario(["pseudorange"]), 0.9, ""),
        (scenario(), 0.4, None),
        (scenario(extra_states=["accel_scale_factor"]), 0.9, None),
        (scenario(consider=["accel_scale_factor"]), 0.9, None),
    ],
)
def test_a_missing_state_is_named_where_it_dominates_with_the_card_of_the_same_measurements(data, share, card):
    found = missing_state(data, "accelerometer scale factor", share)
    assert (found and found.card) == card
    assert found is None or found.state == "accel_scale_factor"


def test_biases_are_states_of_every_filter():
    assert missing_state(scenario(), "accelerometer bias repeatability", 0.9) is None


def renamed(tables: Tables, fine: str, coarse: str) -> Tables:
    """Return results in which the source with 75 % (gyro bias) or 25 % (range noise) is a gyro scale factor."""
    names = tables.budget.case.map(tables.labels).map({"imu=fine": fine, "imu=coarse": coarse})
    source = tables.budget.source.mask(tables.budget.source == names, "gyro scale factor")
    return tables.with_frames(budget=tables.budget.assign(source=source))


def test_the_source_that_filters_do_not_model_is_the_largest_of_one_and_counted_in_all(tables):
    """In one case it has 75 % of the mean square, in the other 25 %: neither filter has its state."""
    cases = list(tables.labels)
    assert missing_states(tables, cases) == ("velocity error at injection", [])
    error, found = missing_states(renamed(tables, "gyro bias", "range noise"), cases)
    assert error == "velocity error at injection"
    assert [(one.source, one.state, round(one.share, 6)) for one in found] == [
        ("gyro scale factor", "gyro_scale_factor", 0.75), ("gyro scale factor", "gyro_scale_factor", 0.25)]  # fmt: skip
    assert missing_states(renamed(tables, "range noise", "range noise"), cases)[1] == []  # it dominates in neither


@pytest.mark.parametrize(("states", "said"), [
    ({}, "Neither filter models the gyro scale factor, which accounts for 25 to 75 % of the mean-square velocity error "
         "at injection by linear covariance; filters/tight_extended models it."),
    ({"imu=coarse": ["gyro_scale_factor"]},
     "1 of the 2 does not model the gyro scale factor, which accounts for 75 % of the mean-square velocity error at "
     "injection by linear covariance; filters/tight_extended models it."),
    ({"imu=fine": ["gyro_scale_factor"]}, "do not fly these covariances.")])  # fmt: skip
def test_a_warning_counts_the_filters_that_lack_a_state(tables, monkeypatch, states, said):
    """Where the only case that it dominates models it, nothing is said."""
    found = renamed(tables, "gyro bias", "range noise")
    consistency = found.consistency
    found = found.with_frames(
        consistency=consistency.assign(
            expected_nees_ratio=49.0 * consistency.expected_nees_ratio,
            nees_mean_ratio=49.0 * consistency.nees_mean_ratio,
        )
    )
    labels = found.labels
    monkeypatch.setattr(
        "lvnav_trade.report.advice.scenario_of",
        lambda _, case: scenario(extra_states=states.get(labels[case], [])),
    )
    (warning,) = sigma_warnings(found)
    assert warning.text.startswith("2 of 2 filters are overconfident: their sigma is ")
    assert warning.text.endswith(said)


def test_the_first_way_to_comply_is_a_change_of_a_design_that_violates():
    frame = pd.DataFrame(
        {
            "case": ["a", "b", "c", "d"],
            "verdict": ["undecided", "undecided", "violated", "violated"],
            "source": ["", "range noise", "gyro bias", ""],
            "remark": ["linear covariance expects it to be met as it is", "", "", "nothing would do"],
        }
    )
    assert list(ways_to_comply(frame).case) == ["c", "b"]
    assert ways_to_comply(frame[frame.source == ""]).empty
