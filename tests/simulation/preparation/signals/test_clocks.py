"""Clocks of the filter: bias and drift, bias alone, or ranges less that of a reference satellite."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import chi2

from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import MATCHED, loaded, prepare_hop, with_fields

RUNS = 200
NAVIGATION = slice(0, 9)


@lru_cache(maxsize=16)
def prepared_case(clock="two_state", *changes):
    fields = {name: dict(value) if isinstance(value, tuple) else value for name, value in changes}
    return prepare_hop(with_fields(loaded(MATCHED), **{"filter.clock": clock} | fields))


def unbounded():
    """What a filter assumes of the receiver but for the clock: noise of 10 km and 1 km/s a second."""
    _, model, _ = filter_models(loaded(MATCHED))
    numbers = {"pseudorange_sigma": " m", "position_sigma": " m", "range_rate_sigma": " m/s", "velocity_sigma": " m/s"}
    text = {name: f"{getattr(model, name)}{unit}" for name, unit in numbers.items()}
    c = 299792458.0
    return text | {"clock_h0": 2.0 * 1e8 / c**2, "clock_h_minus2": 1e6 / (2.0 * np.pi**2 * c**2)}


def test_differences_are_a_clock_of_unbounded_noise_and_whichever_satellite_is_the_reference():
    differenced = prepared_case("differenced")
    limit = prepared_case("two_state", ("filter.receiver", tuple(unbounded().items())))
    one, other = covariance(differenced), covariance(limit)
    for field in ("formal_sigma", "true_sigma"):
        a, b = (getattr(history, field)[1:, NAVIGATION] for history in (one, other))
        np.testing.assert_allclose(a, b, rtol=1e-6)
    runs = [run_block(case, 3, 0, 8).err[:, :, NAVIGATION] for case in (differenced, limit)]
    assert np.all(np.abs(runs[0] - runs[1]) <= 1e-5 * one.true_sigma[None, :, NAVIGATION])
    use = differenced.signals.satellite_by_slot[0, : differenced.signals.n_used[0]]
    lowest = use[np.argmin(differenced.sky.elevation[0, use])]
    assert np.all(use[differenced.signals.reference[0]] != lowest)
    named = covariance(prepared_case("differenced", ("filter.reference_satellite", differenced.sky.names[lowest])))
    np.testing.assert_allclose(named.formal_sigma[:, NAVIGATION], one.formal_sigma[:, NAVIGATION], rtol=1e-7)


def test_differences_cost_what_the_clock_knew():
    modelled, differenced = covariance(prepared_case()), covariance(prepared_case("differenced"))
    ratio = differenced.formal_sigma[-1, NAVIGATION] / modelled.formal_sigma[-1, NAVIGATION]
    assert np.all(ratio > 1.0 - 1e-9)
    # drift and vertical velocity are alike in range rates from above: 1.8 times the sigma after 30 s
    assert 1.5 < ratio[5] < 2.1
    assert np.all(differenced.n_row == modelled.n_row - 2)


def agree(case, rounding=1e-8):
    """Both engines and the adjoint agree; rounding: relative, of the adjoint (ambiguities of 10 m beside 2 mm)."""
    history, runs = covariance(case), run_block(case, 5, 0, RUNS)
    at = [4, 10, 20, len(case.t_hist) - 1]
    ratio = np.mean(runs.err[:, at][:, :, NAVIGATION] ** 2, axis=0) / (
        history.true_sigma[at][:, NAVIGATION] ** 2 + history.mean[at][:, NAVIGATION] ** 2
    )
    low, high = chi2.ppf([5e-4 / ratio.size, 1.0 - 5e-4 / ratio.size], RUNS) / RUNS
    assert np.all((ratio > low) & (ratio < high)), ratio.round(2)
    np.testing.assert_allclose(history.budget.sum(axis=1), history.true_sigma**2, rtol=1e-9, atol=1e-30)
    back = adjoint(case, 30.0)
    np.testing.assert_allclose(
        back.contribution.sum(axis=2).T, history.budget[-1, :, :9], rtol=rounding, atol=1e-12 * history.budget[-1].max()
    )
    return history


def test_both_engines_difference():
    agree(prepared_case("differenced"))


RANGES = ("filter.measurements", ("pseudorange",))
CLOCK = ("receiver.clock", (("h0", 2e-19), ("h_minus2", 2e-20), ("initial_bias", "300 m"), ("initial_drift", "2 m/s")))
STILL = ("receiver.clock", (("h0", 2e-19), ("h_minus2", 0.0), ("initial_bias", "300 m")))


def of_ranges(clock, oscillator):
    name, fields = oscillator
    return prepare_hop(
        with_fields(loaded(MATCHED), **{"filter.clock": clock, RANGES[0]: list(RANGES[1]), name: dict(fields)})
    )


def test_a_clock_without_drift_has_one_state():
    two, one = (covariance(of_ranges(clock, STILL)) for clock in ("two_state", "one_state"))
    np.testing.assert_allclose(one.formal_sigma[:, NAVIGATION], two.formal_sigma[:, NAVIGATION], rtol=1e-9)
    np.testing.assert_allclose(one.true_sigma[:, NAVIGATION], two.true_sigma[:, NAVIGATION], rtol=1e-9)


def test_one_state_takes_the_drift_for_white_noise_in_both_engines():
    case = of_ranges("one_state", CLOCK)
    layout = case.layout
    assert layout.clock + 1 == layout.n_estimated == layout.n_state - 1
    history = agree(case)
    assert np.all(history.formal_sigma[:, layout.clock + 1] == 0.0)
    # a drift of 2 m/s and more is in the noise of the bias: formal sigma covers what is true
    assert np.all(history.expected_nees[5:] < 1.05 * layout.n_estimated)
    two = covariance(of_ranges("two_state", CLOCK))
    assert np.all(history.true_sigma[-1, 6:9] > two.true_sigma[-1, 6:9])


def of_differences(clock, measurements, *changes):
    fields = {name: dict(value) if isinstance(value, tuple) else value for name, value in changes}
    return prepare_hop(
        with_fields(loaded(MATCHED), **{"filter.clock": clock, "filter.measurements": measurements} | fields)
    )


@pytest.mark.parametrize(
    "measurements",
    [pytest.param(["pseudorange", "tdcp"], marks=pytest.mark.slow), ["carrier_phase", "delta_pseudorange"]],
)
def test_both_engines_difference_every_observable_of_a_satellite(measurements):
    case = of_differences("differenced", measurements)
    taken = case.signals.reference
    kinds = [case.channels.observables.index(name) for name in measurements]
    assert np.all(taken[1:, kinds] >= 0)  # a difference has none at the first epoch
    assert np.all(np.delete(taken, kinds, axis=1) == -1)
    history = agree(case, rounding=1e-4)
    assert np.all(history.n_row[1:] == 2 * (case.signals.n_used[1:] - 1))
    use = case.signals.satellite_by_slot[0, : case.signals.n_used[0]]
    lowest = case.sky.names[use[np.argmin(case.sky.elevation[0, use])]]
    named = covariance(of_differences("differenced", measurements, ("filter.reference_satellite", lowest)))
    np.testing.assert_allclose(named.formal_sigma[:, NAVIGATION], history.formal_sigma[:, NAVIGATION], rtol=1e-6)


@pytest.mark.parametrize("measurements", [["tdcp"], ["delta_pseudorange"], ["carrier_phase"]])
def test_what_the_filter_assumes_of_the_clock_is_nothing_to_differences(measurements):
    assumed, wild = of_differences("differenced", measurements), unbounded() | {"carrier_phase_sigma": "2 mm"}
    # 10 m and 1 m/s a second: of 10 km and phases of 2 mm rounding is seen
    wild |= {"clock_h0": 1e-6 * wild["clock_h0"], "clock_h_minus2": 1e-6 * wild["clock_h_minus2"]}
    loose = of_differences("differenced", measurements, ("filter.receiver", wild))
    one, other = covariance(assumed), covariance(loose)
    np.testing.assert_allclose(other.formal_sigma[:, NAVIGATION], one.formal_sigma[:, NAVIGATION], rtol=1e-5)
    np.testing.assert_allclose(other.true_sigma[:, NAVIGATION], one.true_sigma[:, NAVIGATION], rtol=1e-5)


def test_phases_beside_ranges_have_the_ranges_for_their_clock():
    case = of_differences("differenced", ["pseudorange", "carrier_phase"])
    kinds = case.channels.observables
    assert np.all(case.signals.reference[:, kinds.index("pseudorange")] >= 0)
    assert np.all(case.signals.reference[:, kinds.index("carrier_phase")] == -1)


def test_a_difference_is_not_referred_to_a_satellite_that_has_none():
    slips = ("receiver.cycle_slips", {"rate": "300 1/h"})
    case = of_differences("differenced", ["pseudorange", "tdcp"], slips)
    kinds, signals = case.channels.observables, case.signals
    kind, first = kinds.index("tdcp"), kinds.index("pseudorange")
    apart = 0
    for epoch in range(1, len(signals.n_used)):
        slot = signals.reference[epoch, kind]
        assert case.options.differences.is_present[epoch, len(kinds) * signals.satellite_by_slot[epoch, slot] + kind]
        apart += slot != signals.reference[epoch, first]
    assert apart > 0


def test_one_state_stands_before_the_clones_and_its_drift_stays_zero():
    case = of_differences("one_state", ["pseudorange", "tdcp"], CLOCK)
    layout = case.layout
    assert layout.has_reduced_clock
    assert layout.earlier_epoch == layout.clock + 2 == layout.n_estimated + 1
    assert case.model.n_estimated == layout.n_state
    history = agree(case)
    assert np.all(history.formal_sigma[:, layout.clock + 1] == 0.0)


def test_what_makes_no_sense_is_refused():
    with pytest.raises(ValidationError, match="one_state models the drift as white noise"):
        with_fields(loaded(MATCHED).filter, clock="one_state")
    with pytest.raises(InputError, match="'G99' is not in the constellation"):
        prepared_case("differenced", ("filter.reference_satellite", "G99"))
