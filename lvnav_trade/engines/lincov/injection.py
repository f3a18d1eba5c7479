"""Linear covariance of the injection of a guided ascent: what navigation errors and the vehicle make of it.

A number of the injection is, to first order, a sum over the flight of navigation errors times derivatives of the guided
flight. One backward pass takes all of these derivatives along, so that the correlation of the errors over time is in
the variance, source by source. The sources of the vehicle are independent of the navigation, whose errors are those
along the nominal flight.
"""

from itertools import combinations

import numpy as np

from lvnav_trade.records import INJECTION, ORBIT, Floats, InjectionLaw
from lvnav_trade.world.guided.orbit import AXIS, orbit_difference, with_apsides
from lvnav_trade.world.guided.sensitivity import Sensitivity

_BASE = [k for k, name in enumerate(INJECTION) if name not in ("perigee", "apogee")]
"""Numbers from which perigee and apogee follow."""
_PAIRS = list(combinations(range(len(_BASE)), 2))


def injection_rows(found: Sensitivity) -> Floats:
    """Return the rows (n_t, n_row, 9) by the navigation errors at each time whose variances `injection_law` takes.

    They are those of `_BASE`, those of the sum of each two of them, those of the knowledge and of the execution of the
    orbit. Each of `_BASE` is brought to about the same size first, since a covariance is a difference of variances.
    """
    total = found.navigation[:, _BASE] / _sizes(found.target)[:, None]
    sums = np.stack([total[:, i] + total[:, j] for i, j in _PAIRS], axis=1)
    execution = found.navigation[:, : len(ORBIT)] - found.knowledge
    return np.concatenate([total, sums, found.knowledge, execution], axis=1)


def injection_law(found: Sensitivity, sources: tuple[str, ...], variance: Floats, mean: Floats) -> InjectionLaw:
    """Return linear covariance of an injection.

    Parameters
    ----------
    found : Sensitivity
    sources : (n_source,). Names of the error sources of navigation.
    variance : (n_row, n_source). Variance of each of the rows by source.
    mean : (n_t, 9). Mean navigation errors.
    """
    n, n_pair = len(_BASE), len(_PAIRS)
    base = np.zeros((variance.shape[1], n, n))
    base[:, range(n), range(n)] = variance[:n].T
    for row, (i, j) in enumerate(_PAIRS, start=n):
        base[:, i, j] = base[:, j, i] = 0.5 * (variance[row] - variance[i] - variance[j])
    sizes = _sizes(found.target)
    whole = with_apsides(np.eye(len(INJECTION))[_BASE], found.target).T  # (n_number, n) numbers from `_BASE`
    navigation = whole @ (base * np.outer(sizes, sizes)) @ whole.T
    vehicle = np.array([slopes.T @ slopes for _, slopes in found.vehicle]).reshape(-1, *navigation.shape[1:])
    knowledge, execution = (part.T for part in np.split(variance[n + n_pair :], 2))
    diagonal = np.diagonal(vehicle, axis1=1, axis2=2)[:, : len(ORBIT)]
    off = found.reference.copy()
    off[: len(ORBIT)] = orbit_difference(found.reference[None, : len(ORBIT)], found.target[None])[0]
    return InjectionLaw(
        reference=found.reference,
        target=found.target,
        mean=off + np.einsum("kne,ke->n", found.navigation, mean) + found.curvature.sum(axis=0),
        second_order=np.sqrt(2.0 * np.sum(found.curvature**2, axis=0)),
        sources=(*sources, *(name.replace("_", " ") for name, _ in found.vehicle)),
        n_navigation=len(sources),
        covariance=np.concatenate([navigation, vehicle]),
        knowledge=np.concatenate([knowledge, np.zeros_like(diagonal)]),
        execution=np.concatenate([execution, diagonal]),
    )


def by_part(law: InjectionLaw | None) -> InjectionLaw | None:
    """Return the law of an injection with the sources of navigation as one, and those of the vehicle as another."""
    if law is None or law.why:
        return law
    covariance, knowledge, execution = (
        np.array([part.sum(axis=0) for part in np.split(values, [law.n_navigation])])
        for values in (law.covariance, law.knowledge, law.execution)
    )
    return law._replace(
        sources=("navigation", "vehicle"),
        n_navigation=1,
        covariance=covariance,
        knowledge=knowledge,
        execution=execution,
    )


def _sizes(target: Floats) -> Floats:
    """Return about what a kilometre of the orbit is in each of `_BASE`, (n,): m, dimensionless, rad, s, kg."""
    angle = 1e3 / target[AXIS]
    return np.array([1e3, angle, angle, angle, angle, 1.0, 10.0])
