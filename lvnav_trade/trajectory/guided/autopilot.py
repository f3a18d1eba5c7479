"""Records and indices of the attitude loop of a turning launcher; axes are pitch and yaw."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.records import Floats, Ints

TRUE, RAW, FILTERED = 0, 1, 2
BURN, COAST, CHANGE, N_PHASE = 0, 1, 2, 3
IDEAL, MODELLED, OF_THE_RUN = 0, 1, 2
"""Attitude that the controller sees: the true one, that of a navigation of its own, that of the run's navigation."""
NEXT, MOTOR, FRESH, STACK, N_COUNT = range(5)
"""What a run counts: the tick that is due, the burning stage (0: none, -1: not known yet), whether it has just changed,
and the lowest stage.
"""

# What is recorded of an axis at a tick.
(
    NOZZLE,
    ASKED,
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
# What is added up of an axis in a phase.
(TICKS, INSIDE_TURNING, INSIDE_JERK, TURNING_RATIO, JERK_RATIO, SQUARE_ERROR, SQUARE_RATE, N_SUM) = range(8)


class Plant(NamedTuple):
    """Nozzle (s, rad/s, rad, rad) and thrusters (rad, s, part) of a vehicle."""

    time_constant: float
    rate_limit: float
    limit: float
    misalignment: float
    dead_band: float
    lead: float
    release: float


class Law(NamedTuple):
    """Controller: gains (n_stage, 3) of attitude, rate (s), integral (1/s); guidance from a stage on (0: none)."""

    gains: Floats
    command_time: float
    guided_from: int
    guidance_ticks: int
    guidance_time: float
    guidance_limit: float
    velocity_sigma: float
    command_sigma: float


class Feed(NamedTuple):
    """What the controller sees: source of the rate, which attitude, noises, reference's gain."""

    rate: int
    attitude: int
    gyro: float
    bias: float
    reference: float
    reference_ticks: int
    reference_gain: float
    start: float


class CommandedEnvelope(NamedTuple):
    """The part of the motion envelope that depends on commanded rate and nozzle angle, see `EnvelopeCard`."""

    burn: float
    coast: float
    turn_gain: float
    turn_time: float
    lateral: float
    nozzle_gain: float
    nozzle_time: float


class Settings(NamedTuple):
    """What is the same in all runs of a launch."""

    plant: Plant
    law: Law
    feed: Feed
    model: CommandedEnvelope


class Draws(NamedTuple):
    """What the draws of a run depend on: two words of the seed, the number of the run."""

    k0: np.uint64
    k1: np.uint64
    run: np.uint64


class Course(NamedTuple):
    """The attitude that is commanded before lift-off, on n even ticks from lift-off on. Axes are pitch and yaw.

    t : (n,) s since lift-off.
    ahead : (n, 3). Axis of the body, frame i.
    up : (n, 3). The way of its nose pitching up, frame i.
    right : (n, 3). The way of its nose yawing right, frame i.
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


class Met(NamedTuple):
    """What a vehicle meets at a moment. Pairs are of pitch and yaw; lateral is the way of the nose, up and right.

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


class Control(NamedTuple):
    """The controlled attitude of one run.

    course : What is commanded before lift-off.
    settings : What is the same in all runs.
    draws : What draws depend on.
    memory : (2, N_MEMORY). What the axes remember from tick to tick; updated.
    counts : (N_COUNT,). What the run counts; updated.
    every : Ticks from record to record.
    history : (n_record, 2, N_RECORD). Record of every so many ticks; set.
    sums : (2, N_PHASE, N_SUM). What ticks add up to; updated.
    """

    course: Course
    settings: Settings
    draws: Draws
    memory: Floats
    counts: Ints
    every: int
    history: Floats
    sums: Floats


class Reaction(NamedTuple):
    """What an axis does at a tick, with the bounds of the envelope of commanded motion."""

    turning: float  # angular acceleration, rad/s^2
    turning_bound: float  # rad/s^2
    jerk: float  # of the lateral specific force, m/s^3
    jerk_bound: float  # m/s^3
    error: float  # of the attitude, rad
    rate_error: float  # rad/s
