"""Errors of mission quantities (orbit, impact point, correction) from joint errors of velocity and position.

An error at an event is the quantity of the true state less that of the estimated state. If guidance steers the
estimate to the target, the error of the injection is the same, with the same sign.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from lvnav_trade.quantities import frames
from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.mechanics import impulses, orbits
from lvnav_trade.results.mechanics.free_fall import coast, impact, offsets
from lvnav_trade.results.mechanics.stored_states import ErrorGaussian, State

# Steps of the central differences, m/s and m: their second order is 1e-6 of the first, round-off less.
STEP = np.array([1e-2] * 3 + [10.0] * 3)
DRAWS = 2**11
QUANTILE_DRAWS = 2**15  # for the quantile of a requirement: 88 draws lie beyond 99.73 %
_LEAST_SIGMAS = 3.0
_ORBIT_METRICS = (
    "semi_major_axis_error",
    "eccentricity_error",
    "perigee_error",
    "apogee_error",
    "inclination_error",
    "node_error",
    "eccentricity_vector_error",
)
# Metrics with no derivative at a circular orbit
_NONLINEAR_METRICS = ("perigee_error", "apogee_error", "eccentricity_error")


class ElementEpochs(NamedTuple):
    """Type and epochs of the orbital elements that are compared.

    is_mean : Averaged over a revolution (first order in J2, see `orbits`), or osculating.
    estimated_epoch : s after the event. Epoch of the estimated elements.
    true_epoch : s after the event. Epoch of the true elements.
    """

    is_mean: bool = True
    estimated_epoch: float = 0.0
    true_epoch: float = 0.0


def round_bias(bias: Floats, sigma: ArrayLike) -> Floats:
    """Return biases (...,) rounded to a millionth of their sigmas (...,).

    Smaller digits are rounding errors, which differ between machines. A bias with zero sigma is unchanged.
    """
    has_sigma = np.asarray(sigma) > 0.0
    unit = np.where(has_sigma, sigma, 1.0)
    return np.where(has_sigma, np.round(bias / unit, 6) * unit + 0.0, bias)


# --- errors of mission quantities -------------------------------------------------------------------------------------


def mean_orbit(state: State) -> orbits.OrbitVectors:
    """Return the mean orbit of a true state, cached for all cases with the same trajectory."""
    return _mean_orbit(state.r_i.tobytes(), state.v_i.tobytes())


@lru_cache(maxsize=256)
def _mean_orbit(r_i: bytes, v_i: bytes) -> orbits.OrbitVectors:
    return orbits.mean(np.frombuffer(r_i), np.frombuffer(v_i))


def orbit_errors(state: State, error: Floats) -> dict[str, Floats]:
    """Return the errors of the mean orbit by metric.

    Parameters
    ----------
    state : State
        True state.
    error : (n, 6) array
        Errors of velocity (m/s) and position (m), frame i.

    Returns
    -------
    dict of str to (n, 1) array
        True minus estimated elements, SI. The error of the eccentricity vector is (n, 2): along the true ascending
        node, and 90 degrees ahead.
    """
    estimated_orbit = orbits.mean(state.r_i - error[:, 3:], state.v_i - error[:, :3])
    return _element_differences(mean_orbit(state), estimated_orbit)


def orbit_errors_at(state: State, error: Floats, epochs: ElementEpochs) -> dict[str, Floats]:
    """Return the errors of `orbit_errors` with elements at epochs after the state.

    Parameters
    ----------
    state : State
        True state.
    error : (n, 6) array
        Errors of velocity (m/s) and position (m), frame i.
    epochs : ElementEpochs
        Type and epochs of the elements.

    Returns
    -------
    dict of str to array
        Errors by metric, as `orbit_errors`.

    Notes
    -----
    The true and the estimated state coast to their epochs about the oblate Earth. The error is the true elements at the
    true epoch minus the estimated elements at the estimated epoch.
    """
    elements = orbits.mean if epochs.is_mean else orbits.osculating
    r_i, v_i = coast(state.r_i, state.v_i, epochs.true_epoch)
    true_orbit = elements(r_i[0], v_i[0])
    estimated_r_i = state.r_i - error[:, 3:]
    estimated_v_i = state.v_i - error[:, :3]
    estimated_state = coast(estimated_r_i, estimated_v_i, epochs.estimated_epoch)
    estimated_orbit = elements(*estimated_state)
    return _element_differences(true_orbit, estimated_orbit)


def _element_differences(true_orbit: orbits.OrbitVectors, estimated_orbit: orbits.OrbitVectors) -> dict[str, Floats]:
    """Return the elements of an orbit minus those of n other orbits, as `orbit_errors`."""
    differences: dict[str, Floats] = {}
    for metric in _ORBIT_METRICS[:-1]:
        element = metric.removesuffix("_error")
        difference = getattr(true_orbit, element) - getattr(estimated_orbit, element)
        differences[metric] = difference[:, None]
    differences["node_error"] = np.mod(differences["node_error"] + np.pi, 2.0 * np.pi) - np.pi

    node = np.array([np.cos(true_orbit.node), np.sin(true_orbit.node), 0.0])
    ahead = np.cross(frames.unit(true_orbit.h_i), node)
    plane = np.stack([node, ahead])
    differences["eccentricity_vector_error"] = (true_orbit.e_i - estimated_orbit.e_i) @ plane.T
    return differences


def impact_errors(state: State, error: Floats) -> Floats:
    """Return the true impact point minus the estimated impact point.

    Parameters
    ----------
    state : State
        True state.
    error : (n, 6) array
        Errors of velocity (m/s) and position (m), frame i.

    Returns
    -------
    (n, 2) array
        Down-range and cross-range errors (m); NaN if the true state has no impact point.
    """
    return impacts_errors([state], [error])[0]


def impacts_errors(states: Sequence[State], errors: Sequence[Floats]) -> list[Floats]:
    """Return `impact_errors` of several states, each with its own errors.

    All falls are integrated together, which takes hardly longer than one. NaN if the true state has no impact point.
    """
    r_i = np.array([state.r_i for state in states])
    v_i = np.array([state.v_i for state in states])
    angle = np.array([state.earth_angle for state in states])
    counts = [len(error) for error in errors]
    index = np.repeat(np.arange(len(states)), counts)  # state of each error
    error = np.concatenate(errors)

    true = impact(r_i, v_i, angle)
    estimated_e = np.full((len(index), 3), np.nan)
    has_impact = np.isfinite(true.fall)[index]
    if has_impact.any():
        k = index[has_impact]
        estimated_r_i = r_i[k] - error[has_impact, 3:]
        estimated_v_i = v_i[k] - error[has_impact, :3]
        estimated_impact = impact(estimated_r_i, estimated_v_i, angle[k], lowest=0.0)
        estimated_e[has_impact] = estimated_impact.r_e
    point_error = -offsets(true.r_e[index], estimated_e, true.heading[index])
    return np.split(point_error, np.cumsum(counts)[:-1])


def metric_errors(state: State, error: Floats, metric: str) -> Floats:
    """Return the error of a mission metric for state errors.

    Parameters
    ----------
    state : State
        The true state.
    error : (n, 6) array
        Errors of velocity (m/s) and position (m), frame i.
    metric : str
        Name of the metric.

    Returns
    -------
    (n, k) array
        True less estimated, SI; for a correction its delta-v. NaN if the quantity is undefined.
    """
    if metric == "correction_delta_v":
        return impulses.least_state_correction(state.r_i, state.v_i, error).delta_v[:, None]
    if not metric.startswith("impact_error"):
        return orbit_errors(state, error)[metric]
    point_error = impact_errors(state, error)
    if metric == "impact_error_down":
        return point_error[:, [0]]
    if metric == "impact_error_cross":
        return point_error[:, [1]]
    return point_error


# --- by linear covariance ---------------------------------------------------------------------------------------------


def jacobian(state: State, metric: str) -> Floats:
    """Return the derivative (k, 6) of a metric's error by velocity and position, with central differences."""
    r_i = state.r_i.tobytes()
    v_i = state.v_i.tobytes()
    if metric in _ORBIT_METRICS:
        return _orbit_slopes(r_i, v_i)[metric]
    return _slope(r_i, v_i, state.earth_angle, metric)


@lru_cache(maxsize=256)
def _slope(r_i: bytes, v_i: bytes, earth_angle: float, metric: str) -> Floats:
    """Return the derivative (k, 6) of an error at a state, cached for all cases with the same trajectory."""
    state = _cached_state(r_i, v_i, earth_angle)
    slope = derivative(lambda error: metric_errors(state, error, metric))
    slope.flags.writeable = False
    return slope


@lru_cache(maxsize=256)
def _orbit_slopes(r_i: bytes, v_i: bytes) -> dict[str, Floats]:
    """Return the derivatives (k, 6) of all errors of the orbit at a state, cached by its numbers."""
    state = _cached_state(r_i, v_i, 0.0)

    def errors(error: Floats) -> Floats:
        """Return the errors (n, k) of all metrics of the orbit."""
        error_by_metric = orbit_errors(state, error)
        return np.concatenate([error_by_metric[metric] for metric in _ORBIT_METRICS], axis=1)

    slopes = derivative(errors)
    slopes.flags.writeable = False
    sizes = [2 if "vector" in metric else 1 for metric in _ORBIT_METRICS]
    slope_by_metric = np.split(slopes, np.cumsum(sizes)[:-1])
    return dict(zip(_ORBIT_METRICS, slope_by_metric, strict=True))


def _cached_state(r_i: bytes, v_i: bytes, earth_angle: float) -> State:
    """Return the state whose position and velocity are the key of a cache."""
    return State(
        event="",
        t=0.0,
        r_i=np.frombuffer(r_i),
        v_i=np.frombuffer(v_i),
        earth_angle=earth_angle,
        turn=np.eye(3),
    )


def derivative(function: Callable[[Floats], Floats]) -> Floats:
    """Return the derivative (k, 6) at zero error of a function that maps errors (n, 6) to values (n, k)."""
    steps = np.diag(STEP)
    values = function(np.concatenate([steps, -steps]))
    difference = values[:6] - values[6:]
    return np.asarray((difference / (2.0 * STEP[:, None])).T)


def draws(mean: Floats, covariance: Floats, count: int = DRAWS, sizes: Floats = STEP) -> Floats:
    """Return quasi-random draws of a Gaussian (Sobol points), the same in every call.

    Parameters
    ----------
    mean : (n,) array
        Mean.
    covariance : (n, n) array
        Covariance.
    count : int
        Number of draws, a power of two.
    sizes : (n,) array
        Magnitude of each component, which scales the covariance before it is factored; 0 for a constant.

    Returns
    -------
    (count, n) array
        Draws, in the unit of the mean.
    """
    from scipy.stats import qmc  # takes half a second, which only the draws need

    sobol = qmc.Sobol(len(mean), scramble=False)
    # Half a step moves the first point away from zero, whose normal deviate is infinite.
    points = sobol.random_base2(round(np.log2(count))) + 0.5 / count
    scale = np.where(sizes > 0.0, sizes, 1.0)
    scaled_covariance = covariance / np.outer(scale, scale)
    variance, axes = np.linalg.eigh(scaled_covariance)
    # R with R R' = covariance
    root = scale[:, None] * axes * np.sqrt(np.maximum(variance, 0.0))
    normals = special.ndtri(points)
    return np.asarray(mean + normals @ root.T)


def near_circular_reason(state: State, covariance: Floats) -> str:
    """Return the reason why the first-order sigma of perigee, apogee and eccentricity is invalid; empty if it is valid.

    Their derivative does not exist at a circular orbit. Within three sigma of a circular orbit the errors are not
    Gaussian. The argument `covariance` (6, 6) is that of velocity (m/s) and position (m), frame i.
    """
    e = float(mean_orbit(state).eccentricity)
    slope = jacobian(state, "eccentricity_vector_error")
    if not np.isfinite(slope).all():
        return "no closed orbit"
    vector_covariance = slope @ covariance @ slope.T
    sigma = float(np.sqrt(np.linalg.eigvalsh(vector_covariance)[-1]))
    if e >= _LEAST_SIGMAS * sigma:
        return ""
    return f"the orbit is circular to within {_LEAST_SIGMAS:g} sigma (e = {e:.2g}, sigma {sigma:.2g})"


def nonlinearity_reason(state: State, metric: str, covariance: Floats) -> str:
    """Return the reason why first-order covariance does not describe a metric at a state; empty if it does.

    Parameters
    ----------
    state : State
        True state.
    metric : str
        Name of the mission metric.
    covariance : (6, 6) array
        Covariance of the errors of velocity (m/s) and position (m), frame i.
    """
    if metric in _NONLINEAR_METRICS:
        return near_circular_reason(state, covariance)
    if metric == "correction_delta_v":
        return "a sum of impulses is no linear function of the error"
    if not np.isfinite(jacobian(state, metric)).all():
        return "not defined there"
    return ""


def magnitude_sample(state: State, law: ErrorGaussian, metric: str) -> Floats | None:
    """Return sorted magnitudes of perigee, apogee or eccentricity errors, from draws of the Gaussian of the state
    error.

    The draws pass through the exact relation. They replace the first order where `near_circular_reason` rejects it.

    Parameters
    ----------
    state : State
        True state.
    law : ErrorGaussian
        Gaussian of the errors of velocity and position.
    metric : str
        Name of the mission metric.

    Returns
    -------
    (n,) array or None
        Magnitudes (SI), increasing. None for other metrics, and for an orbit that is not closed.
    """
    if metric not in _NONLINEAR_METRICS:
        return None
    if not np.isfinite(jacobian(state, "eccentricity_vector_error")).all():
        return None
    error = draws(law.mean, law.true, QUANTILE_DRAWS)
    magnitude = np.abs(orbit_errors(state, error)[metric][:, 0])
    magnitude.sort()
    if not np.isfinite(magnitude).all():
        return None
    return magnitude


def mean_and_covariance(state: State, law: ErrorGaussian, metric: str) -> tuple[Floats, Floats] | str:
    """Return mean and covariance of a mission metric by linear covariance, or the reason why it does not apply.

    Parameters
    ----------
    state : State
        True state.
    law : ErrorGaussian
        Gaussian of the errors of velocity and position.
    metric : str
        Name of the mission metric.

    Returns
    -------
    tuple of (k,) array and (k, k) array, or str
        SI. k is 2 for the impact point and the eccentricity vector, otherwise 1.
    """
    reason = nonlinearity_reason(state, metric, law.true)
    if reason:
        return reason
    slope = jacobian(state, metric)
    return slope @ law.mean, slope @ law.true @ slope.T
