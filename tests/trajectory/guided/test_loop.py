"""The closed loop against closed forms: oscillator, noise through gain and lag, envelopes, attitude, thrusters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.quantities.shared_cards import steady_ratio
from lvnav_trade.simulation.preparation.vehicle_model import envelopes
from lvnav_trade.trajectory.control_cards import FeedbackCard, Guidance, rate_noise
from lvnav_trade.trajectory.guided.autopilot import (
    AIR,
    ERROR,
    FORMAL,
    INSIDE_JERK,
    INSIDE_TURNING,
    JERK_BOUND,
    MOVED,
    NOZZLE,
    NOZZLE_COMMAND,
    RATE_ERROR,
    STEPPED,
    TICKS,
    TURNING,
    TURNING_BOUND,
)
from tests.trajectory.guided.launches import design, fly_steady, steady_launch

IDEAL = {"time_constant": "0.0001 s", "rate_limit": "100000 deg/s", "deflection_limit": "50 deg"}
PERFECT = FeedbackCard(rate="true", attitude="true", noise="none")


def fly_loop(launch, feedback=PERFECT, runs=1, **how):
    return fly_steady(launch, feedback, runs, record_interval=1, **how)


@pytest.mark.parametrize(("frequency", "damping"), [(2.0, 0.3), (2.0, 0.7), (4.0, 0.5)])
def test_gains_give_the_natural_frequency_and_damping_of_the_closed_form(frequency, damping):
    # A step of the commanded attitude: overshoot exp(-pi z / sqrt(1 - z^2)) after pi / (w sqrt(1 - z^2)).
    launch = steady_launch(gains=design(frequency, damping), nozzle=IDEAL, turn=(0.01, 0.0))
    mission = fly_loop(launch)
    error = mission.history[0, :, 0, ERROR] / 0.01
    peak = int(np.argmax(error))
    damped = frequency * math.sqrt(1.0 - damping**2)
    # holding a command for a tick of 5 ms delays by half of it: the phase costs frequency x 2.5 ms of damping
    assert mission.t[peak] == pytest.approx(math.pi / damped, rel=0.02)
    assert error[peak] == pytest.approx(math.exp(-math.pi * damping * frequency / damped), abs=0.02)
    assert np.abs(mission.history[0, -1, 0, ERROR]) < 1e-4
    assert not mission.history[0, :, 1, ERROR].any()  # yaw does not move


def test_an_unstable_body_is_held_and_its_integral_takes_the_wind_out():
    launch = steady_launch(
        60.0, gains={**design(2.5, 0.8, instability=2.0), "integral": "0.4 1/s"}, moment=0.004,
        force=0.04, wind=(10.0, 0.0),
    )  # fmt: skip
    error = fly_loop(launch).history[0, :, 0, ERROR]
    assert np.max(np.abs(error)) < math.radians(3.0)
    assert abs(error[-1]) < 0.02 * np.max(np.abs(error))


def test_a_nozzle_never_exceeds_its_limits_however_hard_it_is_driven():
    launch = steady_launch(gains={"attitude": 5.0, "rate": "3 s"}, turn=(0.4, -0.4))
    mission = fly_loop(launch, FeedbackCard(rate="raw", noise="published"))
    nozzle, plant = mission.history[0, :, :, NOZZLE], launch.rotation.nozzle
    assert np.max(np.abs(nozzle)) <= plant.deflection_limit * (1.0 + 1e-12)
    assert np.max(np.abs(nozzle)) > 0.99 * plant.deflection_limit
    assert np.max(np.abs(np.diff(nozzle, axis=0))) <= plant.rate_limit / 200.0 * (1.0 + 1e-12)
    movement = np.abs(np.diff(nozzle, axis=0)).sum(axis=0)
    np.testing.assert_allclose(mission.history[0, -1, :, MOVED], movement, rtol=1e-9)


def test_white_noise_moves_the_nozzle_as_a_lag_of_white_noise_says(record_property):
    # y' = a y + (1 - a) u with white u of sigma s: steps of sigma s (1 - a) sqrt(2 / (1 + a)), mean size sqrt(2/pi) of
    # it. The body answers far more slowly (gain x effectiveness = 0.01 rad/s), so that the loop is open.
    launch = steady_launch(100.0, gains={"attitude": 0.0, "rate": "1 s"}, effectiveness=0.01)
    raw = fly_loop(launch, FeedbackCard(rate="raw", attitude="true", noise="published"), runs=4)
    a = math.exp(-0.005 / 0.035)
    sigma = rate_noise(launch.imu, "published")
    rate = math.sqrt(2.0 / math.pi) * sigma * (1.0 - a) * math.sqrt(2.0 / (1.0 + a)) * 200.0
    measured = raw.movement.mean() / 100.0
    record_property("nozzle movement by raw noise: computed over closed form", f"{measured / rate:.4f}")
    # 160,000 steps of a lag seven ticks long: a standard deviation of about 0.4 %
    assert measured == pytest.approx(rate, rel=0.012)


def test_the_filtered_rate_has_the_error_of_the_closed_form_and_moves_the_nozzle_as_two_lags_say(record_property):
    launch = steady_launch(100.0, gains={"attitude": 0.0, "rate": "1 s"}, effectiveness=0.01)
    mission = fly_loop(launch, FeedbackCard(rate="filtered", attitude="true", noise="published"), runs=4)
    noise = rate_noise(launch.imu, "published")
    ratio = steady_ratio((0.02 / 200.0) ** 2, noise**2)
    assert mission.history[0, -1, 0, FORMAL] == pytest.approx(math.sqrt(ratio) * noise, rel=1e-9)
    # The rate does not drift here: white noise through the gain K alone has variance K / (2 - K).
    error = mission.history[:, 2000:, :, RATE_ERROR].std()
    assert error == pytest.approx(noise * math.sqrt(ratio / (2.0 - ratio)), rel=0.05)
    # Two lags in a row, poles a and b: the nozzle's steps are white noise through K (1-a) (1 - z) / ((1-az)(1-bz)).
    a, b = math.exp(-0.005 / 0.035), 1.0 - ratio
    k = np.arange(4000)
    impulse = ratio * (1.0 - a) * (a ** (k + 1) - b ** (k + 1)) / (a - b)
    step = np.diff(impulse, prepend=0.0)
    rate = math.sqrt(2.0 / math.pi) * noise * math.sqrt(step @ step) * 200.0
    measured = mission.movement.mean() / 100.0
    record_property("nozzle movement by filtered noise: computed over closed form", f"{measured / rate:.4f}")
    assert measured == pytest.approx(rate, rel=0.02)


def test_envelopes_in_the_loop_are_those_of_the_formula():
    t = np.arange(4001) / 200.0
    rate = np.column_stack([0.02 * np.sin(1.5 * t), 0.01 * np.cos(0.7 * t)])
    launch = steady_launch(rate=rate, wind=(5.0, -3.0), moment=0.002, force=0.02, gust=2.0)
    history = fly_loop(launch, FeedbackCard(noise="published")).history[0]
    n = len(history)
    turning, jerk = envelopes(
        launch.envelope, launch.course.t[:n], np.ones(n, dtype=bool), np.array([-100.0]), rate[:n],
        history[:, :, NOZZLE_COMMAND],
    )  # fmt: skip
    np.testing.assert_allclose(history[:, :, TURNING_BOUND], turning[:, 1:], rtol=1e-9)
    np.testing.assert_allclose(history[:, 0, JERK_BOUND], jerk[:, 2], rtol=1e-9)
    np.testing.assert_allclose(history[:, 1, JERK_BOUND], jerk[:, 1], rtol=1e-9)


def test_ticks_inside_the_envelope_are_counted_as_the_history_shows():
    launch = steady_launch(gust=6.0, moment=0.006, force=0.03)
    mission = fly_loop(launch, FeedbackCard(noise="published"))
    turning, bound = (mission.history[0, :, :, k] for k in (TURNING, TURNING_BOUND))
    inside = (np.abs(turning) <= bound).sum(axis=0)
    assert (inside < len(turning)).any()
    np.testing.assert_array_equal(mission.sums[0, :, 0, INSIDE_TURNING], inside)
    np.testing.assert_array_equal(mission.sums[0, :, 0, TICKS], len(turning))
    assert (mission.sums[0, :, 0, INSIDE_JERK] <= len(turning)).all()
    assert not mission.sums[0, :, 1:].any()


def test_thrusters_hold_the_attitude_of_a_coast_within_their_dead_band_and_leave_the_nozzle_alone():
    launch = steady_launch(600.0, motor=0, turn=(0.02, 0.0))
    mission = fly_steady(launch, FeedbackCard(noise="published"), 2, record_interval=200)
    band = launch.rotation.thrusters.dead_band
    late = mission.history[:, mission.t > 200.0]
    assert np.max(np.abs(late[..., ERROR])) < 1.5 * band
    assert not mission.movement.any()
    assert set(np.unique(np.round(np.abs(late[..., TURNING]), 6))) <= {0.0, 0.002}


def test_navigation_attitude_errs_as_the_steady_filter_of_its_reference_says(record_property):
    # Random walk of the gyro over a second against a reference of 1 deg: sigma after a fix sqrt(p), closed form. The
    # controller holds the navigation's attitude at zero, so the true angle is minus its error.
    launch = steady_launch(3000.0, gains={"attitude": 1.0, "rate": "0.7 s"})
    feedback = FeedbackCard(rate="true", noise="published", reference_sigma="1 deg")
    mission = fly_steady(launch, feedback, 12, record_interval=1000)
    noise = rate_noise(launch.imu, "published")
    driving, reference = 200.0 * (noise / 200.0) ** 2, math.radians(1.0) ** 2
    closed = math.sqrt(steady_ratio(driving, reference) * reference)
    error = mission.history[..., ERROR]
    record_property("navigation attitude error, deg", f"{math.degrees(error.std()):.4f}")
    # 24 histories of 3000 s, correlated over 1 / gain = 350 s: about 100 independent values, 3 sigma 21 %
    assert error.std() == pytest.approx(closed, rel=0.25)


def test_wind_and_gusts_are_what_the_body_is_given():
    launch = steady_launch(400.0, gust=2.0, wind=(7.0, -4.0))
    air = fly_loop(launch, runs=3).history[..., AIR]
    assert air[..., 0].mean() == pytest.approx(7.0, abs=3.0 * 2.0 / math.sqrt(1200.0))  # L / V = 1 s
    assert air[..., 1].mean() == pytest.approx(-4.0, abs=3.0 * 2.0 / math.sqrt(1200.0))
    assert air.std(axis=(0, 1)) == pytest.approx([2.0, 2.0], rel=0.1)


def test_a_motor_that_lights_takes_the_vehicle_from_where_it_points_to_its_attitude_without_a_slam():
    # Ten seconds without a motor, in which the attitude to hold turns on at 0.3 deg/s, then a burn: the command begins
    # where the vehicle points and comes in by the critically damped lag of 2 s.
    launch = steady_launch(40.0, rate=(-0.005, 0.0), gains={"attitude": 1.5, "rate": "0.8 s"})
    body, n = launch.body, 2000
    body.motor[:n], body.effectiveness[:n], body.thrust_load[:n], body.thruster[:] = 0, 0.0, 0.0, 0.0
    launch.course.rate[:10] = 0.0
    history = fly_loop(launch).history[0, :, 0]
    assert history[n - 1, ERROR] == pytest.approx(0.05, rel=0.02)
    assert np.max(np.abs(history[n:, ERROR])) < 0.005  # from its command, which begins with it
    acceleration = 0.05 / 2.0**2 + 2.0 * 0.005 / 2.0  # of the lag at its start: x / T^2 + 2 v / T
    assert np.max(np.abs(history[n:, TURNING])) < 1.5 * acceleration
    assert (np.abs(history[n:, TURNING]) <= history[n:, TURNING_BOUND]).all()


def test_guidance_asks_for_steps_of_the_size_that_it_has():
    """Twice summed, what the commanded rate changes by is the commanded attitude: white steps of the stated sigma."""
    launch = steady_launch(400.0)
    card = launch.controller
    guidance = Guidance.model_construct(from_stage=1, period=1.0, time=1e6, limit=0.2, velocity_sigma=0.0,
                                        command_sigma=0.005)  # fmt: skip
    launch = launch._replace(controller=card.model_copy(update={"guidance": guidance, "command_time": 0.05}))
    rows = fly_loop(launch).history[0]
    commanded = np.cumsum(np.cumsum(rows[:, :, STEPPED], axis=0), axis=0) / 200.0
    asked = commanded[199::200]  # just before the next step
    assert asked.std(axis=0) == pytest.approx(0.005, rel=0.12)  # 400 of them: 7 % at two sigma
    assert abs(np.corrcoef(asked[:-1, 0], asked[1:, 0])[0, 1]) < 0.15
    assert abs(np.corrcoef(asked[:, 0], asked[:, 1])[0, 1]) < 0.15
