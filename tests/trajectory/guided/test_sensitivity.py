"""Derivatives of an injection against differences of whole guided flights."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.records import INJECTION, ORBIT
from lvnav_trade.trajectory.guided.ascent_runs import inject
from lvnav_trade.trajectory.guided.draws import numbers
from lvnav_trade.trajectory.guided.guidance_plan import plan_ascent
from lvnav_trade.trajectory.guided.guided_dynamics import NavigationErrors
from lvnav_trade.trajectory.guided.orbit_numbers import append_apsides, orbit_difference, osculating_orbit
from lvnav_trade.trajectory.guided.sensitivity import sensitivity
from tests.trajectory.guided.cases import guided, plan

SMALL = np.array([1e-4] * 3 + [0.1] * 3 + [20.0] * 3)
"""Navigation errors that are small for a flight: rad, m/s, m."""
_A = 6.8e6
UNITS = np.array([1.0, 1.0, 1.0, 1.0 / _A, 1.0 / _A, 1.0 / _A, 1.0 / _A, 1e-3, 1e-2])
"""About a metre of the orbit in each number of an injection."""


def times(known):
    return np.arange(-5.0, known.cutoff + 20.0, 1.0)


def change(known, target, high, low):
    """Return half the difference (n_number,) of two injections, as a linear function has it."""
    orbit = append_apsides(orbit_difference(osculating_orbit(high.y[None]), osculating_orbit(low.y[None])), target)[0]
    return 0.5 * np.append(orbit, [high.t - low.t, high.propellant_left - low.propellant_left])


def errors_of(kind, t):
    """Return navigation errors (n_t, 9): such as last, such as walk, and such as are new at every time."""
    draws = np.random.default_rng(7)
    if kind == "lasting":
        return np.tile(draws.standard_normal(9), (t.size, 1)) * SMALL
    steps = draws.standard_normal((t.size, 9))
    return np.cumsum(steps, axis=0) / np.sqrt(t.size) * SMALL if kind == "walking" else 0.1 * steps * SMALL


@pytest.mark.parametrize("kind", ["lasting", "walking", "white"])
@pytest.mark.parametrize(
    ("name", "guidance", "cutoff"),
    [
        ("two_stage_leo", "explicit", "energy"),
        ("two_stage_leo", "open_loop", "energy"),
        ("electron_leo", "explicit", "energy"),
        ("pslv_polar", "open_loop", "time"),
        ("churchill_sso", "explicit", "energy"),
        ("two_stage_leo", "schuler", "energy"),
        ("electron_leo lagging", "explicit", "energy"),
        ("two_stage_leo lagging", "open_loop", "energy"),
    ],
)
def test_navigation_errors_do_what_whole_flights_say(name, guidance, cutoff, kind):
    known = plan(name, guidance, cutoff)
    t = times(known)
    found, errors = sensitivity(known, t), errors_of(kind, t)
    wanted = change(
        known, found.target, *(inject(known, {}, NavigationErrors(t, sign * errors)) for sign in (1.0, -1.0))
    )
    linear = np.einsum("kne,ke->n", found.navigation, errors)
    size = np.sqrt(np.einsum("kne,ke->n", found.navigation**2, errors**2))
    defined = np.isfinite(wanted)
    np.testing.assert_array_equal(np.isfinite(linear), defined)
    off = np.abs(linear - wanted)[defined]
    # errors that jump every second do so within steps of the whole flight, and between those of the pieces
    tolerance = {"lasting": 3e-3, "walking": 0.02, "white": 0.08}[kind]
    assert np.all(off <= tolerance * size[defined] + 0.01 * UNITS[defined])


@pytest.mark.parametrize(("name", "guidance"), [("two_stage_leo", "explicit"), ("electron_leo", "open_loop")])
def test_gusts_do_what_whole_flights_say(name, guidance):
    known = plan(name, guidance)
    found = sensitivity(known, times(known))
    by_gust, n = dict(found.vehicle)["wind"], numbers(known.card)["wind"]
    for k in (0, 3, 20, 41, 70):
        draws = np.zeros((2, n))
        draws[:, k] = 1.0, -1.0
        wanted = change(known, found.target, *(inject(known, {"wind": one}) for one in draws))
        defined = np.isfinite(wanted)
        off = np.abs(by_gust[k] - wanted)[defined]
        assert np.all(off <= 0.02 * np.abs(wanted[defined]) + UNITS[defined]), k


@pytest.mark.parametrize("guidance", ["explicit", "open_loop"])
def test_the_reference_is_the_flight_without_errors(guidance):
    known = plan("electron_leo", guidance)
    found, flown = sensitivity(known, times(known)), inject(known, {})
    np.testing.assert_allclose(found.reference[:3], osculating_orbit(flown.y[None])[0, :3], atol=0.1)
    assert found.reference[INJECTION.index("cutoff_time")] == pytest.approx(flown.t, abs=1e-4)
    assert found.reference[INJECTION.index("propellant_left")] == pytest.approx(flown.propellant_left, abs=1e-3)


def test_with_perfect_guidance_a_lasting_error_is_the_injection_error_with_its_own_sign():
    """Explicit guidance brings the navigated state to the target, so what is not known is what is missed."""
    known = plan()
    found = sensitivity(known, times(known))
    lasting = np.concatenate([np.zeros(3), [0.3, -0.2, 0.4], [250.0, -150.0, 200.0]])
    total, knowledge = (np.einsum("kne,e->n", part, lasting) for part in (found.navigation, found.knowledge))
    axis, plane = ORBIT.index("semi_major_axis"), ORBIT.index("inclination")
    assert total[axis] == pytest.approx(knowledge[axis], rel=1e-3)
    # the law is kept for its last ten seconds, in which a speed that is not known of moves the plane by metres
    assert total[plane] == pytest.approx(knowledge[plane], abs=10.0 / 6.8e6)


def test_a_cutoff_by_time_is_never_late():
    known = plan("pslv_polar", "open_loop", "time")
    found = sensitivity(known, times(known))
    assert not found.navigation[:, INJECTION.index("cutoff_time")].any()
    assert not dict(found.vehicle)["thrust"][:, INJECTION.index("cutoff_time")].any()


def test_a_vehicle_that_a_sigma_empties_has_no_derivative():
    settings = {"draw": ["propellant"], "sigmas": {"specific_impulse": -3.0, "propellant": -3.0}}
    known = plan_ascent(guided("electron_leo", dispersion=settings))
    why = sensitivity(known, times(known)).reason
    assert "depleted" in why
    assert why.startswith(("with", "the reference flight"))


def test_without_draws_the_vehicle_has_no_sources():
    known = plan_ascent(guided())
    assert sensitivity(known, times(known)).vehicle == ()
