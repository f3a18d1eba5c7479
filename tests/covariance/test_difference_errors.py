"""Differences of two epochs and carrier phases in both engines: runs, linear covariance, its adjoint."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.covariance.diagnostics.observability import observability
from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.covariance.selfcheck.jacobians import jacobians
from lvnav_trade.quantities.state_layout import state_names
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import MATCHED, loaded, prepare_hop

RUNS, SEED, LEVEL = 200, 20261122, 1e-4
TIMES = (5.0, 12.0, 20.0, 30.0)
ATTITUDE = "base.sensors={reference: {kind: attitude_reference, name: reference, source: test, sigma: 5 mrad}}"
LATER = "base.filter.logic={start_after: 4}"
TDCP, DELTA, PHASE = "[pseudorange, tdcp]", "[delta_pseudorange]", "[pseudorange, carrier_phase]"
SHARED = (
    "base.receiver.multipath=0.5 m", "base.receiver.multipath_time=20 s", "base.constellation.range_error=0.5 m",
    "base.constellation.range_error_time=600 s", "base.receiver.latency_sigma=1 us", "base.receiver.lever_error=2 cm",
)  # fmt: skip
CASES = {
    "augmented": (TDCP,),
    "considered": (TDCP, "base.filter.delayed_state=consider"),
    "found by the inverse": (TDCP, "base.filter.delayed_state=back_propagated"),
    "noise is a state": (TDCP, "base.filter.previous_noise=estimated"),
    "ranges": (DELTA,),
    "ranges, noise is a state": (DELTA, "base.filter.previous_noise=estimated"),
    "carrier phase": (PHASE,),
    "carrier phase and ranges": ("[range_rate, carrier_phase, delta_pseudorange]",),
    "lever arm": (TDCP, "base.receiver.lever_b=[1 m, 0.5 m, -0.3 m]"),
    "errors that last": (TDCP, *SHARED),
    "errors that last are states": (TDCP, *SHARED, "base.filter.extra_states=[range_bias]"),
    "slips": (PHASE, "base.receiver.cycle_slips={rate: 200 1/h}"),
    "differences over slips": (TDCP, "base.receiver.cycle_slips={rate: 200 1/h}"),
    "samples are measurements": ("[pseudorange, tdcp, attitude, imu]", ATTITUDE, LATER),
    "a slip that nobody notices": (
        TDCP, "faults=[{kind: cycle_slip, start: 10 s, size: 0.05}, {kind: range_bias, start: 15 s, duration: 100 s, "
        "drift: 2 mm/s}]",
    ),
}  # fmt: skip
# It needs kernels that take a minute to compile: `make slow` has it.
OWN_KERNELS = {"samples are measurements"}
EACH = [pytest.param(name, marks=[pytest.mark.slow] if name in OWN_KERNELS else []) for name in CASES]


@cache
def prepared_case(name):
    measurements, *more = CASES[name]
    return prepare_hop(loaded(MATCHED, f"base.filter.measurements={measurements}", *more))


@cache
def history(name):
    return covariance(prepared_case(name))


@pytest.mark.parametrize("name", EACH)
def test_monte_carlo_and_linear_covariance_agree(name):
    found, expected = run_block(prepared_case(name), SEED, 0, RUNS), history(name)
    assert not found.failed.any()
    at = [int(np.argmin(np.abs(expected.t - t))) for t in TIMES]
    states = range(prepared_case(name).layout.n_estimated)
    error, mean, sigma = (values[..., at, :][..., states] for values in (found.err, expected.mean, expected.true_sigma))
    live = sigma > 0.0
    square = np.where(live, np.sum((error - mean) ** 2, axis=0) / np.where(live, sigma, 1.0) ** 2, RUNS)
    tail = LEVEL / (2.0 * square.size)
    low, high = chi2.ppf(tail, RUNS), chi2.isf(tail, RUNS)
    assert low < square.min()
    assert square.max() < high
    # samples are linearised at the estimated motion, which noise moves
    rtol = 1e-2 if prepared_case(name).layout.motion >= 0 else 5e-3
    np.testing.assert_allclose(found.sigma.mean(axis=0)[at], expected.formal_sigma[at], rtol=rtol)


@pytest.mark.parametrize("name", EACH)
def test_the_adjoint_sums_to_the_variance(name):
    budget, forward = adjoint(prepared_case(name), 30.0), history(name)
    found, variance = budget.contribution.sum(axis=2), forward.true_sigma[-1, :9] ** 2
    np.testing.assert_allclose(found.sum(axis=1), variance, rtol=1e-6)
    np.testing.assert_allclose(found / variance[:, None], forward.budget[-1, :, :9].T / variance[:, None], atol=1e-6)


def test_the_inverse_transition_is_the_same_filter_as_the_clone():
    cloned, inverse = (run_block(prepared_case(name), SEED, 0, 8) for name in ("augmented", "found by the inverse"))
    np.testing.assert_allclose(inverse.sigma, cloned.sigma, rtol=1e-7)
    assert np.max(np.abs(inverse.err - cloned.err) / cloned.sigma) < 1e-5
    for field in ("formal_sigma", "true_sigma", "budget"):
        one, other = (getattr(history(name), field) for name in ("augmented", "found by the inverse"))
        np.testing.assert_allclose(other, one, rtol=1e-7, atol=1e-12 * np.abs(one).max())


def test_an_earlier_state_that_is_only_considered_costs_what_the_rows_before_it_tell():
    # rows are processed one after another: each later one finds the earlier state uncorrected
    velocity = {name: history(name).formal_sigma[-1, 3:6].max() for name in ("augmented", "considered")}
    assert velocity["considered"] > 5.0 * velocity["augmented"]


def test_noise_that_is_a_state_makes_a_filter_consistent_and_white_noise_makes_it_wary():
    matched, white = history("noise is a state"), history("augmented")
    np.testing.assert_allclose(matched.formal_sigma[1:, :9], matched.true_sigma[1:, :9], rtol=1e-4)
    assert np.all(white.formal_sigma[-1, 3:6] > 1.2 * white.true_sigma[-1, 3:6])
    assert np.all(white.true_sigma[-1, 3:6] > matched.true_sigma[-1, 3:6])


def test_differences_with_their_noise_as_a_state_know_what_a_phase_with_its_ambiguity_knows():
    # all differences of a carrier, with the covariance that they have, are the phases less an unknown constant
    differences, phases = history("noise is a state"), history("carrier phase")
    np.testing.assert_allclose(differences.formal_sigma[2:, :6], phases.formal_sigma[2:, :6], rtol=1e-5)
    # of the ambiguity 10 m are known at the start, which position feels beside ranges of 2 m
    np.testing.assert_allclose(differences.formal_sigma[2:, 6:9], phases.formal_sigma[2:, 6:9], rtol=1e-2)


@pytest.mark.slow
def test_the_first_difference_of_a_filter_is_that_after_its_start():
    """Of the epoch before a start nothing is known that is not known of the start: ranges alone are taken."""

    def started(measurements, *more):
        return covariance(prepare_hop(loaded(MATCHED, f"base.filter.measurements={measurements}", LATER, *more)))

    phases, ranges = started(TDCP), started("[pseudorange]")
    start = int(np.flatnonzero(phases.n_row > 0)[0])
    assert np.diff(phases.n_row)[start] == ranges.n_row[start] == phases.n_row[start]
    at = int(np.argmin(np.abs(phases.t - phases.t_epoch[start])))
    np.testing.assert_allclose(phases.formal_sigma[at, :9], ranges.formal_sigma[at, :9], rtol=1e-9)
    # of a single difference the noise of both epochs is new, whether it is a state or not
    estimated = started(TDCP, "base.filter.previous_noise=estimated")
    np.testing.assert_allclose(estimated.formal_sigma[at + 1, :9], phases.formal_sigma[at + 1, :9], rtol=1e-7)
    assert np.all(phases.formal_sigma[at + 1, 3:6] < 0.9 * ranges.formal_sigma[at + 1, 3:6])


def test_differences_sum_to_the_change_of_the_phase():
    case = prepared_case("a slip that nobody notices")
    phase, tracked = case.options.further_observables.phase, case.signals.satellite_by_slot[0, : case.signals.n_used[0]]
    kind = case.channels.observables.index("tdcp")
    slip = 0.05 * 299792458.0 / 1.57542e9
    line = case.signals.range[:, tracked]
    jumps = (phase[:, tracked] - line)[-1] - (phase[:, tracked] - line)[0]  # ranges drift with the phases
    assert sorted(np.abs(jumps))[-1] == pytest.approx(slip, rel=1e-5)
    assert sorted(np.abs(jumps))[-2] < 1e-6  # of the other satellites phase and range differ by nothing
    assert case.model.entry.shape[0] == case.channels.n_channel
    assert case.channels.names[kind].endswith("phase difference")


def test_what_is_new_has_no_difference_and_a_slip_makes_it_new():
    slips, whole = prepared_case("differences over slips"), prepared_case("augmented")
    channels = slips.channels.observable_slice("tdcp")
    tracked = slips.sky.is_tracked
    for case in (slips, whole):
        assert not case.options.differences.is_present[0, channels][tracked[0]].any()
    lost = whole.options.differences.is_present[:, channels] & ~slips.options.differences.is_present[:, channels]
    # 200 an hour and channel: as many as the rate says, to four sigma of a Poisson process
    count = 200.0 / 3600.0 * 29.0 * tracked[0].sum()
    assert abs(lost.sum() - count) < 4.0 * np.sqrt(count)
    phases = prepared_case("slips")
    restarted = phases.options.further_observables.is_restarted & (np.arange(len(tracked)) > 0)[:, None]
    np.testing.assert_array_equal(restarted, lost)
    ambiguity = [name for name in state_names(phases.layout) if name.startswith("ambiguity")]
    assert len(ambiguity) == tracked.any(axis=0).sum()


@pytest.mark.parametrize("name", ["lever arm", "carrier phase and ranges", "errors that last are states"])
def test_rows_are_the_derivatives_of_what_is_predicted(name):
    checks = jacobians(prepared_case(name))
    listed = prepared_case(name).scenario.filter.measurements
    assert {check.quantity for check in checks} == set(listed)
    assert [check.cell_texts for check in checks if check.verdict != "passed"] == []


def test_differences_make_velocity_observable_over_a_few_epochs():
    stretch = observability(prepared_case("augmented"), np.array([10.0, 14.0]))[0]
    assert stretch.directions.shape[1] == len(prepared_case("augmented").layout.reported_states)
    assert np.all(np.isfinite(stretch.singular_values))
