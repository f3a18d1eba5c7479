"""What a flight takes in, in numbers for the kernels: schedule, unit, signals, start, record."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.records import Bools, Floats, Ints


class Schedule(NamedTuple):
    """Windows of IMU ticks: first_tick, n_tick, length (index of its length), epoch and hist (-1: none), injection
    (number of the variances of the filter's model that are added at its end, -1 none), linearised (see
    `transition.linearise`), all (n_window,).
    """

    first_tick: Ints
    n_tick: Ints
    length: Ints
    epoch: Ints
    hist: Ints
    injection: Ints
    linearised: Ints


class Unit(NamedTuple):
    """The truth of an IMU. dt s; noise_source word; biases_only: it has no scale factor, misalignment or g-sensitivity.

    Of several units it holds their blocks one after the other, what belongs to a sensor by the number 2 triad + sensor,
    and the increments of the fused triad; the rest is in `Units`.

    dtheta, dvel (n_imu, 3); white (8,) per-tick sigma by axis of gyro and accelerometer, quantisation steps;
    process_ticks between steps of varying parameters; drifting: any of these; sigma, walk (n_block, 3), decay
    (n_block,); sources words, sensors, drivers (n_block,); profiles of bias or scale factor that are the same in every
    run: profile_sensor, profile_driver (n_profile,), profile_start, profile_end (n_profile,) s, profile (n_profile, 3)
    SI; gravity: block of the gravity disturbance, -1 none; start s since lift-off of tick 0.
    """

    dt: float
    noise_source: np.uint64
    biases_only: bool
    dtheta: Floats
    dvel: Floats
    white: Floats
    process_ticks: int
    drifting: bool
    sigma: Floats
    decay: Floats
    walk: Floats
    sources: NDArray[np.uint64]
    sensors: Ints
    drivers: Ints
    profile_sensor: Ints
    profile_driver: Ints
    profile_start: Floats
    profile_end: Floats
    profile: Floats
    gravity: int
    start: float


class Units(NamedTuple):
    """Several inertial units, triad by triad (up to three sensing axes of a unit).

    dtheta, dvel (n_triad, n_imu, 3) increments where the unit sits, without errors, body axes; n_axis (n_triad,);
    frames (n_triad, 3, 3, 3) of each axis: its direction, then those that its misalignments are towards; solved
    (n_stage, n_triad, 2, 3, 3) how errors of the axes of gyro and accelerometer enter the fused triad; lever
    (n_triad, 3) m that is compensated; noise_sources (n_triad,) words; white (n_triad, 8) as of `Unit`; triads
    (n_block,) of the blocks of the unit's true parameters. Differences of two units (n_pair): pair_sensor (n_pair,)
    gyro or accelerometer, pair_solved (n_pair, n_triad, 3, 3) as solved, pair_state (n_pair,) first state of the filter
    for its bias (-1 none), pair_of (n_device,) which one a sensor measures (-1 none).

    Of a stage of the flight (all of it is one without redundancy): noisy (n_stage, 2, 2, 3) factor on errors that last
    and on white noise, by sensor and fused axis; shift (n_stage, 2, 3) rad and m/s of the mean of an increment; stage
    (n_imu,) of each tick in linear covariance, flown (n_imu,) as if no unit were excluded, which a run knows itself.
    redundant (Redundant): of units that are tested or selected, None of others.
    """

    dtheta: Floats
    dvel: Floats
    n_axis: Ints
    frames: Floats
    solved: Floats
    lever: Floats
    noise_sources: NDArray[np.uint64]
    white: Floats
    triads: Ints
    pair_sensor: Ints
    pair_solved: Floats
    pair_state: Ints
    pair_of: Ints
    noisy: Floats
    shift: Floats
    stage: Ints
    flown: Ints
    redundant: Any = None


class Redundant(NamedTuple):
    """Units that are tested against each other, or of which the middle one is selected. middle: it is; ticks of a test
    (0: none); weight (n_window, 2, n_triad, 3) inverse variance of increments summed over a test by the cards (0: no
    axis); limits (n_dof + 1,) of the weighted squares that a fit leaves, by its degrees of freedom; owner (n_triad,)
    unit of a triad; alone (n_triad, 3, 3) how axes enter the solution of their unit alone; shares (2, n_triad) weights
    of the axes in the mean. What the filter is informed of: lost (n_lost,) ticks from which on units are left out on
    the nominal flight, mean (n_lost + 1, n_triad, 2, 3, 3) how axes enter the mean, of all units and then of those that
    are left; noise, spread, walk (2, n_triad, 3) of an axis: variance per second of white noise, variance of biases,
    variance per second of their walk.
    """

    middle: bool
    ticks: int
    weight: Floats
    limits: Floats
    owner: Ints
    alone: Floats
    shares: Floats
    noise: Floats
    spread: Floats
    walk: Floats
    lost: Ints
    mean: Floats


class Shared(NamedTuple):
    """Random errors of measurements that last or that rows share; a family is one physical cause.

    member (n_family, n_channel) component of the family in the channel, -1 none; partial (n_family, n_epoch, n_channel)
    of the measurement with respect to it; start (n_component,) sigma, decay and walk (n_component,) over an interval of
    epochs; sources, satellites (n_component,) words; extra (n_component,) first extra state of the filter that stands
    for the same thing, -1 none; error_of, state_of (n_pair,): component and extra state of all that do; given
    (n_component,): set before the flight, not drawn.
    """

    member: Ints
    partial: Floats
    start: Floats
    decay: Floats
    walk: Floats
    sources: NDArray[np.uint64]
    satellites: NDArray[np.uint64]
    extra: Ints
    error_of: Ints
    state_of: Ints
    given: Bools


class Signals(NamedTuple):
    """What is true of the satellites and the receiver at the epochs. A channel is an observable of one satellite
    (tight: pseudorange, range rate and further ones in turn) or an axis of the solution (loose).

    used (n_epoch, n_slot) satellite index in each slot, -1 none; n_used (n_epoch,); words (n_sat,) of satellites;
    range, rate (n_epoch, n_sat) m and m/s that the receiver would measure without clock and random errors, less what
    the filter corrects; position, velocity (n_epoch, 3) the same of its solution, frame i; satellite,
    satellite_velocity (n_epoch, n_sat, 3) as the filter knows them; antenna (n_epoch, n_sat) that receives; sigma
    (n_epoch, n_channel) of white noise; variance (n_epoch, n_channel) as the filter assumes, with the factor of its
    tuning, whose root is scale, and beta of its under-weighting (n_epoch, n_channel); partial (n_extra_family,
    n_epoch, n_channel) of rows with respect to the filter's extra states, as it assumes; clock_step (3,) Cholesky
    factor over an epoch; clock_start (2,) sigma; clock_jump (n_epoch, 2) m and m/s; frozen (n_epoch,): the output is
    that of the epoch before; interval s between epochs; n_receiver: channels of the receiver in the filter, which come
    first; reference (n_epoch, n_kind): slot of the satellite that an observable of others is differenced with, -1 none;
    shift: sigma and shared errors are of what the receiver measures itself, so there the channels of sensors stand so
    much later; sources (4,) words: clock, ranges, solution, clock start.
    """

    used: Ints
    n_used: Ints
    words: NDArray[np.uint64]
    range: Floats
    rate: Floats
    position: Floats
    velocity: Floats
    satellite: Floats
    satellite_velocity: Floats
    antenna: Ints
    sigma: Floats
    variance: Floats
    scale: Floats
    beta: Floats
    partial: Floats
    clock_step: Floats
    clock_start: Floats
    clock_jump: Floats
    frozen: Bools
    interval: float
    n_receiver: int
    reference: Ints
    shift: int
    sources: NDArray[np.uint64]
    shared: Shared


class Further(NamedTuple):
    """What is true of the observables of satellites beside pseudorange and range rate.

    phase (n_epoch, n_sat) m that a carrier phase would be without clock and random errors, less what the filter
    corrects; is_phase, is_difference (n_kind,) of the observables of a satellite; restart (n_epoch, n_sat) whether a
    carrier begins a new phase; ambiguity (n_sat,) component of the shared errors that is its constant, -1 none; source:
    word of its noise.
    """

    phase: Floats
    is_phase: Bools
    is_difference: Bools
    restart: Bools
    ambiguity: Ints
    source: np.uint64


class Start(NamedTuple):
    """True state at tick 0 and the spread of the filter's: nav (10,); roots (3, 3, 3) of the covariance of attitude,
    velocity and position error, frame i; sources (3,) words; P (n_state, n_state) the filter's own covariance.
    """

    nav: Floats
    roots: Floats
    sources: NDArray[np.uint64]
    P: Floats


class Record(NamedTuple):
    """What is true at the history times.

    r, v (n_hist, 3), q (n_hist, 4) true motion; axes (n_hist, 3, 3) from frame i to the reporting frame; t (n_hist,) s;
    since (n_hist,) s since the last epoch; limit m of position error beyond which a run has failed.
    """

    r: Floats
    v: Floats
    q: Floats
    axes: Floats
    t: Floats
    since: Floats
    limit: float


class Sensors(NamedTuple):
    """The sensors beside the receiver: code (n_sensor,) of each in the family; channel, scalars (n_sensor,) its first
    channel and how many it has; on (n_sensor, n_epoch) whether it measures; truth (n_sensor, n_epoch, 4) and what the
    filter knows, known (n_sensor, n_epoch, N_KNOWN), see the member's module; theta (n_sensor, n_epoch) rad angle of
    the Earth as the filter takes it; sources (n_sensor,) words. Noise and what the filter assumes of it stand in
    Signals, by channel.
    """

    code: Ints
    channel: Ints
    scalars: Ints
    on: Bools
    truth: Floats
    known: Floats
    theta: Floats
    sources: NDArray[np.uint64]


class Samples(NamedTuple):
    """What is reported of the IMU's samples: rate, force (n_imu, 3) true means over the ticks; par (2,) number of the
    parameter block of each sensor's bias and bias (6,) its states, -1 none; raw (6,) variance that the filter assumes
    of a sample, variance (6,) of its noise alone.
    """

    rate: Floats
    force: Floats
    par: Ints
    bias: Ints
    raw: Floats
    variance: Floats


class Report(NamedTuple):
    """What is reported of a receiver's own solution: point (n_epoch, 6) true position and velocity of what is solved
    for; first_output column of the outputs; its filter's innovations: n_channel (0 without a filter) from first_channel
    on.
    """

    point: Floats
    first_output: int
    first_channel: int
    n_channel: int


class Options(NamedTuple):
    """Parts of a flight that not every case has; None where a case has not, and then nothing of them is compiled.

    A part is handed on as an argument of its own: the compiler drops `if part is None` for arguments only.

    solver (receivers.base.Solver): the receiver solves for position and velocity itself; rules (filters.monitor.Rules):
    the filter has a mode logic; late (filters.late.Late): late measurements are compensated; gains
    (filters.scheduled.Gains): stored ones; vehicle (filters.samples.VehicleModel): samples of the IMU are measurements;
    samples (Samples), report (Report): of them or of the receiver's solution something is reported; misses (True): what
    the filter's transition misses is recorded in place of errors; units (Units): several inertial units are fused;
    direct (True): the filter corrects its total state scalar by scalar; backup (int): errors of a strapdown that is
    never corrected are reported, from that output on; further (Further), delayed (filters.delayed.Delayed): carrier
    phases or differences of two epochs are measured; unscented (True): points in place of Jacobians; integrity
    (filters.integrity.state.Tests): faults are tested for; iterated (filters.iterated.Passes): so is the update.
    """

    solver: Any = None
    rules: Any = None
    late: Any = None
    gains: Any = None
    vehicle: Any = None
    samples: Any = None
    report: Any = None
    misses: Any = None
    units: Any = None
    direct: Any = None
    backup: Any = None
    further: Any = None
    delayed: Any = None
    unscented: Any = None
    integrity: Any = None
    iterated: Any = None
