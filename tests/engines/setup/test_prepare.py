"""What both engines share: windows of the flight, signals on their ticks, the start and the record."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.engines.setup.prepare import reporting_axes
from lvnav_trade.engines.simulate.montecarlo import run_block
from lvnav_trade.frames import rotation_i_n, rotation_i_o
from lvnav_trade.kernels.attitude import matrix
from lvnav_trade.world.flight.trajectory import motion
from tests.building import MATCHED, case, hop, loaded, prepare_hop, with_fields


def prepared_with(history=1.0, **filter_fields):
    scenario = loaded()
    card = with_fields(scenario.filter, **filter_fields)
    return prepare_hop(scenario.model_copy(update={"filter": card}), history=history)


CUTS = [(10.0, 1.0, 1.0), (3.0, 1.0, 1.0), (10.0, 3.0, 1.0), (7.0, 2.0, 0.35), (200.0, 1.0, 0.1), (0.5, 4.0, 1.0)]


@pytest.mark.parametrize(("covariance_rate", "update_rate", "history"), CUTS)
def test_windows_tile_the_flight_and_end_at_every_epoch_and_history_time(covariance_rate, update_rate, history):
    prepared = prepared_with(history, covariance_rate=f"{covariance_rate} Hz", update_rate=f"{update_rate} Hz")
    schedule, n_imu = prepared.schedule, prepared.reference.dtheta.shape[0]
    ends = schedule.first_tick + schedule.n_tick
    assert ends[-1] == n_imu
    np.testing.assert_array_equal(schedule.first_tick[1:], ends[:-1])
    assert schedule.n_tick.max() <= round(200.0 / covariance_rate)
    for column, times in ((schedule.epoch, prepared.t_epoch), (schedule.hist, prepared.t_hist)):
        at = column >= 0
        np.testing.assert_array_equal(column[at], np.arange(times.size))
        # an event may lie between ticks: the nearest stands for it
        assert np.abs(prepared.reference.t[ends[at]] - times).max() <= 0.5 / 200.0 + 1e-9
    np.testing.assert_allclose(prepared.lengths[schedule.length] * 200.0, schedule.n_tick, atol=1e-9)


@pytest.mark.parametrize("update_rate", [1.0, 3.0, 7.0])
def test_measurements_are_taken_on_ticks_where_the_increments_end(update_rate):
    prepared = prepared_with(update_rate=f"{update_rate} Hz")
    schedule, signals = prepared.schedule, prepared.signals
    ticks = (schedule.first_tick + schedule.n_tick)[schedule.epoch >= 0]
    # no lever arm: the antenna is at the unit; a float64 at 7e6 m counts in 1e-9 m
    np.testing.assert_allclose(signals.position, prepared.reference.r_i[ticks], rtol=0, atol=1e-7)
    np.testing.assert_allclose(signals.velocity, prepared.reference.v_i[ticks], rtol=0, atol=1e-9)
    assert prepared.t_epoch.size == pytest.approx(30 * update_rate, abs=1)


def test_history_holds_the_grid_and_every_event_once():
    prepared = prepared_with(history=0.7)
    expected = np.union1d(np.arange(43) * 0.7, list(hop().events.values()))
    np.testing.assert_allclose(prepared.t_hist, expected, atol=1e-12)


def test_the_antenna_is_at_the_lever_arm_and_swings_with_the_body():
    scenario = loaded()
    lever = np.array([1.0, -2.0, 3.0])
    receiver = with_fields(scenario.receiver, lever_b=[f"{x} m" for x in lever])
    prepared = prepare_hop(scenario.model_copy(update={"receiver": receiver}))
    at = motion(hop(), prepared.t_epoch)
    C = np.array([np.reshape(matrix(*q), (3, 3)) for q in at.q_b_i])
    np.testing.assert_allclose(prepared.signals.position, at.r_i + C @ lever, rtol=0, atol=1e-8)
    # the derivative of the position, by differences of 0.01 s: its third derivative, 0.1 m/s^3, leaves 2e-6 m/s
    ends = [motion(hop(), prepared.t_epoch[:-1] + dt) for dt in (-0.01, 0.01)]
    where = [a.r_i + np.array([np.reshape(matrix(*q), (3, 3)) for q in a.q_b_i]) @ lever for a in ends]
    quiet = np.abs(prepared.t_epoch[:-1] - 20.0) > 0.1  # not where the boost ends
    slope = (where[1] - where[0]) / 0.02
    np.testing.assert_allclose(prepared.signals.velocity[:-1][quiet], slope[quiet], rtol=0, atol=1e-5)


def test_range_and_range_rate_are_those_of_the_geometry():
    signals = case().signals
    line = signals.satellite - signals.position[:, None]
    distance = np.linalg.norm(line, axis=2)
    np.testing.assert_allclose(signals.range, distance, rtol=1e-15)
    relative = signals.satellite_velocity - signals.velocity[:, None]
    np.testing.assert_allclose(signals.rate, np.einsum("esi,esi->es", line / distance[..., None], relative), rtol=1e-12)


def test_slots_hold_the_tracked_satellites_and_nothing_else():
    prepared = case()
    for epoch, slots in enumerate(prepared.signals.used):
        used = slots[: prepared.signals.n_used[epoch]]
        np.testing.assert_array_equal(np.sort(used), np.flatnonzero(prepared.sky.tracked[epoch]))


def test_the_start_of_a_matched_filter_is_the_true_spread():
    """Tilt about north and east, heading about down; the filter's covariance is the true one, frame i."""
    prepared = case(MATCHED)
    initial, C_i_n = prepared.scenario.initial, reporting_axes(
        "ned", prepared.reference.t[:1], prepared.reference.r_i[:1], prepared.reference.v_i[:1], hop().theta0
    )[0]  # fmt: skip
    attitude = prepared.start.roots[0] @ prepared.start.roots[0].T
    expected = np.diag([initial.tilt, initial.tilt, initial.heading]) ** 2
    np.testing.assert_allclose(C_i_n @ attitude @ C_i_n.T, expected, rtol=1e-12, atol=1e-20)
    np.testing.assert_allclose(prepared.start.P[:3, :3], attitude, rtol=1e-12, atol=1e-20)


@pytest.mark.parametrize("frame", ["ned", "ecef", "inertial", "orbital"])
def test_reporting_axes_are_rotations_of_the_named_frame(frame):
    prepared = prepare_hop(with_fields(loaded(), frame=frame))
    axes, record = prepared.record.axes, prepared.record
    np.testing.assert_allclose(axes @ np.swapaxes(axes, 1, 2), np.tile(np.eye(3), (len(axes), 1, 1)), atol=1e-14)
    theta = hop().theta0 + 7.292115e-5 * prepared.t_hist
    expected = {
        "inertial": np.tile(np.eye(3), (len(axes), 1, 1)),
        "orbital": rotation_i_o(record.r, record.v),
        "ned": rotation_i_n(record.r, theta),
    }
    if frame == "ecef":
        rotated = axes @ np.array([1.0, 0.0, 0.0])
        np.testing.assert_allclose(rotated, np.stack([np.cos(theta), -np.sin(theta), 0 * theta], axis=1), atol=1e-14)
    else:
        np.testing.assert_allclose(axes, expected[frame], atol=1e-12)


def test_the_truth_of_the_record_is_the_reference_at_its_ticks():
    prepared = case()
    schedule = prepared.schedule
    ticks = (schedule.first_tick + schedule.n_tick)[schedule.hist >= 0]
    np.testing.assert_array_equal(prepared.record.r, prepared.reference.r_i[ticks])
    np.testing.assert_array_equal(prepared.record.q, prepared.reference.q_b_i[ticks])


def test_the_units_noise_per_tick_follows_from_its_root_density():
    prepared = case(MATCHED)
    gyro, accel = prepared.scenario.imu.gyro, prepared.scenario.imu.accel
    expected = [gyro.random_walk * np.sqrt(0.005), accel.random_walk * np.sqrt(0.005)]
    np.testing.assert_allclose(prepared.unit.white[[0, 3]], expected, rtol=1e-14)


def test_a_strapdown_at_a_quarter_of_the_units_rate_steps_over_four_ticks_and_stays_near_the_truth():
    slow, full = (case(f"base.filter.strapdown.ratio={ratio}") for ratio in (4, 1))
    assert (slow.model.strapdown.subsamples, full.model.strapdown.subsamples) == (4, 1)
    assert np.all(slow.schedule.n_tick % 4 == 0)
    runs = [run_block(one, 3, 0, 8) for one in (slow, full)]
    # The draws are the same, so what differs is the algorithm: two-sample coning and sculling over 20 ms of a flight
    # that turns at some 0.1 rad/s leave far less than the noise of the fixes.
    at_end = [one.err[:, -1, 6:9] for one in runs]
    np.testing.assert_allclose(at_end[0], at_end[1], rtol=0, atol=0.2 * float(runs[1].sigma[0, -1, 6]))
    assert not np.array_equal(at_end[0], at_end[1])
