"""Launch vehicle under control: nozzle movement by the rate that is fed back, and motion in its envelopes."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.imu.equivalent import equivalent
from lvnav_trade.quantities.per_axis import rms
from lvnav_trade.quantities.records import Floats
from lvnav_trade.scenario.filter_models import sensors_measuring
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.attitude_reference import AttitudeReferenceCard
from lvnav_trade.simulation.preparation.vehicle_model import burns
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.control_cards import FeedbackCard
from lvnav_trade.trajectory.guided import autopilot
from lvnav_trade.trajectory.guided.course import SolvedAscent, ascend
from lvnav_trade.trajectory.guided.missions import Launch, Missions, fly_missions, prepare_launch, scale_rate_gain

# Rates that are fed to the controller, one mission for each.
FEEDS = ("raw", "filtered", "true")
PHASES = ("burn", "coast", "change")
AXES = ("pitch", "yaw")
# Seconds from lift-off in which the motion of one run is compared with its envelopes.
SHOWN = 100.0
_BIN = 0.05


class NozzleStatistics(NamedTuple):
    """Statistics of the missions of a case; axes are pitch and yaw.

    t : (n,) s.
    total : (n_feed, n_run, n_burn + 1, 2) rad. Movement of the nozzle over the flight, and in each burn.
    mean : (n_feed, n, 2) rad. Movement so far, mean of the runs.
    low : (n_feed, n, 2) rad. Smallest movement of a run so far.
    high : (n_feed, n, 2) rad. Largest movement of a run so far.
    turning : (n_feed, 2, N_PHASE, 8). Number of ticks of all runs; fractions of them with angular acceleration and with
        jerk in the envelope; largest ratios of both to it; root mean square of the attitude error (rad) and of the
        error of the fed rate (rad/s); formal sigma of that rate (rad/s).
    bin_time : (k,) s. Start of bins of a twentieth of a second.
    bin_motion : (k, 2, 4). Angular acceleration, its bound, jerk and its bound in the first run with the filtered rate,
        at the tick of each bin that is furthest out.
    """

    t: Floats
    total: Floats
    mean: Floats
    low: Floats
    high: Floats
    turning: Floats
    bin_time: Floats
    bin_motion: Floats


@lru_cache(maxsize=2)
def _cached_ascent(text: str) -> SolvedAscent:
    return ascend(VehicleAscent.model_validate_json(text))


def launch_of(scenario: Scenario) -> Launch:
    """Return the launch of a scenario with a vehicle under control; InputError if cards do not fit the vehicle."""
    card = scenario.control
    assert card is not None  # the scenario is checked for it, and for its trajectory
    assert isinstance(scenario.trajectory, VehicleAscent)
    launch = prepare_launch(
        _cached_ascent(scenario.trajectory.model_dump_json()),
        card.rotation,
        card.controller,
        card.wind,
        equivalent(scenario.imu),
        scenario.filter.envelope,
    )
    return scale_rate_gain(launch, card.rate_gain)


def nozzle_statistics(scenario: Scenario, seed: int, runs: int) -> NozzleStatistics | None:
    """Return the missions of a case with the draws of the campaign; None without a vehicle under control.

    Parameters
    ----------
    scenario
        Validated model of the case.
    seed
        Seed of the campaign.
    runs
        Number of runs.
    """
    if scenario.control is None:
        return None
    launch = launch_of(scenario)
    missions = [fly_missions(launch, feedback(scenario, feed), runs, seed) for feed in FEEDS]
    movement = np.stack([mission.history[..., autopilot.MOVED] for mission in missions])
    turning = [_turning(launch, mission, feed) for mission, feed in zip(missions, FEEDS, strict=True)]
    bin_time, bin_motion = _bin_motion(launch, feedback(scenario, "filtered"), seed)
    return NozzleStatistics(
        t=missions[0].t,
        total=_totals(missions, np.array(_burns_of(scenario))),
        mean=movement.mean(axis=1),
        low=movement.min(axis=1),
        high=movement.max(axis=1),
        turning=np.stack(turning),
        bin_time=bin_time,
        bin_motion=bin_motion,
    )


def _burns_of(scenario: Scenario) -> list[tuple[float, float]]:
    card = scenario.trajectory.model_dump_json()
    ascent = _cached_ascent(card)
    return burns(ascent.trajectory)


def feedback(scenario: Scenario, feed: Any) -> FeedbackCard:
    """Return the feedback of the controller: a rate of FEEDS, and the attitude of the scenario's reference."""
    (sensor,) = sensors_measuring(scenario, "attitude")  # the scenario is checked for it
    assert isinstance(sensor, AttitudeReferenceCard)
    return FeedbackCard.model_construct(
        rate=feed,
        attitude="navigation",
        noise="datasheet",
        reference_sigma=sensor.sigma,
        reference_rate=sensor.rate or scenario.filter.update_rate,
    )


def _totals(missions: list[Missions], burns: Floats) -> Floats:
    """Return the movement (n_feed, n_run, n_burn + 1, 2): flight, and from begin to a second after each burn."""
    n_run = len(missions[0].movement)
    n_interval = len(burns) + 1
    totals = np.empty((len(missions), n_run, n_interval, 2))
    for feed, mission in enumerate(missions):
        totals[feed, :, 0] = mission.movement
        last_index = mission.t.size - 1
        for number, (begin, end) in enumerate(burns, start=1):
            insertions = np.searchsorted(mission.t, [begin, end + 1.0])
            first, last = np.minimum(insertions, last_index)
            movement = mission.history[..., autopilot.MOVED]
            totals[feed, :, number] = movement[:, last] - movement[:, first]
    return totals


def _turning(launch: Launch, missions: Missions, feed: str) -> Floats:
    """Return the sums over the ticks of each axis and phase, (2, N_PHASE, 8); see NozzleStatistics."""
    sums = missions.sums.sum(axis=0)
    furthest = missions.sums.max(axis=0)
    n_tick = sums[..., autopilot.TICKS]
    divisor = np.where(n_tick > 0.0, n_tick, np.nan)
    formal = np.full((2, autopilot.N_PHASE), np.nan)
    if feed == "raw":
        formal[:] = rms(launch.imu.gyro.random_walk) * np.sqrt(launch.imu.rate)
    elif feed == "filtered":
        formal = _formal(launch, missions)
    return np.stack(
        [
            n_tick,
            sums[..., autopilot.INSIDE_TURNING] / divisor,
            sums[..., autopilot.INSIDE_JERK] / divisor,
            furthest[..., autopilot.TURNING_RATIO],
            furthest[..., autopilot.JERK_RATIO],
            np.sqrt(sums[..., autopilot.SQUARE_ERROR] / divisor),
            np.sqrt(sums[..., autopilot.SQUARE_RATE] / divisor),
            formal,
        ],
        axis=-1,
    )


def _formal(launch: Launch, missions: Missions) -> Floats:
    """Return the root mean square (2, N_PHASE) of the filter's sigma of the rate; NaN for a phase that is missing."""
    course = launch.course
    n_record = missions.t.size
    n_tick = course.t.size - 1
    ticks_per_record = max(1, round(n_tick / n_record))
    phase = course.phase[:-1:ticks_per_record][:n_record]
    sigma = np.full((2, autopilot.N_PHASE), np.nan)
    for number in np.unique(phase):
        in_phase = phase == number
        formal = missions.history[:, in_phase, :, autopilot.FORMAL]
        mean_square = np.mean(formal**2, axis=(0, 1))
        sigma[:, number] = np.sqrt(mean_square)
    return sigma


def _bin_motion(launch: Launch, feedback: FeedbackCard, seed: int) -> tuple[Floats, Floats]:
    """Return time (k,) s and motion (k, 2, 4) of the first run's first seconds, for each bin the tick furthest out.

    Parameters
    ----------
    launch
        Vehicle and ascent.
    feedback
        Feedback of the controller.
    seed
        Seed of the campaign.
    """
    run = fly_missions(launch, feedback, 1, seed, record_interval=1)
    per_bin = max(1, round(_BIN * launch.imu.rate))
    n_shown = int(np.sum(run.t <= SHOWN))
    n_bin = n_shown // per_bin
    n_tick = n_bin * per_bin
    first_run = run.history[0, :n_tick]
    ticks = first_run.reshape(n_bin, per_bin, 2, -1)
    bin_motion = np.empty((n_bin, 2, 4))
    for axis in range(2):
        motion = ticks[:, :, axis]
        turning = motion[..., autopilot.TURNING]
        turning_bound = motion[..., autopilot.TURNING_BOUND]
        jerk = motion[..., autopilot.JERK]
        jerk_bound = motion[..., autopilot.JERK_BOUND]
        bin_motion[:, axis, :2] = _furthest(turning, turning_bound)
        bin_motion[:, axis, 2:] = _furthest(jerk, jerk_bound)
    t = run.t[:n_tick:per_bin]
    return t, bin_motion


def _furthest(values: Floats, bounds: Floats) -> Floats:
    """Return value and bound (n_bin, 2) of the tick of each bin that is furthest out; arguments (n_bin, n_tick)."""
    bins = np.arange(len(values))
    ratio = np.abs(values) / bounds
    tick = np.argmax(ratio, axis=1)
    furthest_value = values[bins, tick]
    furthest_bound = bounds[bins, tick]
    return np.stack([furthest_value, furthest_bound], axis=1)
