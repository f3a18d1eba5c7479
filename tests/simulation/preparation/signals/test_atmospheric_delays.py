"""Delays along the nominal flight: rates are the derivative, and truth and model choose their models apart."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.gnss.delay_cards import AtmosphereCard, CorrectionsCard
from lvnav_trade.gnss.visibility import sky
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.signals.atmospheric_delays import delays
from tests.building import LOOSE, MATCHED, loaded, prepare_hop, with_fields
from tests.simulation.preparation.test_correlated import low_hop

TRUE = {"troposphere": {"kind": "ray_traced"}, "ionosphere": {"kind": "content"}}
T = np.array([4.0, 9.0, 14.0])


def along(t=T, corrections=None):
    scenario = loaded(MATCHED)
    seen = sky(scenario.constellation, scenario.receiver, low_hop(), t)
    card = CorrectionsCard.model_validate(corrections or {})
    return delays(low_hop(), scenario.receiver, seen, AtmosphereCard.model_validate(TRUE), card)


def test_a_rate_is_the_derivative_of_the_delay_and_the_ionosphere_advances_the_carrier():
    before, now, after = (along(t) for t in (T - 0.5, T, T + 0.5))
    for layer, sign in (("troposphere", 1.0), ("ionosphere", -1.0)):
        slope = getattr(after, layer)[..., 0] - getattr(before, layer)[..., 0]
        np.testing.assert_allclose(getattr(now, layer)[..., 1], sign * slope, atol=2e-3)
    assert np.abs(now.troposphere[..., 1]).max() > 1e-3


def test_a_matched_correction_leaves_nothing_and_none_leaves_all():
    matched = along(corrections={"troposphere": {"kind": "matched"}, "ionosphere": {"kind": "matched"}})
    np.testing.assert_array_equal(matched.residual, 0.0)
    none = along()
    np.testing.assert_array_equal(none.residual, none.troposphere + none.ionosphere)
    assert none.residual.max() > 1.0


def test_a_simple_correction_leaves_a_small_part_of_the_air():
    found = along(corrections={"troposphere": {"kind": "saastamoinen"}, "ionosphere": {"kind": "matched"}})
    # the lowest satellites stand at 5 deg, where one over the sine of elevation is 10 % too much
    assert 1e-3 < np.abs(found.residual[..., 0]).max() < 0.15 * found.troposphere[..., 0].max()


@lru_cache(maxsize=8)
def prepare_case(*settings, corrections="none"):
    scenario = with_fields(loaded(MATCHED, *settings), atmosphere=TRUE)
    models = {"troposphere": {"kind": corrections}, "ionosphere": {"kind": "matched"}}
    return prepare_hop(
        scenario.model_copy(update={"filter": with_fields(scenario.filter, corrections=models)}), low_hop()
    )


@pytest.mark.parametrize("settings", [(), (LOOSE,)], ids=["tight", "loose"])
def test_what_is_not_corrected_is_the_same_mean_error_in_both_engines(settings):
    prepared_case = prepare_case(*settings)
    history, block = covariance(prepared_case), run_block(prepared_case, 5, 0, 200)
    size = history.true_sigma[-1, :9]
    assert np.abs(history.mean[-1, 6:9]).max() > 1.0  # metres of air low in the sky
    off = np.abs(block.err[:, -1, :9].mean(axis=0) - history.mean[-1, :9])
    assert np.all(off < 5.0 * size / np.sqrt(200) + 0.01 * np.abs(history.mean[-1, :9]))


def test_the_truths_atmosphere_clock_and_unit_leave_the_filters_rows_and_covariance_as_they_were():
    """Truth and filter are two models: what is true never reaches what the filter assumes, unless it is asked for."""
    scenario = loaded(MATCHED)
    own = {
        "imu": {
            "gyro_random_walk": "0.05 deg/sqrt(h)", "accel_random_walk": "0.1 mg/sqrt(Hz)", "gyro_bias": "2 deg/h",
            "accel_bias": "3 mg",
        },
        "receiver": {
            "pseudorange_sigma": "3 m", "range_rate_sigma": "0.2 m/s", "position_sigma": "3 m",
            "velocity_sigma": "0.2 m/s", "clock_h0": 2e-20, "clock_h_minus2": 3e-23,
        },
        "initial": {
            "tilt": "0.2 deg", "heading": "0.2 deg", "position": "5 m", "velocity": "0.1 m/s", "clock_bias": "500 m",
            "clock_drift": "5 m/s",
        },
        "corrections": {"troposphere": {"kind": "spilker"}},
    }  # fmt: skip
    scenario = scenario.model_copy(update={"filter": with_fields(scenario.filter, **own)})
    truths = [
        scenario,
        with_fields(scenario, atmosphere=TRUE),
        with_fields(scenario, **{"receiver.clock.h0": 1e-18, "receiver.clock.initial_bias": "3 km"}),
        with_fields(scenario, **{"imu.gyro.bias_repeatability": "50 deg/h", "imu.accel.scale_factor": "5000 ppm"}),
        with_fields(scenario, gravity={"sigma": "1e-3 m/s^2"}, **{"receiver.multipath": "9 m"}),
    ]
    first, *others = [prepare_hop(truth, low_hop()) for truth in truths]
    formal = covariance(first).formal_cov
    for other in others:
        for name in first.model._fields:
            ours, theirs = (getattr(one.model, name) for one in (other, first))
            pairs = zip(ours, theirs, strict=True) if isinstance(ours, tuple) else [(ours, theirs)]
            for a, b in pairs:
                np.testing.assert_array_equal(a, b, err_msg=name)
        np.testing.assert_array_equal(other.signals.variance, first.signals.variance)
        np.testing.assert_array_equal(other.signals.partial, first.signals.partial)
        np.testing.assert_array_equal(covariance(other).formal_cov, formal)
