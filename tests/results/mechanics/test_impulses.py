"""The least correction against closed forms of near-circular orbits, and against a linear programme."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from lvnav_trade.kernels.earth import GM
from lvnav_trade.quantities.frames import Elements, state_from_elements, unit
from lvnav_trade.results.mechanics import impulses, orbits

RADIUS = 7000e3
SPEED = np.sqrt(GM / RADIUS)


def circular():
    return state_from_elements(Elements(RADIUS, 0.0, 1.7, 0.5, 0.0, 0.4))


def eccentric(e):
    return state_from_elements(Elements(RADIUS / (1.0 - e), e, 1.7, 0.5, 0.3, 0.4))


def axes(r_i, v_i):
    radial, normal = unit(r_i), unit(np.cross(r_i, v_i))
    return radial, np.cross(normal, radial), normal


@pytest.mark.parametrize("e", [0.0, 0.02, 0.73])
def test_the_errors_of_the_orbit_are_those_of_differences(e):
    r_i, v_i = eccentric(e)
    frame = np.stack(axes(r_i, v_i))

    def orbit(error):
        found = orbits.osculating(r_i + error[3:], v_i + error[:3])
        size = np.linalg.norm(np.cross(r_i, v_i))
        return np.concatenate([frame @ found.h_i / size, (frame @ found.e_i)[:2]])

    steps = np.diag([0.01] * 3 + [10.0] * 3)
    expected = np.stack([(orbit(d) - orbit(-d)) / (2.0 * d.sum()) for d in steps], axis=1)
    found = impulses.orbit_errors(r_i, v_i)
    np.testing.assert_allclose(found / np.abs(expected).max(axis=0), expected / np.abs(expected).max(axis=0), atol=1e-8)


@pytest.mark.parametrize("e", [0.0, 0.02, 0.73])
def test_an_impulse_changes_the_orbit_as_the_same_error_of_velocity_does(e):
    r_i, v_i = eccentric(e)
    here = impulses.orbit_errors(r_i, v_i)[:, :3] @ np.stack(axes(r_i, v_i)).T
    scale = np.abs(here).max()
    np.testing.assert_allclose(impulses.control(r_i, v_i)[0] / scale, here / scale, atol=1e-12)


@pytest.mark.parametrize(("direction", "expected"), [(0, 0.5), (1, 1.0), (2, 1.0)], ids=["radial", "along", "across"])
def test_a_velocity_error_on_a_circular_orbit_costs_what_the_closed_form_says(direction, expected):
    """Infinitesimal and in plane: V/2 max(|da/a|, |de|); radially de = dv/V, along da/a = de = 2 dv/V; V di across."""
    r_i, v_i = circular()
    error = np.concatenate([axes(r_i, v_i)[direction], np.zeros(3)])
    found = impulses.least_state_correction(r_i, v_i, error)
    assert found.delta_v[0] == pytest.approx(expected, rel=6e-3)
    assert found.bound[0] <= expected * (1.0 + 1e-9)


def test_an_error_of_height_is_corrected_by_two_impulses():
    """dr at one place: da/a = 2 dr/a, de = dr/a: V/2 * 2 dr/a = V dr/a, by the same closed form."""
    r_i, v_i = circular()
    error = np.concatenate([np.zeros(3), 1000.0 * unit(r_i)])
    assert impulses.least_state_correction(r_i, v_i, error).delta_v[0] == pytest.approx(
        SPEED * 1000.0 / RADIUS, rel=6e-3
    )


def test_an_error_along_the_orbit_alone_is_no_error_of_the_orbit():
    """Later by one second is the same orbit: nothing is to be corrected."""
    r_i, v_i = eccentric(0.3)
    pull = -GM * r_i / np.linalg.norm(r_i) ** 3
    one_second_later = np.concatenate([pull, v_i])
    assert impulses.least_state_correction(r_i, v_i, one_second_later).delta_v[0] < 1e-9 * np.linalg.norm(pull)


@pytest.mark.parametrize("e", [0.0, 0.02, 0.73])
def test_the_least_sum_is_that_of_a_linear_programme_in_the_plane(e):
    """In the plane impulses are put together from 64 directions, which can only cost up to 1/cos(2.8 deg) more."""
    r_i, v_i = eccentric(e)
    pushes = impulses.control(r_i, v_i)
    turn = np.arange(64) * 2.0 * np.pi / 64
    plane = np.einsum("kij,dj->ikd", pushes[:, [2, 3, 4], :2], np.stack([np.cos(turn), np.sin(turn)], axis=1))
    rng = np.random.default_rng(3)
    for draw in rng.standard_normal((5, 4)):
        state = np.concatenate([draw[:2] @ np.stack(axes(r_i, v_i)[:2]), 1e3 * draw[2:] @ np.stack(axes(r_i, v_i)[:2])])
        goal = impulses.orbit_errors(r_i, v_i) @ state
        equal = plane.reshape(3, -1)
        scale = np.abs(equal).max(axis=1)
        solved = linprog(np.ones(equal.shape[1]), A_eq=equal / scale[:, None], b_eq=goal[2:] / scale)
        found = impulses.least_state_correction(r_i, v_i, state)
        assert found.bound[0] <= solved.fun * (1.0 + 1e-6)
        assert found.delta_v[0] == pytest.approx(solved.fun, rel=7e-3)


def test_the_bounds_enclose_the_least_sum_to_half_a_percent_and_grow_with_the_error():
    r_i, v_i = eccentric(0.02)
    error = np.random.default_rng(4).standard_normal((300, 6)) * ([0.3] * 3 + [30.0] * 3)
    found, double = (
        impulses.least_state_correction(r_i, v_i, error),
        impulses.least_state_correction(r_i, v_i, 2.0 * error),
    )
    assert np.all(found.delta_v - found.bound <= 5.1e-3 * found.delta_v)
    assert np.all(found.bound <= found.delta_v)
    np.testing.assert_allclose(double.delta_v, 2.0 * found.delta_v, rtol=1e-9)


def test_no_error_costs_nothing_and_a_fall_has_no_correction():
    r_i, v_i = circular()
    assert impulses.least_state_correction(r_i, v_i, np.zeros(6)).delta_v[0] == 0.0
    assert np.isnan(impulses.least_state_correction(r_i, 0.05 * v_i, np.ones(6)).delta_v[0])
