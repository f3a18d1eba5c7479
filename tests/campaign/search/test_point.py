"""One design by linear covariance: frozen filters, other values, ratios."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.search.point import (
    combined_remark,
    evaluate_requirements,
    frozen_filter,
    number_at,
    with_filter,
    with_values,
)
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.scenario.filter_models import filter_models

TILT = "requirements=[{name: tilt, metric: attitude_error_3d, at: liftoff, probability: 0.95, below: 3 mrad}]"


@pytest.fixture(scope="module")
def scenario():
    return cases(load("campaigns/smoke.yaml"))[0].scenario


def test_a_frozen_filter_has_the_numbers_of_its_start_and_follows_no_longer(scenario) -> None:
    card = frozen_filter(scenario)
    stays = with_filter(
        with_values(scenario, {"initial.tilt": "1 deg", "imu.gyro.bias_repeatability": "7 deg/h"}), card
    )
    follows = with_values(scenario, {"initial.tilt": "1 deg"})
    (imu, receiver, start), (was_imu, was_receiver, was) = filter_models(stays), filter_models(scenario)
    assert imu == was_imu
    assert start == was
    assert receiver.pseudorange_sigma == was_receiver.pseudorange_sigma
    assert receiver.clock_h0 == was_receiver.clock_h0
    assert filter_models(follows)[2].tilt == pytest.approx(np.radians(1.0))
    assert stays.initial.tilt == pytest.approx(np.radians(1.0))


def test_values_are_read_and_set_with_their_units(scenario) -> None:
    assert number_at(with_values(scenario, {"initial.heading": "2 mrad"}), "initial.heading", "deg") == pytest.approx(
        0.1145915
    )
    noisy = with_values(scenario, {"filter.velocity_noise": "0.3 m/s/sqrt(h)"})
    assert number_at(noisy, "filter.velocity_noise", "m/s/sqrt(h)") == pytest.approx(0.3)
    assert np.isnan(number_at(scenario, "imu.gyro", "deg"))
    with pytest.raises(InputError, match=r"initial\.heading=-1 deg: initial\.heading: Input should be greater"):
        with_values(scenario, {"initial.heading": "-1 deg"})
    with pytest.raises(InputError, match=r"initial\.heding=1 deg: initial\.heding: Extra inputs"):
        with_values(scenario, {"initial.heding": "1 deg"})


@pytest.mark.slow
def test_at_its_start_a_frozen_filter_is_the_re_tuned_one_and_elsewhere_no_better(scenario) -> None:
    campaign = load("campaigns/smoke.yaml", [TILT])
    for tilt, equal in (("0.1 deg", True), ("1 deg", False)):
        follows = with_values(scenario, {"initial.tilt": tilt})
        tuned, stays = (
            evaluate_requirements(campaign, one)["tilt"]
            for one in (follows, with_filter(follows, frozen_filter(scenario)))
        )
        assert (stays.estimate == pytest.approx(tuned.estimate, rel=1e-12)) == equal
        assert stays.estimate >= tuned.estimate * (1.0 - 1e-12)


def test_a_remark_has_every_reason_once_and_none_is_no_remark() -> None:
    assert combined_remark(["", ""]) == ""
    assert combined_remark(["a", "", "b", "a"]) == "not applicable, confirm by runs: a; b"
