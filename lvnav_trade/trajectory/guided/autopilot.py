"""Records and indices of the attitude loop of a turning launcher; axes are pitch and yaw."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.records import Floats, Ints

TRUE, RAW, FILTERED = 0, 1, 2
BURN, COAST, CHANGE, N_PHASE = 0, 1, 2, 3
IDEAL, MODELLED, OF_THE_RUN = 0, 1, 2
"""Attitude that the controller uses: the true attitude, that of a separate navigation, that of the run's navigation."""
NEXT, MOTOR, JUST_IGNITED, STACK, N_COUNT = range(5)
"""Counters of a run: next tick, burning stage (0: none, -1: not known yet), whether it just changed, lowest stage."""

# Record of an axis at a tick.
(
    NOZZLE,
    NOZZLE_COMMAND,
    MOVED,
    ERROR,
    RATE_ERROR,
    TURNING,
    TURNING_BOUND,
    JERK,
    JERK_BOUND,
    AIR,
    FORMAL,
    ANGLE,
    RATE,
    FORCE,
    STEPPED,
    N_RECORD,
) = range(16)
# Sums of an axis over a phase.
(TICKS, INSIDE_TURNING, INSIDE_JERK, TURNING_RATIO, JERK_RATIO, SQUARE_ERROR, SQUARE_RATE, N_SUM) = range(8)


class Plant(NamedTuple):
    """Nozzle and thrusters of a vehicle.

    time_constant : s. Of the nozzle.
    rate_limit : rad/s. Of the nozzle.
    limit : rad. Largest angle of the nozzle.
    misalignment : rad. Sigma of the thrust direction of each stage.
    dead_band : rad. Attitude error beyond which the thrusters fire.
    lead : s. Weight of the rate error in that decision.
    release : Fraction of the dead band below which they stop.
    """

    time_constant: float
    rate_limit: float
    limit: float
    misalignment: float
    dead_band: float
    lead: float
    release: float


class ControlLaw(NamedTuple):
    """Controller, with a separate guidance that turns the nominal attitude.

    gains : (n_stage, 3). Gains of attitude, rate (s) and integral (1/s).
    command_time : s. Time constant of a commanded offset.
    guided_from : Number of the first stage with guidance; 0: none.
    guidance_ticks : Ticks between two commands of the guidance.
    guidance_time : s. Time in which a lateral velocity is to be removed.
    guidance_limit : rad. Largest commanded offset.
    velocity_sigma : m/s. Noise of the lateral velocity that the guidance has.
    command_sigma : rad. Noise of its commands.
    """

    gains: Floats
    command_time: float
    guided_from: int
    guidance_ticks: int
    guidance_time: float
    guidance_limit: float
    velocity_sigma: float
    command_sigma: float


class ControllerInputs(NamedTuple):
    """Measurements that the controller uses.

    rate : Source of the rate: TRUE, RAW or FILTERED.
    attitude : Source of the attitude: IDEAL, MODELLED or OF_THE_RUN.
    gyro : rad/s. Noise of a sampled rate.
    bias : rad/s. Sigma of the gyro bias.
    reference : rad. Noise of the attitude reference.
    reference_ticks : Ticks between two measurements of the reference.
    reference_gain : Gain of these measurements; 0: none.
    start : rad. Sigma of the initial attitude.
    """

    rate: int
    attitude: int
    gyro: float
    bias: float
    reference: float
    reference_ticks: int
    reference_gain: float
    start: float


class CommandedEnvelope(NamedTuple):
    """The part of the motion envelope that depends on commanded rate and nozzle angle, see `EnvelopeCard`.

    burn, coast : rad/s^2. Unknown angular acceleration in burns and in coasts.
    turn_gain : Gain on the commanded angular acceleration.
    turn_time : s. Time constant of the response to that command.
    lateral : m/s^3. Unknown lateral jerk.
    nozzle_gain : m/s^2 per rad. Lateral acceleration per nozzle angle.
    nozzle_time : s. Time constant of the response to the nozzle.
    """

    burn: float
    coast: float
    turn_gain: float
    turn_time: float
    lateral: float
    nozzle_gain: float
    nozzle_time: float


class AutopilotSettings(NamedTuple):
    """Settings common to all runs of a launch: vehicle, controller, measurements and envelope."""

    plant: Plant
    law: ControlLaw
    feed: ControllerInputs
    model: CommandedEnvelope


class DrawKeys(NamedTuple):
    """Keys of the draws of a run: two words of the seed, and the number of the run."""

    k0: np.uint64
    k1: np.uint64
    run: np.uint64


class CommandedAttitude(NamedTuple):
    """The commanded attitude, stored before lift-off for n even ticks from lift-off on. Axes are pitch and yaw.

    t : (n,) s since lift-off.
    ahead : (n, 3). Axis of the body, frame i.
    up : (n, 3). Direction in which the nose moves when it pitches up, frame i.
    right : (n, 3). Direction in which the nose moves when it yaws right, frame i.
    rate : (n, 2) rad/s. Body rate.
    turn : (n, 2) rad. Additional commanded angle.
    turn_rate : (n, 2) rad/s. Additional commanded rate.
    velocity : (n, 3) m/s. Of the nominal flight, frame i.
    phase : (n,). BURN, COAST or CHANGE.
    """

    t: Floats
    ahead: Floats
    up: Floats
    right: Floats
    rate: Floats
    turn: Floats
    turn_rate: Floats
    velocity: Floats
    phase: Ints


class LateralForces(NamedTuple):
    """Forces and air at a moment. Pairs are of pitch and yaw; lateral means along `up` and `right` of the course.

    effectiveness : 1/s^2. Angular acceleration per nozzle angle.
    thrust_load : m/s^2. Thrust over mass.
    moment : rad/(s m). Angular acceleration per lateral airspeed.
    force : 1/s. Lateral acceleration per lateral airspeed.
    airspeed : m/s.
    slip : m/s. Lateral velocity over the ground.
    wind : m/s. Lateral wind without gusts.
    drift : m/s. Lateral velocity less that of the nominal flight.
    gust : m/s. Sigma of the gusts.
    gust_rate : 1/s. Airspeed over the length of the gusts.
    thruster : rad/s^2. Angular acceleration by a pair of thrusters.
    """

    effectiveness: float
    thrust_load: float
    moment: float
    force: float
    airspeed: float
    slip: tuple[float, float]
    wind: tuple[float, float]
    drift: tuple[float, float]
    gust: float
    gust_rate: float
    thruster: float


class ControlledAttitude(NamedTuple):
    """The controlled attitude of one run.

    course : Commanded attitude.
    settings : Settings common to all runs.
    draws : Keys of the draws.
    memory : (2, N_MEMORY). State of both axes from tick to tick; updated.
    counts : (N_COUNT,). Counters of the run; updated.
    record_interval : Ticks from record to record.
    history : (n_record, 2, N_RECORD). Record of every so many ticks; set.
    sums : (2, N_PHASE, N_SUM). Sums over the ticks of each phase; updated.
    """

    course: CommandedAttitude
    settings: AutopilotSettings
    draws: DrawKeys
    memory: Floats
    counts: Ints
    record_interval: int
    history: Floats
    sums: Floats


class AxisMotion(NamedTuple):
    """Motion of an axis at a tick, with the bounds of the envelope of commanded motion."""

    turning: float  # angular acceleration, rad/s^2
    turning_bound: float  # rad/s^2
    jerk: float  # of the lateral specific force, m/s^3
    jerk_bound: float  # m/s^3
    error: float  # of the attitude, rad
    rate_error: float  # rad/s
