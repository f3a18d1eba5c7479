"""Linear covariance of the injection of a guided ascent, by navigation errors and vehicle dispersions.

To first order, an injection parameter is a sum over the flight of navigation errors times sensitivities of the guided
ascent. One backward pass takes all of these sensitivities, so the variance includes the correlation of the errors over
time, source by source. Vehicle dispersions are independent of the navigation errors, which are those along the nominal
flight.
"""

from itertools import combinations

import numpy as np

from lvnav_trade.quantities.records import INJECTION, ORBIT, Floats, InjectionLaw
from lvnav_trade.trajectory.guided.orbit_numbers import AXIS, append_apsides, orbit_difference
from lvnav_trade.trajectory.guided.sensitivity import InjectionSensitivity

_BASE = [k for k, name in enumerate(INJECTION) if name not in ("perigee", "apogee")]
"""Injection parameters from which perigee and apogee follow."""
_PAIRS = list(combinations(range(len(_BASE)), 2))


def injection_rows(derivatives: InjectionSensitivity) -> Floats:
    """Return the weights (n_t, n_row, 9) of the navigation errors at each time in the sums that `injection_law` needs.

    The sums are the parameters of `_BASE`, the sum of each pair of them, and the orbit errors of knowledge and of
    execution. The parameters of `_BASE` are scaled to similar magnitudes first, because covariances follow from
    differences of variances.
    """
    sizes = _sizes(derivatives.target)
    scaled_sensitivity = derivatives.navigation[:, _BASE] / sizes[:, None]
    pair_sums = [scaled_sensitivity[:, i] + scaled_sensitivity[:, j] for i, j in _PAIRS]
    sums = np.stack(pair_sums, axis=1)
    orbit = derivatives.navigation[:, : len(ORBIT)]
    knowledge = derivatives.knowledge
    execution = orbit - knowledge
    return np.concatenate([scaled_sensitivity, sums, knowledge, execution], axis=1)


def injection_law(
    derivatives: InjectionSensitivity, sources: tuple[str, ...], variance: Floats, mean: Floats
) -> InjectionLaw:
    """Return the linear covariance of an injection.

    Parameters
    ----------
    derivatives
        Sensitivities of the injection to navigation errors and vehicle dispersions.
    sources
        (n_source,). Names of the navigation error sources.
    variance
        (n_row, n_source). Variance of each sum of `injection_rows` by source.
    mean
        (n_t, 9) SI. Mean navigation errors.

    Returns
    -------
    InjectionLaw
        Mean, covariance by source, and second-order terms of the injection.
    """
    n_orbit = len(ORBIT)
    reference = derivatives.reference
    target = derivatives.target
    curvature = derivatives.curvature
    navigation = _navigation_covariance(target, variance)
    # slopes are per sigma of each independent draw, so their products are covariances
    vehicle = np.array([slopes.T @ slopes for _, slopes in derivatives.vehicle])
    vehicle = vehicle.reshape(-1, *navigation.shape[1:])
    vehicle_variance = np.diagonal(vehicle, axis1=1, axis2=2)[:, :n_orbit]
    no_knowledge = np.zeros_like(vehicle_variance)
    n_sum = len(_BASE) + len(_PAIRS)
    knowledge, execution = np.split(variance[n_sum:], 2)
    offset = reference.copy()
    offset[:n_orbit] = orbit_difference(reference[None, :n_orbit], target[None])[0]
    # the second-order change c z^2 of a normal draw z has the mean c and the variance 2 c^2
    first_order = np.einsum("kne,ke->n", derivatives.navigation, mean)
    second_order = curvature.sum(axis=0)
    second_order_variance = 2.0 * np.sum(curvature**2, axis=0)
    vehicle_names = [name.replace("_", " ") for name, _ in derivatives.vehicle]
    return InjectionLaw(
        reference=reference,
        target=target,
        mean=offset + first_order + second_order,
        second_order=np.sqrt(second_order_variance),
        sources=(*sources, *vehicle_names),
        n_navigation=len(sources),
        covariance=np.concatenate([navigation, vehicle]),
        knowledge=np.concatenate([knowledge.T, no_knowledge]),
        execution=np.concatenate([execution.T, vehicle_variance]),
    )


def _navigation_covariance(target: Floats, variance: Floats) -> Floats:
    """Return the covariance of all injection parameters by navigation error source, (n_source, n, n).

    Cov(x, y) = (Var(x + y) - Var x - Var y) / 2 of the parameters of `_BASE`, from which the others follow linearly.
    """
    n = len(_BASE)
    n_source = variance.shape[1]
    diagonal = range(n)
    base = np.zeros((n_source, n, n))
    base[:, diagonal, diagonal] = variance[:n].T
    for row, (i, j) in enumerate(_PAIRS, start=n):
        covariance = 0.5 * (variance[row] - variance[i] - variance[j])
        base[:, i, j] = covariance
        base[:, j, i] = covariance
    sizes = _sizes(target)
    covariances = base * np.outer(sizes, sizes)
    base_axes = np.eye(len(INJECTION))[_BASE]
    from_base = append_apsides(base_axes, target).T  # (n_parameter, n)
    return np.asarray(from_base @ covariances @ from_base.T)


def merge_sources(law: InjectionLaw | None) -> InjectionLaw | None:
    """Return the law of an injection with two sources: navigation and vehicle."""
    if law is None or law.reason:
        return law

    def sums(values: Floats) -> Floats:
        navigation, vehicle = np.split(values, [law.n_navigation])
        return np.array([navigation.sum(axis=0), vehicle.sum(axis=0)])

    return law._replace(
        sources=("navigation", "vehicle"),
        n_navigation=1,
        covariance=sums(law.covariance),
        knowledge=sums(law.knowledge),
        execution=sums(law.execution),
    )


def _sizes(target: Floats) -> Floats:
    """Return the scale of each parameter of `_BASE`, about a kilometre of the orbit, (n,): m, 1, rad, s, kg."""
    angle = 1e3 / target[AXIS]
    return np.array([1e3, angle, angle, angle, angle, 1.0, 10.0])
