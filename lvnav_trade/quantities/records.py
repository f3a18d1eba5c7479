"""Records that several packages use: motion, satellites, results of runs and of linear covariance, and requests."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

# States of a receiver channel, by number and by name. Idle: the satellite is not searched for.
IDLE, SEARCH, ACQUIRE, TRACK, LOST = range(5)
TRACKING = ("idle", "search", "acquire", "track", "lost")


# Modes of a filter with mode logic, and reasons of a change, by number and by name. Outputs are corrected while the
# filter is aiding or predicting.
WAITING, CONVERGING, AIDING, PREDICTING, STOPPED = range(5)
MODES = ("waiting", "converging", "aiding", "predicting", "stopped")
REASONS = (
    "",
    "good samples in a row",
    "converged",
    "data lost",
    "data again",
    "data loss persists",
    "residual error persists",
    "covariance error persists",
    # the input check that a sample with a solution failed
    "checksum",
    "hardware",
    "time synchronisation",
    "no fresh solution",
    "dilution of precision",
)
# Flags that a receiver raises with its output, in the order of precedence as reasons of a mode change
FLAGS = ("checksum", "hardware", "time_sync")
FRESH = "fresh"
FIRST_CHECK = 8  # index of the first flag in REASONS
NO_CHANGES = np.zeros((0, 5))

# Faults that fault detection isolates, by number and by name.
OF_CHANNEL, OF_CLOCK, OF_INERTIAL, OF_UNIT, OF_SEPARATION = 1, 2, 3, 4, 5
ISOLATED = ("", "channel", "clock", "inertial", "unit", "separation")
NO_DECISIONS = np.zeros((0, 4))

# Outcomes of a guided ascent, by number and by name, and the elements of its orbit.
OUTCOMES = ("injected", "depleted", "guidance diverged", "navigation failed")
ORBIT = (
    "semi_major_axis",
    "perigee",
    "apogee",
    "eccentricity_along_node",
    "eccentricity_ahead_of_node",
    "inclination",
    "node",
)
INJECTION = (*ORBIT, "cutoff_time", "propellant_left")
"""Numbers of an injection: elements of the achieved orbit, time of the cut-off (s), remaining propellant (kg)."""
NO_INJECTIONS = np.zeros((0, 3 + 2 * len(ORBIT)))
NO_LOST = np.zeros((0, 4))
# Channel number of a fault decision on the first IMU; each further IMU has one less.
FIRST_UNIT = -2


class Motion(NamedTuple):
    """True motion of the IMU at n times. At a jump of thrust it is the value just after the jump.

    t : (n,) s since lift-off.
    r_i : (n, 3) m. Position, frame i.
    v_i : (n, 3) m/s. Inertial velocity, frame i.
    q_b_i : (n, 4). Unit quaternion from body to inertial, scalar first.
    f_b : (n, 3) m/s^2. Specific force, body axes.
    w_ib_b : (n, 3) rad/s. Body rate with respect to frame i, body axes.
    """

    t: Floats
    r_i: Floats
    v_i: Floats
    q_b_i: Floats
    f_b: Floats
    w_ib_b: Floats


class Reference(NamedTuple):
    """True motion on the ticks of the IMU, and the increments of an ideal IMU between them.

    t : (n_tick + 1,) s since lift-off. Ticks.
    r_i : (n_tick + 1, 3) m. Position, frame i.
    v_i : (n_tick + 1, 3) m/s. Inertial velocity, frame i.
    q_b_i : (n_tick + 1, 4). Unit quaternion from body to inertial, scalar first.
    f_b : (n_tick + 1, 3) m/s^2. Specific force, body axes.
    w_ib_b : (n_tick + 1, 3) rad/s. Body rate, body axes.
    dtheta : (n_tick, 3) rad. Integral of the body rate over each interval, body axes.
    dvel : (n_tick, 3) m/s. Integral of the specific force over each interval, body axes.
    """

    t: Floats
    r_i: Floats
    v_i: Floats
    q_b_i: Floats
    f_b: Floats
    w_ib_b: Floats
    dtheta: Floats
    dvel: Floats


class ChannelTransition(NamedTuple):
    """Change of state of a receiver channel.

    t : s since lift-off.
    satellite : Name of the satellite.
    state_before, state_after : States, as in `TRACKING`.
    reason : Cause of the change.
    """

    t: float
    satellite: str
    state_before: str
    state_after: str
    reason: str


class Sky(NamedTuple):
    """Satellites over a flight, each at the time of transmission of the signal received at the epoch.

    t : (n_epoch,) s since lift-off.
    names : (n_sat,). Names such as "G05".
    r_i : (n_epoch, n_sat, 3) m. Position at transmission, frame i.
    v_i : (n_epoch, n_sat, 3) m/s. Derivative of r_i with respect to *reception* time.
    azimuth : (n_epoch, n_sat) rad. At the antenna, frame n.
    elevation : (n_epoch, n_sat) rad. At the antenna, frame n.
    is_tracked : (n_epoch, n_sat). Whether the satellite is measured at the epoch.
    antenna : (n_epoch, n_sat). Antenna that receives the satellite best.
    cn0 : (n_epoch, n_sat) dB-Hz. C/N0 in the tracking loops; NaN without a link budget or a signal.
    range_sigma : (n_epoch, n_sat) m. True sigma of white noise in the pseudorange.
    rate_sigma : (n_epoch, n_sat) m/s. True sigma of white noise in the range rate.
    phase_sigma : (n_epoch, n_sat) m. True sigma of white noise in the carrier phase.
    continuous : (n_epoch, n_sat). Whether the carrier has been tracked since the epoch before.
    state : (n_epoch, n_sat). State of the receiver's channel, as in TRACKING.
    lever_arms : (n_antenna, 3) m. Antenna phase centres relative to the IMU, body axes.
    systems : (n_sat,). Letter of the system, as in RINEX.
    transitions : State changes of the receiver's channels in order of time; none without a tracking card.
    """

    t: Floats
    names: tuple[str, ...]
    r_i: Floats
    v_i: Floats
    azimuth: Floats
    elevation: Floats
    is_tracked: NDArray[np.bool_]
    antenna: NDArray[np.int64]
    cn0: Floats
    range_sigma: Floats
    rate_sigma: Floats
    phase_sigma: Floats
    continuous: NDArray[np.bool_]
    state: NDArray[np.int8]
    lever_arms: Floats
    systems: tuple[str, ...]
    transitions: tuple[ChannelTransition, ...] = ()


class RunBlock(NamedTuple):
    """Results of a block of Monte Carlo runs. Error is truth minus estimate, in reporting axes, SI (see `Output`).

    first_run : Number of the first run.
    t : (n_hist,) s since lift-off. History times.
    err : (n_run, n_hist, n_out). Estimation error.
    sigma : (n_run, n_hist, n_out). Standard deviation in the filter's own covariance.
    nees : (n_run, n_hist). Normalised estimation error squared.
    t_epoch : (n_epoch,) s since lift-off. Epochs.
    nis : (n_run, n_epoch). Sum of squared normalised innovations of the accepted scalar measurements.
    n_row : (n_run, n_epoch). Number of accepted scalar measurements.
    n_reject : (n_run, n_epoch). Number of scalar measurements that the gate rejected.
    innovation : (n_run, n_epoch, n_channel). Normalised innovation before the gate, NaN without a measurement.
    failed : (n_run,). 0 good; 1 not finite; 2 diverged: position error beyond the scenario's limit.
    t_failed : (n_run,) s since lift-off. Time of the failure, NaN without.
    changes : (n_change, 5). Mode changes, run after run: run, time (s), mode before, mode after, reason (see MODES,
        REASONS).
    decisions : (n_decision, 4). Fault decisions: run, time (s), kind isolated (see ISOLATED), channel excluded (-1
        none; of an IMU see FIRST_UNIT).
    injections : (n_run, 3 + 2 n_orbit). Of guided ascents: outcome (see OUTCOMES), time (s) of the last cut-off,
        remaining propellant (kg), then for each element in ORBIT the achieved value minus the target, and the achieved
        value minus the navigated value.
    lost_draws : (n_draw, 4). Vehicle draws of the runs that do not reach their cut-off, run after run: run, number of
        the source (see `dispersion_card.SOURCES`), number within the source, draw in sigmas.
    """

    first_run: int
    t: Floats
    err: Floats
    sigma: Floats
    nees: Floats
    t_epoch: Floats
    nis: Floats
    n_row: NDArray[np.int32]
    n_reject: NDArray[np.int32]
    innovation: Floats
    failed: NDArray[np.int8]
    t_failed: Floats
    changes: Floats = NO_CHANGES
    decisions: Floats = NO_DECISIONS
    injections: Floats = NO_INJECTIONS
    lost_draws: Floats = NO_LOST


class InjectionLaw(NamedTuple):
    """Linear covariance of the injection of a guided ascent.

    It is linearised about the reference flight: a vehicle without dispersions, a navigation without errors. Numbers are
    those of INJECTION, SI.

    reason : Reason why there is no covariance; empty if there is.
    reference : (n_number,). Numbers of the reference flight.
    target : (n_orbit,). Elements of the target orbit.
    mean : (n_number,). Mean minus target of the orbital elements; mean of the other numbers. To second order in the
        dispersions of the vehicle.
    second_order : (n_number,). Sigma due to the second-order effects of these dispersions.
    sources : (n_source,). Names of the error sources of navigation, then of the dispersions of the vehicle.
    n_navigation : Number of error sources of navigation.
    covariance : (n_source, n_number, n_number). By source. NaN for the perigee and apogee of a circular target.
    knowledge : (n_source, n_orbit). Variance of the achieved orbit minus the navigated orbit.
    execution : (n_source, n_orbit). Variance of the navigated orbit minus the target.
    """

    reason: str = ""
    reference: Floats = np.zeros(0)
    target: Floats = np.zeros(0)
    mean: Floats = np.zeros(0)
    second_order: Floats = np.zeros(0)
    sources: tuple[str, ...] = ()
    n_navigation: int = 0
    covariance: Floats = np.zeros((0, 0, 0))
    knowledge: Floats = np.zeros((0, 0))
    execution: Floats = np.zeros((0, 0))


class CovHistory(NamedTuple):
    """Linear covariance over a flight, in the reporting axes of RunBlock, SI.

    t : (n_hist,) s since lift-off. History times.
    formal_sigma : (n_hist, n_out). Standard deviation in the filter's own covariance.
    true_sigma : (n_hist, n_out). Standard deviation of the true error about its mean.
    mean : (n_hist, n_out). Mean of the true error.
    sources : (n_source,). Names of the error sources.
    budget : (n_hist, n_source, n_out). Variance of the true error by source; sums to `true_sigma` squared.
    formal_cov : (n_hist, n_out, n_out). The filter's own covariance.
    true_cov : (n_hist, n_out, n_out). Covariance of the true error about its mean.
    t_epoch : (n_epoch,) s since lift-off. Epochs.
    n_row : (n_epoch,). Number of scalar measurements.
    expected_nees : (n_hist,). Expected normalised estimation error squared.
    expected_nis : (n_epoch,). Expected sum of squared normalised innovations.
    false_rejection : (n_epoch,). Largest probability that the gate rejects a good scalar measurement.
    expected_row_nis : (n_epoch, n_row). Expected square of each normalised innovation; 0 for measurements not
        processed.
    decisions : (n_decision, 4). Fault decisions on the mean innovations, as in RunBlock.
    injection : Injection of a guided ascent; None without guidance.
    """

    t: Floats
    formal_sigma: Floats
    true_sigma: Floats
    mean: Floats
    sources: tuple[str, ...]
    budget: Floats
    formal_cov: Floats
    true_cov: Floats
    t_epoch: Floats
    n_row: NDArray[np.int32]
    expected_nees: Floats
    expected_nis: Floats
    false_rejection: Floats
    expected_row_nis: Floats
    decisions: Floats = NO_DECISIONS
    injection: InjectionLaw | None = None


class Output(NamedTuple):
    """A reported error component.

    quantity : Quantity, such as velocity.
    axis : Axis, such as north.
    unit : SI unit.
    label_unit : Display unit.
    label_factor : Factor from SI to the display unit.
    """

    quantity: str
    axis: str
    unit: str
    label_unit: str
    label_factor: float


class ProtectionRisks(NamedTuple):
    """Probabilities, at any one time, that the protection levels refer to.

    integrity_risk : Probability of an undetected error beyond the protection level.
    false_alarm : Probability of an alarm without a fault.
    satellite_fault : Probability that a satellite has failed.
    alarms : Whether every run is simulated with the sub-filters.
    """

    integrity_risk: float
    false_alarm: float
    satellite_fault: float
    alarms: bool = False


class CovarianceRequest(NamedTuple):
    """Results of linear covariance that a campaign requests for a case.

    event : Event of the diagnostics; if empty, injection or else the last event.
    events : Further events for the covariance by source.
    adjoint : Contribution of each source to the errors at the event, by time.
    sensitivity : Effect of each source's sigma on the errors at the event.
    observability : Observability by phase, or by windows.
    budget : Error budget by source over the flight.
    window : s. Length of the observability windows; 0: phases.
    nonlinearity : Measure of nonlinearity at every event and gap.
    error_bound : Whether the modelled noise bounds the error.
    spot_check : Number of simulation runs for the spot check; 0 none.
    seed : Seed of the campaign, for these runs.
    allan : s. Length of the IMU stream for the Allan deviation; 0 none.
    protection : Settings of the protection levels; None: none.
    """

    event: str = ""
    events: tuple[str, ...] = ()
    adjoint: bool = True
    sensitivity: bool = False
    observability: bool = True
    budget: bool = True
    window: float = 0.0
    nonlinearity: bool = True
    error_bound: bool = False
    spot_check: int = 0
    seed: int = 0
    allan: float = 0.0
    protection: ProtectionRisks | None = None


class AdjointBudget(NamedTuple):
    """Contribution of every error source to the navigation errors at an event, by the time at which it arose.

    time : s since lift-off. The event.
    edges : (n_bin + 1,) s. Edges of the time bins.
    sources : (n_source,). Names of the error sources.
    outputs : (9,). The navigation errors.
    contribution : (9, n_source, n_bin). Variance, SI; the sum over sources and bins is the true variance at `time`.
    """

    time: float
    edges: Floats
    sources: tuple[str, ...]
    outputs: tuple[Output, ...]
    contribution: Floats
