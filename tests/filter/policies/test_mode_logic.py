"""The watch of a filter: every rule by a sample that breaks it, and by its absence."""

from __future__ import annotations

from collections import namedtuple

import numpy as np
import pytest

from lvnav_trade.filter.policies.mode_logic import (
    CONVERGED,
    COUNT,
    COVARIANCE_PERSISTS,
    DATA_AGAIN,
    DATA_LOST,
    GOOD_SAMPLES,
    HELD,
    INERTIAL,
    LOSS_PERSISTS,
    MODE,
    PREDICTED,
    RESIDUAL_PERSISTS,
    ModeRules,
    ModeState,
    begin_mode_logic,
    check_measurements,
    hold_correction,
    is_correcting,
    is_running,
    new_mode_state,
    start_filter,
    update_mode,
)
from lvnav_trade.filter.policies.policy_cards import AFTER_STOP, CHECKS
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import WIDTH, number_like, view, where
from lvnav_trade.kernels.transition import POS, VEL
from lvnav_trade.quantities.records import AIDING, CONVERGING, FIRST_CHECK, MODES, PREDICTING, REASONS, STOPPED, WAITING

N_EPOCH, N = 60, 9
# As much of the filter and of the measurements as says which channel a row is of.
FilterModel = namedtuple("FilterModel", "tight is_processed n_observable")
Signals = namedtuple("Signals", "satellite_by_slot")
Present = namedtuple("Present", "is_present")  # of what a filter knows of differences
P0 = np.diag([1e-6] * 3 + [4.0] * 3 + [100.0] * 3)
SIGMA = 5.0
VARIANCE = np.array([SIGMA**2] * 3 + [0.01] * 3)
LOOSE, NO_RANGES = FilterModel(False, np.ones(6, dtype=bool), 2), Signals(np.zeros((N_EPOCH, 0), dtype=np.int64))


def rules(**changed):
    """Five samples, 10 s to converge, 6 s of error; all on."""
    every = ModeRules(
        interval=1.0,
        is_good=np.ones(N_EPOCH, dtype=bool),
        residual_limits=np.array([100.0] * 3 + [10.0] * 3),
        variance_limits=np.array([1e4] * 3 + [1e2] * 3),
        start_after=5.0,
        correct_after=10.0,
        stop_after=6.0,
        after_stop=INERTIAL,
        restarts=np.ones(3),
        from_gnss=False,
        start_covariance=P0.copy(),
    )
    return every._replace(**changed)


@jit
def epoch_of(mode_state, rules, model, signals, epoch, P, x, z, grown, variance):
    """One epoch as the filter goes through it; without an update: the error state stays, the covariance is given."""
    for i in range(P.shape[0]):
        P[i, i] = P[i, i] + grown
    for row in range(6):
        mode_state.predicted_innovation[row] = x[6 + row] if row < 3 else x[row]
    check_measurements(mode_state, rules, None, model, signals, epoch, z, 6)
    if rules.is_good[epoch]:
        for row in range(6):
            mode_state.predicted_innovation[row] = variance[row]
        start_filter(P, x, mode_state, rules, z)
    update_mode(mode_state, rules, epoch, P)


def run(settings, z=None, broken=()):
    """Return the log of a run: (epoch, before, after, reason) of every change, and what was used at each epoch."""
    mode_state = new_mode_state(N_EPOCH)
    begin_mode_logic(mode_state)
    P, x, used = P0.copy(), np.zeros(N), []
    z = np.zeros((N_EPOCH, 6)) if z is None else z
    for epoch in range(N_EPOCH):
        grown = np.nan if epoch in broken else 0.0
        epoch_of(mode_state, settings, LOOSE, NO_RANGES, epoch, P, x, z[epoch], grown, VARIANCE)
        used.append(bool(mode_state.sample[0]))
        if epoch in broken:
            P[:] = P0
    mode = mode_state.mode.astype(int)
    before = np.concatenate([[WAITING], mode[:-1]])
    changes = [
        (k, MODES[before[k]], MODES[mode[k]], REASONS[int(mode_state.reason[k])])
        for k in np.flatnonzero(mode != before)
    ]
    assert np.array_equal(np.flatnonzero(mode_state.reason), np.flatnonzero(mode != before))
    return changes, np.array(used), P, x


def lost(*spans):
    good = np.ones(N_EPOCH, dtype=bool)
    for first, end in spans:
        good[first:end] = False
    return good


def wild(*spans, size=1000.0):
    """A residual on every axis that differs from sample to sample."""
    z = np.zeros((N_EPOCH, 6))
    for first, end in spans:
        z[first:end] = size * np.arange(1, end - first + 1)[:, None]
    return z


START = (4, "waiting", "converging", "good samples in a row")
CONVERGE = (14, "converging", "aiding", "converged")


def test_undisturbed_it_starts_after_five_samples_and_corrects_after_the_time_to_converge():
    changes, used, _, _ = run(rules())
    assert changes == [START, CONVERGE]
    assert used.tolist() == [False] * 4 + [True] * (N_EPOCH - 4)


def test_without_the_rule_the_first_sample_starts_it_and_it_corrects_at_once():
    changes, used, _, _ = run(rules(start_after=1.0, correct_after=0.0))
    assert changes == [(0, *START[1:]), (1, *CONVERGE[1:])]
    assert used.all()


def test_a_missed_sample_starts_the_count_anew():
    assert run(rules(is_good=lost((3, 4))))[0][0] == (8, *START[1:])
    assert run(rules(is_good=lost((3, 4)), start_after=3.0))[0][0] == (2, *START[1:])


def test_samples_that_do_not_agree_with_each_other_do_not_start_it():
    z = wild((2, 9))
    assert run(rules(), z)[0][0] == (13, *START[1:])  # the sample at 9 is the first that has a like one after it
    assert run(rules(residual_limits=np.full(6, np.inf)), z)[0][0] == START


def test_a_loss_before_convergence_lets_it_wait_again():
    changes, _, _, _ = run(rules(is_good=lost((8, 9))))
    assert changes[:3] == [START, (8, "converging", "waiting", "data lost"), (13, *START[1:])]


def test_a_short_loss_after_convergence_is_bridged_by_prediction():
    changes, used, _, _ = run(rules(is_good=lost((20, 24))))
    assert changes == [
        START, CONVERGE, (20, "aiding", "predicting", "data lost"), (24, "predicting", "aiding", "data again"),
    ]  # fmt: skip
    assert not used[20:24].any()
    assert used[24:].all()


def test_a_loss_that_persists_stops_it_and_it_starts_again_with_good_samples():
    changes, _, _, _ = run(rules(is_good=lost((20, 32))))
    assert changes[2:] == [
        (20, "aiding", "predicting", "data lost"),
        (25, "predicting", "stopped", "data loss persists"),  # the sixth second without a sample
        (36, "stopped", "converging", "good samples in a row"),
        (46, "converging", "aiding", "converged"),
    ]


def test_where_it_may_not_start_again_it_stays_stopped():
    changes, used, _, _ = run(rules(is_good=lost((20, 32)), restarts=np.array([0.0, 1.0, 1.0])))
    assert changes[-1] == (25, "predicting", "stopped", "data loss persists")
    assert not used[25:].any()


def test_without_a_limit_of_time_a_long_loss_does_not_stop_it():
    changes, _, _, _ = run(rules(is_good=lost((20, 50)), stop_after=np.inf))
    assert changes[-1] == (50, "predicting", "aiding", "data again")


def test_intermittent_losses_never_last_long_enough():
    changes, used, _, _ = run(rules(is_good=lost(*[(k, k + 5) for k in range(16, 58, 6)])))
    assert "stopped" not in [after for _, _, after, _ in changes]
    assert used[16:].sum() == len(range(16, N_EPOCH)) - 5 * 7


def test_a_wild_sample_is_left_out_and_nothing_else_happens():
    changes, used, _, _ = run(rules(), wild((20, 23)))
    assert changes == [START, CONVERGE]
    assert np.flatnonzero(~used[4:]).tolist() == [16, 17, 18]


@pytest.mark.parametrize("row", range(6))
def test_one_wild_axis_is_enough(row):
    z = np.zeros((N_EPOCH, 6))
    z[20, row] = 101.0 if row < 3 else 10.1
    assert not run(rules(), z)[1][20]
    z[20, row] = -99.0 if row < 3 else -9.9
    assert run(rules(), z)[1][20]


def test_without_a_limit_a_wild_sample_is_assumed():
    assert run(rules(residual_limits=np.full(6, np.inf)), wild((20, 23)))[1][4:].all()


def test_a_residual_error_that_persists_stops_it_and_normal_samples_start_it_again():
    changes, _, _, _ = run(rules(), wild((20, 32)))
    assert changes[2:4] == [
        (25, "aiding", "stopped", "residual error persists"),
        (36, "stopped", "converging", "good samples in a row"),
    ]
    assert run(rules(restarts=np.array([1.0, 0.0, 1.0])), wild((20, 32)))[0][-1][2] == "stopped"


def test_a_covariance_error_that_persists_stops_it_whatever_its_kind():
    changes, _, _, _ = run(rules(), broken=range(20, 32))
    assert changes[2] == (25, "aiding", "stopped", "covariance error persists")
    assert changes[3] == (26, "stopped", "converging", "good samples in a row")  # samples were good all along
    assert run(rules(restarts=np.array([1.0, 1.0, 0.0])), broken=range(20, 32))[0][-1][2] == "stopped"
    bounded = rules(variance_limits=np.full(6, 3.9))  # below what the velocity has at the start
    assert run(bounded)[0][1] == (9, "converging", "stopped", "covariance error persists")
    assert run(rules(variance_limits=np.full(6, np.inf)))[0] == [START, CONVERGE]


def test_a_start_sets_error_state_and_covariance_and_from_gnss_takes_the_sample():
    z = np.tile([3.0, -2.0, 1.0, 0.1, 0.2, 0.3], (N_EPOCH, 1))
    _, used, P, x = run(rules(), z)
    np.testing.assert_array_equal(x, 0.0)  # nothing is processed in this test
    assert used[4]
    _, used, P, x = run(rules(from_gnss=True), z)
    assert not used[4]  # the sample is not used twice
    np.testing.assert_array_equal(x[POS : POS + 3], z[0, :3])
    np.testing.assert_array_equal(x[VEL : VEL + 3], z[0, 3:])
    np.testing.assert_array_equal(np.diag(P)[POS : POS + 3], SIGMA**2)
    np.testing.assert_array_equal(np.diag(P)[VEL : VEL + 3], 0.01)
    assert np.count_nonzero(P - np.diag(np.diag(P))) == 0


@jit
def has_covariance(mode_state, rules, model, signals, epoch, z, n_row):
    check_measurements(mode_state, rules, None, model, signals, epoch, z, n_row)


def test_ranges_are_checked_by_the_channels_of_their_satellites():
    """Three satellites, two in use, another order in the second epoch: each row has the limit of its own channel and is
    compared with that channel's sample before; a channel that the filter does not process is not looked at.
    """
    taken = np.ones(6, dtype=bool)
    taken[5] = False  # the range rate of the third satellite
    model, signals = FilterModel(True, taken, 2), Signals(np.array([[0, 2, 0], [2, 0, 0], [0, 1, 0]]))
    limits = np.array([10.0, 1.0, 10.0, 1.0, 10.0, 1.0])
    settings, mode_state = rules(residual_limits=limits, start_after=2.0), new_mode_state(3, 6, 6)
    begin_mode_logic(mode_state)
    samples = [[100.0, 5.0, 300.0, 7.0], [301.0, 99.0, 101.0, 5.5], [102.0, 5.0, 50.0, 2.0]]
    for epoch, values in enumerate(samples):
        z = np.array([*values, 0.0, 0.0])
        has_covariance(mode_state, settings, model, signals, epoch, z, 4)
        assert mode_state.state[COUNT] == epoch + 1.0
        assert mode_state.sample[1] == (1.0 if epoch else 0.0)
    np.testing.assert_array_equal(mode_state.previous_innovation, [102.0, 5.0, 50.0, 2.0, 301.0, np.nan])
    apart = np.array([113.0, 5.0, 50.0, 2.0, 0.0, 0.0])
    has_covariance(mode_state, settings, model, signals, 2, apart, 4)
    assert mode_state.state[COUNT] == 1.0


def test_a_difference_that_is_not_there_is_not_checked():
    """A row that an epoch lacks holds what an earlier one has left, here no number."""
    model, signals = FilterModel(True, np.ones(2, dtype=bool), 2), Signals(np.array([[0]]))
    z = np.array([1.0, np.nan])
    for present, count in ((False, 1.0), (True, 0.0)):
        settings, mode_state = rules(residual_limits=np.full(2, np.inf)), new_mode_state(1, 2, 2)
        begin_mode_logic(mode_state)
        mode_state.state[MODE] = AIDING
        here = np.array([[True, present]])
        check_measurements(mode_state, settings, Present(here), model, signals, 0, z, 2)
        assert mode_state.sample[0] == count


def test_it_runs_and_corrects_in_the_modes_that_are_named_so():
    assert [is_running(float(mode)) for mode in range(5)] == [0.0, 1.0, 1.0, 1.0, 0.0]
    assert [is_correcting(float(mode)) for mode in range(5)] == [0.0, 0.0, 1.0, 1.0, 0.0]
    assert (len(MODES), len(REASONS)) == (5, FIRST_CHECK + len(CHECKS) + 1)
    assert FIRST_CHECK == 8  # after these codes the checks at the input, and the dilution of precision
    codes = (GOOD_SAMPLES, CONVERGED, DATA_LOST, DATA_AGAIN, LOSS_PERSISTS, RESIDUAL_PERSISTS, COVARIANCE_PERSISTS)
    assert codes == tuple(range(1, 8))
    assert (WAITING, CONVERGING, AIDING, PREDICTING, STOPPED) == tuple(range(5))


@jit
def eight(w, rules, model, signals, P, x, z, gates, variance):
    mode_state = ModeState(
        view(w.state), view(w.previous_innovation), view(w.z), view(w.predicted_innovation), view(w.sample),
        view(w.mode), view(w.reason), view(w.held_correction),
    )  # fmt: skip
    Pv, xv, zv, gv = view(P), view(x), view(z), view(gates)
    begin_mode_logic(mode_state)
    for epoch in range(rules.is_good.shape[0]):
        sample = zv[epoch]
        for row in range(6):
            mode_state.predicted_innovation[row] = xv[6 + row] if row < 3 else xv[row]
        check_measurements(mode_state, rules, None, model, signals, epoch, sample, 6)
        if rules.is_good[epoch]:
            for row in range(6):
                mode_state.predicted_innovation[row] = number_like(xv[0], variance[row])
            start_filter(Pv, xv, mode_state, rules, sample)
        gv[epoch] = where(mode_state.sample[0] > 0.0, np.inf, -1.0)
        update_mode(mode_state, rules, epoch, Pv)


def test_eight_runs_go_their_own_ways():
    settings = rules(is_good=lost((40, 43)))
    samples = np.zeros((N_EPOCH, 6, WIDTH))
    for lane in range(WIDTH):
        samples[:, :, lane] = wild((15 + lane, 15 + 2 * lane))
    w = new_mode_state(N_EPOCH, lanes=WIDTH)
    P, x = np.repeat(P0[:, :, None], WIDTH, axis=2), np.zeros((N, WIDTH))
    gates = np.zeros((N_EPOCH, WIDTH))
    eight(w, settings, LOOSE, NO_RANGES, P, x, samples, gates, VARIANCE)
    for lane in range(WIDTH):
        changes, used, _, _ = run(settings, samples[:, :, lane])
        mode = w.mode[:, lane].astype(int)
        at = np.flatnonzero(np.diff(mode, prepend=WAITING))
        assert [(k, MODES[mode[k]], REASONS[int(w.reason[k, lane])]) for k in at] == [
            (k, after, why) for k, _, after, why in changes
        ]
        np.testing.assert_array_equal(gates[:, lane], np.where(used, np.inf, -1.0))
    assert len({tuple(w.mode[:, lane]) for lane in range(WIDTH)}) > 2
    assert w.state[MODE].shape == w.state[COUNT].shape == (WIDTH,)


@pytest.mark.parametrize("after_stop", [INERTIAL, HELD, PREDICTED])
def test_what_corrects_the_outputs_is_held_and_nothing_else(after_stop):
    mode_state, settings = new_mode_state(N_EPOCH, n_state=N), rules(after_stop=after_stop)
    begin_mode_logic(mode_state)
    assert not mode_state.held_correction.any()
    for mode in (WAITING, CONVERGING, AIDING, PREDICTING, STOPPED, WAITING, CONVERGING, AIDING):
        before, x = mode_state.held_correction.copy(), np.full(N, 1.0 + mode)
        mode_state.state[MODE] = mode
        hold_correction(mode_state, settings, x)
        held = after_stop != INERTIAL and mode in (AIDING, PREDICTING)
        np.testing.assert_array_equal(mode_state.held_correction, x if held else before)
    begin_mode_logic(mode_state)
    assert not mode_state.held_correction.any()


def test_outputs_after_a_stop_have_the_numbers_of_the_card():
    assert AFTER_STOP == ("inertial", "held", "predicted")
    assert (INERTIAL, HELD, PREDICTED) == tuple(range(len(AFTER_STOP)))
