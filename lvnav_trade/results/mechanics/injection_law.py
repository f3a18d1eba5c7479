"""Injection of a guided ascent by linear covariance: its Gaussian, limits of validity, probability of depletion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from lvnav_trade.quantities.records import INJECTION, Floats, InjectionLaw
from lvnav_trade.results.mechanics.mission_errors import QUANTILE_DRAWS, draws

DEPLETED_AT_MOST = 1e-3
"""Largest probability of depletion for which linear covariance is valid, since it does not model an empty stage."""
SECOND_ORDER_AT_MOST = 0.3
"""Largest second-order effect of the vehicle's dispersions, as share of sigma, for which linear covariance is valid."""
_CIRCULAR_SIGMAS = 3.0
_CURVED = 0.1  # ratio of second to first order above which perigee and apogee are sampled
_PROPELLANT = INJECTION.index("propellant_left")
_SEMI_MAJOR_AXIS = INJECTION.index("semi_major_axis")
_ECCENTRICITY_VECTOR = [INJECTION.index("eccentricity_along_node"), INJECTION.index("eccentricity_ahead_of_node")]
_BASE = [_SEMI_MAJOR_AXIS, *_ECCENTRICITY_VECTOR]  # perigee and apogee are functions of these
APSIDES = {"perigee": -1.0, "apogee": 1.0}
"""Quantities that are nonlinear near a circular orbit, with the sign of the eccentricity in them."""


def share_depleted(law: InjectionLaw) -> float:
    """Return the probability that the last stage is empty before its cut-off."""
    sigma = float(np.sqrt(law.covariance[:, _PROPELLANT, _PROPELLANT].sum()))
    propellant = float(law.mean[_PROPELLANT])
    if sigma == 0.0:
        return float(propellant < 0.0)
    return float(special.ndtr(-propellant / sigma))


def why_no_law(law: InjectionLaw, quantities: Sequence[str]) -> str:
    """Return the reason why linear covariance does not describe quantities of an injection; empty if it does.

    Parameters
    ----------
    law : InjectionLaw
        Distribution of the injection by linear covariance.
    quantities : sequence of str
        Names of the quantities, from `INJECTION`.
    """
    if law.reason:
        return law.reason
    empty = share_depleted(law)
    if empty > DEPLETED_AT_MOST:
        return f"linear covariance expects {100.0 * empty:.2g} % of the flights to end with an empty stage"
    # Perigee and apogee are sampled if they are nonlinear, so only their arguments have to be linear.
    linear = [INJECTION.index(name) for name in quantities if name not in APSIDES] or _BASE
    sigma = np.sqrt(law.covariance[:, linear, linear].sum(axis=0))
    second_order = law.second_order[linear]
    if np.all(second_order <= SECOND_ORDER_AT_MOST * sigma):
        return ""
    share = float(np.max(second_order / np.where(sigma > 0.0, sigma, 1e-300)))
    return f"spreads of the vehicle act to second order, {share:.2g} times their sigma to the first"


def is_curved(law: InjectionLaw, quantity: str) -> bool:
    """Return whether perigee or apogee is too nonlinear in semi-major axis and eccentricity vector for the first order.

    Parameters
    ----------
    law : InjectionLaw
        Distribution of the injection by linear covariance.
    quantity : str
        Name of the perigee or apogee.

    Notes
    -----
    An error of the eccentricity vector across its direction changes its length to second order only. This matters if
    the orbit is nearly circular, and if the first order nearly vanishes, such as that of the perigee of an injection at
    perigee. The second order is compared with the first by their sigmas: a sigma_across^2 / (sqrt(2) e).
    """
    vector = law.target[_ECCENTRICITY_VECTOR] + law.mean[_ECCENTRICITY_VECTOR]
    e = float(np.linalg.norm(vector))
    covariance_by_source = law.covariance[:, _ECCENTRICITY_VECTOR][:, :, _ECCENTRICITY_VECTOR]
    covariance = covariance_by_source.sum(axis=0)
    largest_variance = float(np.linalg.eigvalsh(covariance)[-1])
    largest_sigma = np.sqrt(max(0.0, largest_variance))
    if e < _CIRCULAR_SIGMAS * largest_sigma:
        return True
    across = np.array([-vector[1], vector[0]]) / e
    across_variance = float(across @ covariance @ across)
    second_order = law.target[_SEMI_MAJOR_AXIS] * across_variance / (np.sqrt(2.0) * e)
    k = INJECTION.index(quantity)
    variance = law.covariance[:, k, k].sum()
    first_order = np.sqrt(variance)
    return not second_order <= _CURVED * first_order  # `not <=` is true for NaN, the first order at a circular orbit


def scaled_law(law: InjectionLaw, sources: Sequence[str], factor: float) -> InjectionLaw:
    """Return the law with the sigmas of error sources multiplied by a factor, the gains of the filter unchanged.

    Parameters
    ----------
    law : InjectionLaw
        Distribution of the injection by linear covariance.
    sources : sequence of str
        Names of the error sources to scale.
    factor : float
        Factor of their sigmas. The covariances are multiplied by its square.
    """
    scale = np.where(np.isin(law.sources, list(sources)), factor**2, 1.0)
    return law._replace(covariance=law.covariance * scale[:, None, None])


def apsis_errors(law: InjectionLaw, quantity: str, count: int = QUANTILE_DRAWS) -> Floats:
    """Return errors of perigee or apogee, from draws of semi-major axis and eccentricity vector through the exact
    relation.

    Parameters
    ----------
    law : InjectionLaw
        Gaussian of the injection by linear covariance.
    quantity : str
        Perigee or apogee, a key of `APSIDES`.
    count : int
        Number of draws, a power of two.

    Returns
    -------
    (count,) array
        Achieved less target (m).
    """
    covariance = law.covariance[:, _BASE][:, :, _BASE].sum(axis=0)
    sigmas = np.sqrt(np.diag(covariance))
    target = law.target[_BASE]
    achieved_orbits = target + draws(law.mean[_BASE], covariance, count, sigmas)
    return _apsis_radius(achieved_orbits, APSIDES[quantity]) - _apsis_radius(target, APSIDES[quantity])


def _apsis_radius(orbit: Floats, sign: float) -> Floats:
    """Return the radius a (1 -+ e) of perigee or apogee.

    Parameters
    ----------
    orbit : (..., 3) array
        Semi-major axis (m) and the two components of the eccentricity vector.
    sign : float
        -1 for perigee, 1 for apogee.

    Returns
    -------
    (...,) array
        Radius (m).
    """
    e = np.hypot(orbit[..., 1], orbit[..., 2])
    return np.asarray(orbit[..., 0] * (1.0 + sign * e))
