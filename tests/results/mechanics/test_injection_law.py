"""Injection by linear covariance: near a circle, and where it does not hold."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from lvnav_trade.quantities.records import INJECTION
from lvnav_trade.results.mechanics.injection_law import apsis_errors, is_curved, share_depleted, why_no_law
from tests.injections import REFERENCE, SIZES, SOURCES, law

SHARE = np.linalg.norm(list(SOURCES.values()))


def _circular():
    target, sizes = REFERENCE[:7].copy(), np.append(SIZES, [0.2, 5.0])
    target[[3, 4]], sizes[0] = 0.0, 1.0  # the axis hardly varies
    covariance = np.array([np.diag((share * sizes) ** 2) for share in SOURCES.values()])
    return law(target=target, mean=np.append(np.zeros(7), REFERENCE[7:]), covariance=covariance)


@pytest.mark.parametrize(("quantity", "sign"), [("perigee", -1.0), ("apogee", 1.0)])
def test_apsides_near_a_circle_are_drawn_through_the_map_itself(quantity, sign):
    """Both components of the eccentricity vector have one sigma: its length is a Rayleigh variable."""
    found, size = _circular(), 6.9e6 * SIZES[3] * SHARE
    assert is_curved(found, quantity)
    drawn = sign * apsis_errors(found, quantity)
    for share in (0.5, 0.9, 0.997):
        assert np.quantile(drawn, share) == pytest.approx(size * np.sqrt(-2.0 * np.log(1.0 - share)), rel=0.02)


def test_a_circle_has_no_first_order_however_small_its_spread():
    found = _circular()
    target, covariance = found.target.copy(), 1e-12 * found.covariance
    target[3] = 5e-5
    covariance[:, [1, 2], [1, 2]] = np.nan
    assert is_curved(found._replace(target=target, covariance=covariance), "perigee")


def test_far_from_a_circle_draws_are_those_of_the_gaussian():
    found = law()
    assert not is_curved(found, "perigee")
    # perigee = a (1 - e), to first order in the three independent numbers
    e = np.hypot(0.01, 0.015)
    slope = np.array([1.0 - e, -6.9e6 * 0.01 / e, -6.9e6 * 0.015 / e]) * SIZES[[0, 3, 4]] * SHARE
    assert apsis_errors(found, "perigee").std() == pytest.approx(np.linalg.norm(slope), rel=0.02)


def test_a_perigee_that_vanishes_to_first_order_is_curved_far_from_a_circle_too():
    """An injection at perigee: axis and eccentricity change together so that the perigee stays."""
    found = law()
    place = INJECTION.index("perigee")
    covariance = found.covariance.copy()
    covariance[:, place, place] *= 1e-6
    assert is_curved(found._replace(covariance=covariance), "perigee")


def test_the_share_of_empty_stages_is_that_of_the_gaussian():
    assert share_depleted(law()) == pytest.approx(norm.sf(60.0 / (5.0 * SHARE)))


@pytest.mark.parametrize(("changes", "reason"), [
    ({}, ""),
    ({"reason": "no reference flight"}, "no reference flight"),
    ({"mean": np.append(np.zeros(7), [503.0, 8.0])}, "empty stage"),
    ({"second_order": np.full(9, 1e4)}, "second order"),
])  # fmt: skip
def test_why_there_is_no_law(changes, reason):
    for quantities in (("inclination",), ("perigee",), ("eccentricity_along_node", "eccentricity_ahead_of_node")):
        assert reason in why_no_law(law(**changes), quantities)
    assert bool(reason) == bool(why_no_law(law(**changes), ("inclination",)))
