"""Records that several packages use: Motion, Reference, Sky, RunBlock, CovHistory, and requests to the last."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

# What a receiver does with a satellite, by number and by name: idle is neither looked for nor remembered.
IDLE, SEARCH, ACQUIRE, TRACK, LOST = range(5)
TRACKING = ("idle", "search", "acquire", "track", "lost")


# What a filter with a logic does, and why that changes, by number and by name. While it is aiding or predicting its
# outputs are corrected.
WAITING, CONVERGING, AIDING, PREDICTING, STOPPED = range(5)
MODES = ("waiting", "converging", "aiding", "predicting", "stopped")
REASONS = (
    "", "good samples in a row", "converged", "data lost", "data again", "data loss persists",
    "residual error persists", "covariance error persists",
    # what in particular was lost: the check at the input that a sample with a solution fails
    "checksum", "hardware", "time synchronisation", "no fresh solution", "dilution of precision",
)  # fmt: skip
# Flags that a receiver raises of its own output, in the order in which they are the reason, and where they begin.
FLAGS = ("checksum", "hardware", "time_sync")
FRESH = "fresh"
FIRST_CHECK = 8
NO_CHANGES = np.zeros((0, 5))

# What a filter that tests for faults has isolated, by number and by name.
OF_CHANNEL, OF_CLOCK, OF_INERTIAL, OF_UNIT, OF_SEPARATION = 1, 2, 3, 4, 5
ISOLATED = ("", "channel", "clock", "inertial", "unit", "separation")
NO_DECISIONS = np.zeros((0, 4))
# In a decision on inertial units, what stands in the place of a channel: this for the first, one less for the next.
FIRST_UNIT = -2


class Motion(NamedTuple):
    """True motion at given times; at a jump of thrust the value just after it. SI, frames i and b.

    t (n,) s since lift-off; r_i, v_i (n, 3); q_b_i (n, 4) unit quaternion, scalar first, body to inertial;
    f_b (n, 3) specific force; w_ib_b (n, 3) body rate.
    """

    t: Floats
    r_i: Floats
    v_i: Floats
    q_b_i: Floats
    f_b: Floats
    w_ib_b: Floats


class Reference(NamedTuple):
    """True motion on the ticks of an IMU, and the increments of an ideal one between them.

    t (n_imu + 1,); r_i, v_i (n_imu + 1, 3); q_b_i (n_imu + 1, 4); f_b, w_ib_b (n_imu + 1, 3) at the ticks;
    dtheta, dvel (n_imu, 3): integrals of body rate (rad) and specific force (m/s) over each tick, body frame.
    """

    t: Floats
    r_i: Floats
    v_i: Floats
    q_b_i: Floats
    f_b: Floats
    w_ib_b: Floats
    dtheta: Floats
    dvel: Floats


class Transition(NamedTuple):
    """A change of what the receiver does with a satellite: t s, name, states before and after by name, and why."""

    t: float
    satellite: str
    before: str
    after: str
    reason: str


class Sky(NamedTuple):
    """Satellites over a flight, each at the time of transmission of the signal received at the epoch.

    t (n_epoch,); names (n_sat,) such as "G05"; systems (n_sat,) letters as in RINEX; r_i (n_epoch, n_sat, 3) m at
    transmission; v_i (n_epoch, n_sat, 3) the
    derivative of r_i with respect to *reception* time; azimuth, elevation (n_epoch, n_sat) rad at the antenna in frame
    n; tracked (n_epoch, n_sat) bool: what is measured at the epoch.

    antenna (n_epoch, n_sat) number of the antenna that hears the satellite best; cn0 (n_epoch, n_sat) dB-Hz as the
    loops have it, NaN where there is no link budget or nothing is heard; range_sigma (m), rate_sigma (m/s) (n_epoch,
    n_sat) true white noise, phase_sigma (m) that of a carrier phase; continuous (n_epoch, n_sat) bool: the carrier was
    followed since the epoch before; state (n_epoch, n_sat) int8, see TRACKING; lever_arms (n_antenna, 3) m, phase
    centres from the inertial unit, body axes; transitions of the receiver's channels in order of time (none without a
    tracking card).
    """

    t: Floats
    names: tuple[str, ...]
    r_i: Floats
    v_i: Floats
    azimuth: Floats
    elevation: Floats
    tracked: NDArray[np.bool_]
    antenna: NDArray[np.int64]
    cn0: Floats
    range_sigma: Floats
    rate_sigma: Floats
    phase_sigma: Floats
    continuous: NDArray[np.bool_]
    state: NDArray[np.int8]
    lever_arms: Floats
    systems: tuple[str, ...]
    transitions: tuple[Transition, ...] = ()


class RunBlock(NamedTuple):
    """What a block of Monte-Carlo runs leaves. Error is truth minus estimate, in reporting axes (see layout.Output).

    first_run; t (n_hist,) s; err, sigma (n_run, n_hist, n_out) error and the filter's own one-sigma, SI;
    nees (n_run, n_hist); t_epoch (n_epoch,); nis (n_run, n_epoch) summed squares of normalised innovations of the
    accepted rows; n_row, n_reject (n_run, n_epoch) rows accepted and rejected by the gate; innovation
    (n_run, n_epoch, n_channel) normalised innovation before the gate, NaN where no row; failed (n_run,) int8, 0 good,
    1 not finite, 2 diverged (position error over the scenario's limit); t_failed (n_run,) s or NaN; changes (n_change,
    5) of what filters with a logic do, run after run: run, t s, mode before, mode after, reason (see MODES); decisions
    (n_decision, 4) of filters that test for faults: run, t s, what was isolated (see ISOLATED), channel of the filter
    that was excluded (-1 none, of inertial units see FIRST_UNIT).
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


class CovHistory(NamedTuple):
    """Linear covariance over a flight, in the same reporting axes as RunBlock.

    t (n_hist,); formal, true_sigma, mean (n_hist, n_out): the filter's own sigma, the sigma of the true error about its
    mean, that mean; sources (n_source,) names; budget (n_hist, n_source, n_out) variance of the true error by source
    (sums over sources to true_sigma squared); formal_cov, true_cov (n_hist, n_out, n_out) full matrices;
    t_epoch, n_row (n_epoch,); expected_nees (n_hist,), expected_nis (n_epoch,); false_rejection (n_epoch,)
    probability that the gate rejects a good measurement, of the most endangered row; decisions (n_decision, 4) of a
    filter that tests for faults, on the mean of its innovations, as in RunBlock.
    """

    t: Floats
    formal: Floats
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
    decisions: Floats = NO_DECISIONS


class Output(NamedTuple):
    """One reported error component: ``quantity`` with ``axis``, SI unit, and the unit and factor for people."""

    quantity: str
    axis: str
    unit: str
    label_unit: str
    label_factor: float


class Protecting(NamedTuple):
    """What protection levels hold for: probabilities of an error beyond it unnoticed, of an alarm without a fault, and
    that a satellite has failed, each at any one time; alarms: whether sub-filters are flown in every run.
    """

    integrity_risk: float
    false_alarm: float
    satellite_fault: float
    alarms: bool = False


class Asked(NamedTuple):
    """What linear covariance leaves of a case: budget by source over the flight; and of the event `at` (empty:
    injection, or else the last one) when each source acted, what a better one is worth, by source the covariance at
    `events` too; observability by phase, or by windows of that many seconds; nonlinearity at every event; bounds of
    the assumed noise; the runs of a spot check, with the campaign's seed; and of its inertial units the Allan deviation
    of a stream of `allan` s; protection levels, None: none.
    """

    at: str = ""
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
    protection: Protecting | None = None


class AdjointBudget(NamedTuple):
    """What every source put into the navigation errors at one time, by when it did.

    time s since lift-off; edges (n_bin + 1,) s of the bins of time; sources (n_source,) names; outputs the nine
    navigation errors; contribution (9, n_source, n_bin) variance, SI: over sources and bins it sums to the true
    variance at `time`.
    """

    time: float
    edges: Floats
    sources: tuple[str, ...]
    outputs: tuple[Output, ...]
    contribution: Floats
