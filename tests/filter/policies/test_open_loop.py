"""The open loop: equal to the closed one for small errors, the strapdown left alone, and every rule of its logic."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.filter.policies.policy_cards import CHECKS
from lvnav_trade.kernels.covariance import apply_phi
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import WIDTH, view
from lvnav_trade.quantities.records import MODES, REASONS
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import INERTIAL, LOOSE, MATCHED, loaded, prepare_hop, with_fields

OPEN = {"feedback": "open"}
TIGHT = "base.filter=filters/tight"
LOGIC = {
    "pdop_below": 10.0, "wild_position": "100 m", "wild_velocity": "10 m/s", "start_after": 3, "correct_after": "4 s",
    "stop_after": "4 s", "covariance_position": "1 km", "covariance_velocity": "100 m/s",
}  # fmt: skip


def prepare_case(*settings, faults=(), initial=None, history=1.0, **fields):
    """The short flight of a matched unit; fields of the filter's card, faults and initial errors replaced."""
    scenario = loaded(MATCHED, *settings)
    card = with_fields(scenario.filter, **fields)
    start = with_fields(scenario.initial, **(initial or {}))
    return prepare_hop(with_fields(scenario.model_copy(update={"filter": card, "initial": start}), faults=list(faults)))


def errors(prepared_case, runs=24, seed=3):
    return run_block(prepared_case, seed, 0, runs).err[:, :, :9]


@pytest.mark.parametrize("coupling", [LOOSE, TIGHT], ids=["loose", "tight"])
def test_for_small_errors_open_and_closed_loop_are_the_same(coupling):
    small = {"tilt": "0.005 deg", "heading": "0.005 deg", "position": "1 m", "velocity": "0.01 m/s"}
    unit = "base.imu=imu/navigation_matched"
    closed, opened = (prepare_case(coupling, unit, initial=small, **fields) for fields in ({}, OPEN))
    sigma = covariance(closed).true_sigma[:, :9]
    one, other = errors(closed), errors(opened)
    assert np.max(np.abs(one - other) / sigma) < 2e-3
    assert np.abs(one[:, -1] / sigma[-1]).max() > 1.0


def test_the_error_state_is_propagated_by_every_step_however_seldom_the_covariance_is_linearised():
    """A transition of five seconds ago in the covariance alone: other gains, the same in both loops."""
    small = {"tilt": "0.005 deg", "heading": "0.005 deg", "position": "1 m", "velocity": "0.01 m/s"}
    unit = "base.imu=imu/navigation_matched"
    closed, opened, often = (
        prepare_case(LOOSE, unit, initial=small, **fields)
        for fields in ({"transition_rate": "0.2 Hz"}, {"transition_rate": "0.2 Hz", **OPEN}, OPEN)
    )
    sigma = covariance(closed).true_sigma[:, :9]
    one, other = errors(closed), errors(opened)
    assert np.max(np.abs(one - other) / sigma) < 2e-3
    assert np.max(np.abs(errors(often) - other) / sigma) > 0.02


def test_what_they_differ_by_is_of_second_order_in_the_initial_error():
    """Twice the tilt: four times the difference."""
    differences = []
    for size in ("0.2 deg", "0.4 deg", "0.8 deg"):
        same = {"tilt": size, "heading": size}
        pair = [prepare_case(LOOSE, initial=same, **fields) for fields in ({}, OPEN)]
        one, other = (errors(prepared_case) for prepared_case in pair)
        differences.append(np.sqrt(np.mean((one - other)[:, -1, 3:6] ** 2)))
    ratios = np.array(differences[1:]) / differences[:-1]
    assert np.all((ratios > 3.0) & (ratios < 5.0)), (differences, ratios)


def test_nothing_that_is_estimated_reaches_the_strapdown():
    """Outputs that are never corrected are those of the inertial system alone."""
    never = prepare_case(LOOSE, **OPEN, logic={**LOGIC, "correct_after": "1 h"})
    np.testing.assert_allclose(errors(never, 8), errors(prepare_case(INERTIAL), 8), rtol=1e-9, atol=1e-9)
    corrected = errors(prepare_case(LOOSE, **OPEN, logic=LOGIC), 8)
    assert np.abs(corrected[:, -1, 6:9]).max() < 0.2 * np.abs(errors(never, 8)[:, -1, 6:9]).max()


def test_linear_covariance_describes_the_open_loop():
    prepared_case, runs = prepare_case(LOOSE, **OPEN), 400
    history, err = covariance(prepared_case), errors(prepared_case, runs)
    at = [int(np.argmin(np.abs(prepared_case.t_hist - t))) for t in (5.0, 15.0, 30.0)]
    ratio = err[:, at].var(axis=0, ddof=1) / history.true_sigma[at, :9] ** 2
    tail = 1e-3 / 2 / ratio.size
    low, high = chi2.ppf([tail, 1.0 - tail], runs - 1) / (runs - 1)
    assert np.all((ratio > low) & (ratio < high)), ratio.round(2)
    np.testing.assert_array_equal(history.true_sigma, covariance(prepare_case(LOOSE)).true_sigma)


LATE = {"start_after": 3, "correct_after": "12 s"}


def test_linear_covariance_describes_outputs_that_are_not_corrected_at_first():
    """The filter starts at 3 s and corrects from 15 s on: before, the outputs are those of the inertial system."""
    prepared_case, runs = prepare_case(LOOSE, **OPEN, logic=LATE), 400
    history, err = covariance(prepared_case), errors(prepared_case, runs)
    at = [int(np.argmin(np.abs(prepared_case.t_hist - t))) for t in (2.0, 10.0, 14.0, 15.0, 25.0)]
    ratio = err[:, at].var(axis=0, ddof=1) / history.true_sigma[at, :9] ** 2
    tail = 1e-3 / 2 / ratio.size
    low, high = chi2.ppf([tail, 1.0 - tail], runs - 1) / (runs - 1)
    assert np.all((ratio > low) & (ratio < high)), ratio.round(2)
    corrected, alone = (covariance(prepare_case(*card, **OPEN)) for card in ((LOOSE,), (INERTIAL,)))
    np.testing.assert_allclose(history.true_sigma[at[2], :9], alone.true_sigma[at[2], :9], rtol=1e-9)
    assert history.true_sigma[at[2], 6:9].max() > 3.0 * corrected.true_sigma[at[2], 6:9].max()


@pytest.mark.parametrize("time", [14.0, 25.0])
def test_budget_and_adjoint_are_those_of_the_outputs_corrected_or_not(time):
    prepared_case = prepare_case(LOOSE, **OPEN, logic=LATE)
    history, hist = covariance(prepared_case), int(np.argmin(np.abs(prepared_case.t_hist - time)))
    variance = history.true_sigma[hist, :9] ** 2
    np.testing.assert_allclose(history.budget[hist, :, :9].sum(axis=0), variance, rtol=1e-9)
    np.testing.assert_allclose(adjoint(prepared_case, time).contribution.sum(axis=(1, 2)), variance, rtol=1e-6)


STOP = {"start_after": 3, "correct_after": "2 s", "stop_after": "4 s"}
LOSS = [{"kind": "satellite_outage", "start": "10 s", "duration": "12 s"}]
STOPS, CORRECTS_AGAIN = 13.0, 26.0  # four epochs without a sample; two more after three good ones


def stopped(after_stop, **logic):
    return prepare_case(LOOSE, **OPEN, logic={**STOP, **logic, "after_stop": after_stop}, faults=LOSS)


def test_a_held_correction_differs_from_the_inertial_system_by_the_estimate_at_the_stop():
    """Sizes, because the reporting axes turn: what is held is what a filter that never stops has estimated then."""
    inertial, held = stopped("inertial"), stopped("held")
    t, alone, out = inertial.t_hist, errors(inertial, 8), errors(held, 8)
    never_stops = errors(stopped("inertial", stop_after="1 h"), 8)
    during = (t >= STOPS) & (t < CORRECTS_AGAIN)
    np.testing.assert_array_equal(out[:, ~during], alone[:, ~during])
    for block in (slice(3, 6), slice(6, 9)):
        apart = np.linalg.norm((alone - out)[:, :, block], axis=2)
        estimate = np.linalg.norm((alone - never_stops)[:, t == STOPS, block], axis=2)
        np.testing.assert_allclose(apart[:, during], np.broadcast_to(estimate, apart[:, during].shape), rtol=1e-6)
    np.testing.assert_allclose(out[:, t == STOPS], never_stops[:, t == STOPS], rtol=1e-9, atol=1e-12)


def test_a_predicted_correction_is_that_of_a_filter_that_predicts_on():
    predicted, inertial = stopped("predicted"), stopped("inertial")
    t, out = predicted.t_hist, errors(predicted, 8)
    during = (t >= STOPS) & (t < CORRECTS_AGAIN)
    lost = (t >= STOPS) & (t < 22.0)  # afterwards a filter that never stops has samples again
    never_stops = errors(stopped("inertial", stop_after="1 h"), 8)
    np.testing.assert_allclose(out[:, lost], never_stops[:, lost], rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(out[:, ~during], errors(inertial, 8)[:, ~during])
    growth = np.diff(out[:, during & (t <= 25.0)], axis=1)
    assert np.abs(growth[:, -1]).max() < 3.0 * np.abs(growth[:, 0]).max()  # no jump when it restarts


@pytest.mark.parametrize("after_stop", ["inertial", "predicted"])
def test_linear_covariance_describes_outputs_after_a_stop(after_stop):
    prepared_case, runs = stopped(after_stop), 400
    history, err = covariance(prepared_case), errors(prepared_case, runs)
    at = [int(np.argmin(np.abs(prepared_case.t_hist - t))) for t in (8.0, 12.0, 16.0, 21.0, 25.0)]
    ratio = err[:, at].var(axis=0, ddof=1) / history.true_sigma[at, :9] ** 2
    tail = 1e-3 / 2 / ratio.size
    low, high = chi2.ppf([tail, 1.0 - tail], runs - 1) / (runs - 1)
    assert np.all((ratio > low) & (ratio < high)), ratio.round(2)
    for hist in at[2:]:
        variance = history.true_sigma[hist, :9] ** 2
        contribution = adjoint(prepared_case, float(prepared_case.t_hist[hist])).contribution.sum(axis=(1, 2))
        np.testing.assert_allclose(contribution, variance, rtol=1e-6)


@jit
def carry_eight(y, blocks, rows, columns, decay, clock, seconds):
    apply_phi(view(y), view(blocks), rows, columns, decay, clock, seconds)


def test_eight_error_states_are_propagated_as_one_is():
    rng, n = np.random.default_rng(5), 17
    rows, columns = np.array([0, 3, 6, 3]), np.array([9, 0, 3, 12])
    y, blocks = rng.standard_normal((n, WIDTH)), rng.standard_normal((4, 9, WIDTH))
    decay = np.concatenate([np.ones(9), rng.uniform(0.5, 1.0, n - 9)])
    one = y.copy()
    carry_eight(y, blocks, rows, columns, decay, 15, 0.1)
    for lane in range(WIDTH):
        alone = one[:, lane].copy()
        apply_phi(alone, blocks[:, :, lane].copy(), rows, columns, decay, 15, 0.1)
        np.testing.assert_allclose(y[:, lane], alone, rtol=1e-14, atol=1e-14)


@pytest.mark.slow  # the kernel of one run by itself
@pytest.mark.parametrize(
    ("coupling", "faults"),
    [
        (LOOSE, {"kind": "wild_samples", "start": "12 s", "duration": "3 s", "sigma": "120 m"}),
        (TIGHT, {"kind": "satellite_outage", "start": "12 s", "duration": "3 s"}),
    ],
)
def test_a_run_is_the_same_alone_and_among_eight(coupling, faults):
    prepared_case = prepare_case(coupling, faults=[faults], **OPEN, logic=LOGIC)
    eight, one = run_block(prepared_case, 3, 0, 8), run_block(prepared_case, 3, 5, 1, uses_lanes=False)
    np.testing.assert_allclose(one.err[0], eight.err[5], rtol=1e-7, atol=1e-9)
    np.testing.assert_array_equal(one.changes, eight.changes[eight.changes[:, 0] == 5])
    assert len(one.changes) >= 2


# ---------------------------------------------------------------------------- every rule, by a fault and by its absence


@lru_cache(maxsize=32)
def story(*, fault=None, **changed):
    """Return the first run's changes as (t, after, reason), all runs having the same, and the block."""
    prepared_case = prepare_case(LOOSE, faults=[dict(fault)] if fault else [], **OPEN, logic={**LOGIC, **changed})
    block = run_block(prepared_case, 3, 0, 16)
    reported = [
        [(t, MODES[int(after)], REASONS[int(why)]) for run, t, _, after, why in block.changes if run == k]
        for k in range(16)
    ]
    assert all(one == reported[0] for one in reported)
    return reported[0], block


def fault(kind, start=12, duration=3, **more):
    return tuple({"kind": kind, "start": f"{start} s", "duration": f"{duration} s", **more}.items())


NORMAL = [(3.0, "converging", "good samples in a row"), (7.0, "aiding", "converged")]


def test_undisturbed_it_starts_converges_and_aids():
    changes, block = story()
    assert changes == NORMAL
    assert np.all(block.n_row[:, :2] == 0)
    assert np.all(block.n_row[:, 3:] == 6)


@pytest.mark.parametrize(
    ("failed", "check", "reason"),
    [
        (fault("invalid_output"), "checksum", "checksum"),
        (fault("invalid_output", flag="hardware"), "hardware", "hardware"),
        (fault("invalid_output", flag="time_sync"), "time_sync", "time synchronisation"),
        (fault("frozen_output"), "fresh", "no fresh solution"),
    ],
)
def test_flags_and_stale_samples_are_left_out_and_without_the_rule_assumed(failed, check, reason):
    changes, block = story(fault=failed, wild_position=None, wild_velocity=None)
    assert changes[2:] == [(12.0, "predicting", reason), (15.0, "aiding", "data again")]
    assert np.all(block.n_row[:, 11:14] == 0)
    others = tuple(name for name in CHECKS if name != check)
    ignored, block = story(fault=failed, check_flags=others, wild_position=None, wild_velocity=None)
    assert ignored == NORMAL
    assert np.all(block.n_row[:, 11:14] == 6)


def test_bad_geometry_is_left_out_and_without_the_rule_assumed():
    """Four satellites that are the highest: a greater dilution of precision than with all."""
    few = fault("satellite_outage", keep=4)
    assert story(fault=few, pdop_below=2.0)[0][2:] == [
        (12.0, "predicting", "dilution of precision"), (15.0, "aiding", "data again"),
    ]  # fmt: skip
    assert story(fault=few, pdop_below=None)[0] == NORMAL


def test_three_satellites_are_no_solution():
    assert story(fault=fault("satellite_outage", keep=3))[0][2] == (12.0, "predicting", "data lost")


def test_wild_samples_are_left_out_and_without_the_rule_ruin_the_estimate():
    wild = fault("wild_samples", sigma="30 km")
    changes, block = story(fault=wild)
    assert changes == NORMAL
    assert np.all(block.n_row[:, 11:14] == 0)
    accepted = story(fault=wild, wild_position=None, wild_velocity=None)[1]
    at = int(np.argmin(np.abs(block.t - 14.0)))
    size = [np.abs(b.err[:, at, 6:9]).max() for b in (block, accepted)]
    assert size[0] < 10.0 < 100.0 < size[1]


def test_a_loss_that_persists_stops_it_and_data_start_it_again():
    changes, block = story(fault=fault("satellite_outage", duration=8))
    assert changes[2:] == [
        (12.0, "predicting", "data lost"),
        (15.0, "stopped", "data loss persists"),
        (22.0, "converging", "good samples in a row"),
        (26.0, "aiding", "converged"),
    ]
    at = int(np.argmin(np.abs(block.t - 18.0)))
    inertial = errors(prepare_case(INERTIAL), 16)
    np.testing.assert_allclose(block.err[:, at, :9], inertial[:, at], rtol=1e-9, atol=1e-9)  # aiding has stopped
    assert story(fault=fault("satellite_outage", duration=8), restart_after=())[0][-1][1] == "stopped"
    assert story(fault=fault("satellite_outage", duration=8), stop_after=None)[0][-1] == (20.0, "aiding", "data again")


def test_a_residual_error_that_persists_stops_it():
    wild = fault("wild_samples", duration=6, sigma="30 km")
    assert story(fault=wild)[0][2:4] == [
        (15.0, "stopped", "residual error persists"), (20.0, "converging", "good samples in a row"),
    ]  # fmt: skip
    assert story(fault=wild, restart_after=("data_loss",))[0][-1][1] == "stopped"


def test_a_covariance_out_of_bounds_stops_it():
    """Predicting through a loss, the velocity's sigma outgrows a bound that it keeps with data."""
    loss = fault("satellite_outage", start=10, duration=12)
    long = {"stop_after": "13 s"}
    assert story(fault=loss, **long, restart_after=())[0][-1] == (22.0, "aiding", "data again")
    assert story(fault=None, covariance_velocity="1 mm/s")[0][1][1:] == ("stopped", "covariance error persists")


def test_intermittent_loss_is_bridged():
    faults = [dict(fault("satellite_outage", start=s, duration=2)) for s in (10, 14, 18, 22)]
    block = run_block(prepare_case(LOOSE, faults=faults, **OPEN, logic=LOGIC), 3, 0, 8)
    reasons = {REASONS[int(why)] for why in block.changes[:, 4]}
    assert reasons == {"good samples in a row", "converged", "data lost", "data again"}


def test_started_from_the_receiver_a_bad_start_is_forgotten_at_once():
    """A position known to 10 km at the start, which the filter's own card takes for 1 m."""
    bad = {"position": "10 km", "velocity": "30 m/s"}
    model = {
        "tilt": "0.1 deg", "heading": "0.05 deg", "position": "1 m", "velocity": "0.01 m/s", "clock_bias": "1 m",
        "clock_drift": "1 m/s",
    }  # fmt: skip
    for feedback in ("open", "closed"):
        scenario = prepare_case(LOOSE, initial=bad, init="from_gnss", feedback=feedback).scenario
        card = with_fields(scenario.filter, initial=model)
        known = prepare_hop(scenario.model_copy(update={"filter": card}))
        trusted = prepare_hop(scenario.model_copy(update={"filter": with_fields(card, init="from_card")}))
        good, poor = errors(known, 16), errors(trusted, 16)
        at = int(np.argmin(np.abs(known.t_hist - 3.0)))
        assert np.abs(good[:, at, 6:9]).max() < 30.0
        assert np.abs(poor[:, at, 6:9]).max() > 1000.0


def test_a_tight_filter_checks_ranges_and_bridges_a_loss():
    """Ranges of every satellite are checked: a wild one leaves the epoch's sample out; a loss is predicted through."""
    loss = fault("satellite_outage", duration=3)
    prepared_case = prepare_case(TIGHT, faults=[dict(loss)], **OPEN, logic=LOGIC)
    block = run_block(prepared_case, 3, 0, 8)
    reported = [
        [(t, MODES[int(after)], REASONS[int(why)]) for run, t, _, after, why in block.changes if run == k]
        for k in range(8)
    ]
    assert reported == [[*NORMAL, (12.0, "predicting", "data lost"), (15.0, "aiding", "data again")]] * 8
    assert np.all(block.n_row[:, [0, 1, 11, 12, 13]] == 0)
    np.testing.assert_array_equal(block.n_row[:, 4], 2 * prepared_case.signals.n_used[4])
    apart = run_block(prepare_case(TIGHT, **OPEN, logic={**LOGIC, "wild_position": "3 m"}), 3, 0, 8)
    assert np.all(apart.n_row.sum(axis=1) < block.n_row.sum(axis=1))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["buffered", "extrapolated"])
def test_of_late_measurements_open_and_closed_loop_make_the_same_and_one_run_is_a_lane(kind):
    """A delay of 0.3 s: the open loop compares with the error state of the time of validity, too."""
    small = {"tilt": "0.005 deg", "heading": "0.005 deg", "position": "1 m", "velocity": "0.01 m/s"}
    compensation = {"delay_compensation": {"kind": kind}}
    unit, latency = "base.imu=imu/navigation_matched", "base.receiver.latency=300 ms"
    closed, opened = (prepare_case(LOOSE, unit, latency, initial=small, **compensation, **loop) for loop in ({}, OPEN))
    sigma = covariance(closed).true_sigma[:, :9]
    one, other = run_block(closed, 3, 0, 8), run_block(opened, 3, 0, 8)
    assert np.max(np.abs(one.err - other.err)[:, :, :9] / sigma) < 2e-3
    assert np.abs(one.err[:, -1, :9] / sigma[-1]).max() > 0.5
    alone = run_block(opened, 3, 5, 1, uses_lanes=False)
    assert np.max(np.abs(alone.err[0] - other.err[5]) / other.sigma[5]) < 1e-8


def test_what_is_asked_of_the_logic_must_make_sense():
    tight, loose = loaded(TIGHT), loaded(LOOSE)
    for scenario, fields, reported in (
        (tight, {"init": "from_gnss"}, "filter.init: a start from GNSS takes position and velocity"),
        (loaded(INERTIAL), {"logic": {}}, "filter.logic: a mode logic checks what the receiver measures"),
        (loose, {"logic": {"correct_after": "10 s"}}, "needs feedback: open"),
        (loose, {"logic": {"after_stop": "held", "stop_after": "50 s"}}, "it needs feedback: open"),
        (loose, {"feedback": "open", "logic": {"after_stop": "held"}}, "state stop_after"),
        (
            loose,
            {"feedback": "open", "algorithm": "unscented", "logic": {"after_stop": "predicted", "stop_after": "50 s"}},
            "choose held",
        ),
        (loose, {"feedback": "open", "logic": {"after_stop": "kept", "stop_after": "50 s"}}, "'held'"),
        (loose, {"logic": {"start_after": 0}}, "greater than or equal to 1"),
        (loose, {"logic": {"wild_position": "0 m"}}, "greater than 0"),
        (loose, {"logic": {"restart_after": ["boredom"]}}, "data_loss"),
    ):
        with pytest.raises(ValueError, match=reported):
            with_fields(scenario, **{f"filter.{name}": value for name, value in fields.items()})
    assert with_fields(tight, **{"filter.logic": {}}).filter.logic is not None
