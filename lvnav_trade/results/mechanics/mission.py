"""Errors of a mission's numbers (orbit, point of impact, correction), from errors of velocity and position together.

The error at an event is that of the orbit, or point of impact: of the true state less that of the estimate. Where
guidance brings the estimate to the target, the same error, with the same sign, is that of the injection.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from lvnav_trade.quantities import frames
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.results.mechanics import impulses, orbits
from lvnav_trade.results.mechanics.orbits import coast, impact, offsets
from lvnav_trade.results.tables.read import Tables, once, pick

# Steps of the central differences, m/s and m: their second order is 1e-6 of the first, round-off less.
STEP = np.array([1e-2] * 3 + [10.0] * 3)
DRAWS = 2**11
QUANTILE_DRAWS = 2**15  # of a quantile of a requirement: 88 of them lie beyond 99.73 %
_LEAST_SIGMAS = 3.0
_OF_ORBIT = (
    "semi_major_axis_error",
    "eccentricity_error",
    "perigee_error",
    "apogee_error",
    "inclination_error",
    "node_error",
    "eccentricity_vector_error",
)


class State(NamedTuple):
    """The true state at an event or time: r_i, v_i (3,), Earth angle (rad), turn (3, 3) from the reporting axes."""

    event: str
    t: float
    r_i: Floats
    v_i: Floats
    earth_angle: float
    turn: Floats


class Epochs(NamedTuple):
    """Which elements of the orbit are compared, and when.

    is_mean : Averaged over a revolution (first order in J2, see `meanorbit`), or osculating.
    estimated : s after the event. Epoch of the estimated elements.
    true : s after the event. Epoch of the true ones.
    """

    is_mean: bool = True
    estimated: float = 0.0
    true: float = 0.0


class Law(NamedTuple):
    """LinCov of an error of velocity and position, frame i: mean (6,), true and formal covariance (6, 6), SI."""

    mean: Floats
    true: Floats
    formal: Floats


@once
def states(tables: Tables, case: str) -> list[State]:
    """Return the stored true states of a case: at events (named) and over the flight (no name), in the order stored."""
    rows = pick(tables.states, case=case)
    r_i, v_i = rows.filter(regex=r"^position_._m$"), rows.filter(regex=r"^velocity_._m_per_s$")
    turns = frames.matrices(rows.filter(regex=r"^axes_q").to_numpy())
    columns = (rows.event, rows.t_s, r_i.to_numpy(), v_i.to_numpy(), rows.earth_angle_rad, turns)
    return [State(*values) for values in zip(*columns, strict=True)]


def state_at(tables: Tables, case: str, event: str) -> State | None:
    """Return the true state at an event; None where it is not stored."""
    return next((state for state in states(tables, case) if state.event == event and event), None)


@once
def laws(tables: Tables, case: str) -> list[Law]:
    """Return LinCov of velocity and position at each of `states`."""
    rows = pick(tables.joint, case=case)
    return laws_in(*(rows[name].to_numpy(dtype=float) for name in ("mean_si", "true_si2", "formal_si2")))


def laws_in(mean: Floats, true: Floats, formal: Floats) -> list[Law]:
    """Return the laws of columns (21 n_state,): upper triangles of the covariances, and the mean on the diagonal."""
    n = len(mean) // 21
    i, j = np.triu_indices(6)

    def matrices(column: Floats) -> Floats:
        found = np.zeros((n, 6, 6))
        found[:, i, j] = found[:, j, i] = column.reshape(n, 21)
        return found

    means = mean.reshape(n, 21)[:, i == j]
    return [Law(*parts) for parts in zip(means, matrices(true), matrices(formal), strict=True)]


def resolved(bias: Floats, sigma: ArrayLike) -> Floats:
    """Return biases (...,) to a millionth of their sigmas (...,): what is smaller is rounding and differs by machine.

    Unchanged where the sigma is zero.
    """
    known = np.asarray(sigma) > 0.0
    unit = np.where(known, sigma, 1.0)
    return np.where(known, np.round(bias / unit, 6) * unit + 0.0, bias)


def law_at(tables: Tables, case: str, event: str) -> Law:
    """Return LinCov of velocity and position at an event, of which the state is stored."""
    return laws(tables, case)[[state.event for state in states(tables, case)].index(event)]


def run_errors(tables: Tables, case: str, state: State) -> tuple[Floats, Bools]:
    """Return the errors (n_run, 6) of velocity and position, frame i, at the state's event, and which runs failed."""
    chosen, outputs = pick(tables.runs, case=case, event=state.event), pick(tables.outputs, case=case)
    outputs = outputs[outputs.axis != "3d"]
    velocity, position = (
        chosen[[f"{quantity}_{axis}_error_{suffix}" for axis in outputs.axis[outputs.quantity == quantity]]]
        for quantity, suffix in (("velocity", "m_per_s"), ("position", "m"))
    )
    failed = chosen.failure.to_numpy() != ""
    return turned(state, velocity.to_numpy(dtype=float), position.to_numpy(dtype=float), failed)


def turned(state: State, velocity: Floats, position: Floats, failed: Bools) -> tuple[Floats, Bools]:
    """Return errors (n_run, 6) of velocity and position in frame i, from (n_run, 3) each in the reporting axes, and
    which runs failed (n_run,): also those whose error is not finite.
    """
    error = np.concatenate([part @ state.turn.T for part in (velocity, position)], axis=1)
    return error, failed | ~np.isfinite(error).all(axis=1)


def good_errors(tables: Tables, case: str, state: State) -> Floats:
    """Return `run_errors` of the runs that did not fail."""
    error, failed = run_errors(tables, case, state)
    return error[~failed]


# --- errors of the mission's numbers ----------------------------------------------------------------------------------


def mean_orbit(state: State) -> orbits.Orbit:
    """Return the mean orbit of a true state, found once for all cases that fly alike."""
    return _mean_orbit(state.r_i.tobytes(), state.v_i.tobytes())


@lru_cache(maxsize=256)
def _mean_orbit(r_i: bytes, v_i: bytes) -> orbits.Orbit:
    return orbits.mean(np.frombuffer(r_i), np.frombuffer(v_i))


def orbit_errors(state: State, error: Floats) -> dict[str, Floats]:
    """Return the errors of the mean orbit, each (n, 1), the eccentricity vector's (n, 2), for state errors (n, 6).

    The eccentricity vector is resolved along the true ascending node and 90 degrees ahead of it.
    """
    return _differences(mean_orbit(state), orbits.mean(state.r_i - error[:, 3:], state.v_i - error[:, :3]))


def orbit_errors_at(state: State, error: Floats, epochs: Epochs) -> dict[str, Floats]:
    """Return the errors of `orbit_errors` of elements at epochs after the state: true and estimated state coast to
    theirs about the oblate Earth, and the true elements of the one less the estimated ones of the other.
    """
    elements = orbits.mean if epochs.is_mean else orbits.osculating
    true = elements(*(part[0] for part in coast(state.r_i, state.v_i, epochs.true)))
    estimated = elements(*coast(state.r_i - error[:, 3:], state.v_i - error[:, :3], epochs.estimated))
    return _differences(true, estimated)


def _differences(true: orbits.Orbit, estimated: orbits.Orbit) -> dict[str, Floats]:
    """Return the elements of one orbit less those of n others, as `orbit_errors` does."""
    node = np.array([np.cos(true.node), np.sin(true.node), 0.0])
    plane = np.stack([node, np.cross(frames.unit(true.h_i), node)])
    names = [name.removesuffix("_error") for name in _OF_ORBIT[:-1]]
    found = {f"{name}_error": (getattr(true, name) - getattr(estimated, name))[:, None] for name in names}
    found["node_error"] = np.mod(found["node_error"] + np.pi, 2.0 * np.pi) - np.pi
    return found | {"eccentricity_vector_error": (true.e_i - estimated.e_i) @ plane.T}


def impact_errors(state: State, error: Floats) -> Floats:
    """Return how far the true point of impact lies from the estimated one, down-range and cross-range (n, 2), m."""
    return impacts_errors([state], [error])[0]


def impacts_errors(states: Sequence[State], errors: Sequence[Floats]) -> list[Floats]:
    """Return `impact_errors` of several states, each with its errors: all falls together take little longer than one.

    NaN where the true state has no point of impact.
    """
    r_i, v_i = np.array([state.r_i for state in states]), np.array([state.v_i for state in states])
    angle = np.array([state.earth_angle for state in states])
    true, of = impact(r_i, v_i, angle), np.repeat(np.arange(len(states)), [len(error) for error in errors])
    off, estimated = np.concatenate(errors), np.full((len(of), 3), np.nan)
    falls = np.isfinite(true.fall)[of]
    if falls.any():
        some = of[falls]
        found = impact(r_i[some] - off[falls, 3:], v_i[some] - off[falls, :3], angle[some], lowest=0.0)
        estimated[falls] = found.r_e
    apart = -offsets(true.r_e[of], estimated, true.heading[of])
    return np.split(apart, np.cumsum([len(error) for error in errors])[:-1])


def signed(state: State, error: Floats, metric: str) -> Floats:
    """Return a metric's errors (n, k), SI, for errors of velocity and position (n, 6), frame i; a size for a
    correction. NaN where the number is not defined.
    """
    if metric == "correction_delta_v":
        return impulses.least_at(state.r_i, state.v_i, error).delta_v[:, None]
    if metric.startswith("impact_error"):
        found = impact_errors(state, error)
        axis = metric.removeprefix("impact_error_")
        return found[:, [("down", "cross").index(axis)]] if axis in ("down", "cross") else found
    return orbit_errors(state, error)[metric]


# --- by linear covariance ---------------------------------------------------------------------------------------------


def jacobian(state: State, metric: str) -> Floats:
    """Return the derivative (k, 6) of a metric's error by that of velocity and position, by central differences."""
    if metric in _OF_ORBIT:
        return _orbit_slopes(state.r_i.tobytes(), state.v_i.tobytes())[metric]
    return _slope(state.r_i.tobytes(), state.v_i.tobytes(), state.earth_angle, metric)


@lru_cache(maxsize=256)
def _slope(r_i: bytes, v_i: bytes, earth_angle: float, metric: str) -> Floats:
    """Return the derivative (k, 6) of one error at a state, found once for all cases that fly alike."""
    state = State("", 0.0, np.frombuffer(r_i), np.frombuffer(v_i), earth_angle, np.eye(3))
    slope = derivative(lambda error: signed(state, error, metric))
    slope.flags.writeable = False
    return slope


@lru_cache(maxsize=256)
def _orbit_slopes(r_i: bytes, v_i: bytes) -> dict[str, Floats]:
    """Return the derivatives (k, 6) of all errors of the orbit at a state of which the numbers are given."""
    state = State("", 0.0, np.frombuffer(r_i), np.frombuffer(v_i), 0.0, np.eye(3))

    def errors(error: Floats) -> Floats:
        found = orbit_errors(state, error)
        return np.concatenate([found[name] for name in _OF_ORBIT], axis=1)

    slopes = derivative(errors)
    slopes.flags.writeable = False
    ends = np.cumsum([2 if "vector" in name else 1 for name in _OF_ORBIT])
    return dict(zip(_OF_ORBIT, np.split(slopes, ends[:-1]), strict=True))


def derivative(function: Callable[[Floats], Floats]) -> Floats:
    """Return the derivative (k, 6), at no error, of a function of errors (n, 6) with values (n, k)."""
    steps = np.diag(STEP)
    values = function(np.concatenate([steps, -steps]))
    return np.asarray(((values[:6] - values[6:]) / (2.0 * STEP[:, None])).T)


def draws(mean: Floats, covariance: Floats, count: int = DRAWS, sizes: Floats = STEP) -> Floats:
    """Return `count` (a power of two) errors (count, n) that fill the Gaussian evenly (Sobol's points), always the
    same.

    sizes : (n,). About how large each component is; 0 of one that does not vary.
    """
    from scipy.stats import qmc  # takes half a second, which only the draws need

    points = qmc.Sobol(len(mean), scramble=False).random_base2(round(np.log2(count))) + 0.5 / count
    unit = np.where(sizes > 0.0, sizes, 1.0)
    variance, axes = np.linalg.eigh(covariance / np.outer(unit, unit))
    roots = unit[:, None] * axes * np.sqrt(np.maximum(variance, 0.0))
    return np.asarray(mean + special.ndtri(points) @ roots.T)


def near_circular(state: State, covariance: Floats) -> str:
    """Say why the first-order sigma of perigee, apogee and eccentricity does not apply; empty where it does.

    Their derivative does not exist at a circular orbit: within three sigma of one their errors are no Gaussian.
    """
    e = float(mean_orbit(state).eccentricity)
    slope = jacobian(state, "eccentricity_vector_error")
    if not np.isfinite(slope).all():
        return "no closed orbit"
    sigma = float(np.sqrt(np.linalg.eigvalsh(slope @ covariance @ slope.T)[-1]))
    if e >= _LEAST_SIGMAS * sigma:
        return ""
    return f"the orbit is circular to within {_LEAST_SIGMAS:g} sigma (e = {e:.2g}, sigma {sigma:.2g})"


def applies(state: State, metric: str, covariance: Floats) -> str:
    """Say why first-order covariance does not describe a metric at a state; empty where it does."""
    if metric in ("perigee_error", "apogee_error", "eccentricity_error"):
        return near_circular(state, covariance)
    if metric == "correction_delta_v":
        return "a sum of impulses is no linear function of the error"
    return "" if np.isfinite(jacobian(state, metric)).all() else "not defined there"


def drawn_of(state: State, law: Law, metric: str) -> Floats | None:
    """Return the sizes (n,) of perigee, apogee or eccentricity errors, growing, of draws of linear covariance's
    Gaussian of velocity and position through the map itself, SI.

    They stand where `near_circular` says that the first order does not. None for other metrics, and for an orbit that
    is not closed.
    """
    if metric not in ("perigee_error", "apogee_error", "eccentricity_error"):
        return None
    if not np.isfinite(jacobian(state, "eccentricity_vector_error")).all():
        return None
    size = np.sort(np.abs(orbit_errors(state, draws(law.mean, law.true, QUANTILE_DRAWS))[metric][:, 0]))
    return size if np.isfinite(size).all() else None


def expected_of(state: State, law: Law, metric: str) -> tuple[Floats, Floats] | str:
    """Return mean (k,) and covariance (k, k) of a mission metric by linear covariance, SI, or why it does not apply.

    k is 2 for the point of impact and the eccentricity vector.
    """
    reason = applies(state, metric, law.true)
    if reason:
        return reason
    slope = jacobian(state, metric)
    return slope @ law.mean, slope @ law.true @ slope.T
