"""Guided runs in the engine: errors in inertial axes, numbers of the orbit, and runs of a small case."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lvnav_trade.engines.simulate.guided import in_inertial_axes, injections, orbit_of, rows_of
from lvnav_trade.frames import Elements, matrices, state_from_elements
from lvnav_trade.kernels.earth import SEMI_MAJOR
from lvnav_trade.records import NO_INJECTIONS, ORBIT, OUTCOMES
from lvnav_trade.world.guided.runs import INJECTED, Injection, inject
from tests.world.guided.cases import plan


def _state(**changes):
    numbers = {
        "semi_major_axis": 6.8e6,
        "eccentricity": 0.01,
        "inclination": 0.9,
        "node": 6.28,
        "perigee_argument": 0.3,
        "true_anomaly": 0.2,
        **changes,
    }
    r, v = state_from_elements(Elements(*(np.array(numbers[name]) for name in Elements._fields)))
    return np.concatenate([r, v, [1000.0]])


def test_numbers_of_an_orbit():
    found = dict(zip(ORBIT, orbit_of(_state()[None])[0], strict=True))
    assert found["semi_major_axis"] == pytest.approx(6.8e6)
    assert found["perigee"] == pytest.approx(6.8e6 * 0.99 - SEMI_MAJOR)
    assert found["apogee"] == pytest.approx(6.8e6 * 1.01 - SEMI_MAJOR)
    assert found["eccentricity_along_node"] == pytest.approx(0.01 * np.cos(0.3))
    assert found["eccentricity_ahead_of_node"] == pytest.approx(0.01 * np.sin(0.3))
    assert found["inclination"] == pytest.approx(0.9)


def test_a_row_is_achieved_less_target_and_achieved_less_navigated():
    target, reached = _state(), _state(semi_major_axis=6.803e6, node=0.01)
    error = np.concatenate([np.zeros(3), [0.1, -0.2, 0.3], [10.0, 20.0, -30.0]])
    row = rows_of([Injection(INJECTED, 500.0, reached, 12.0, error)], target)[0]
    n = len(ORBIT)
    assert (OUTCOMES[int(row[0])], row[1], row[2]) == (INJECTED, 500.0, 12.0)
    assert row[3] == pytest.approx(3000.0, abs=1e-3)
    assert row[3 + ORBIT.index("node")] == pytest.approx(0.01 - 6.28 + 2.0 * np.pi)
    navigated = reached.copy()
    navigated[:3] -= error[6:]
    navigated[3:6] -= error[3:6]
    wanted = orbit_of(reached[None])[0] - orbit_of(navigated[None])[0]
    np.testing.assert_allclose(row[3 + n :], wanted, rtol=1e-9, atol=1e-15)


def _prepared(known):
    draws = np.random.default_rng(2)
    t = np.array([-60.0, 0.0, 300.0, 600.0])
    q = draws.standard_normal((4, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    axes = matrices(q[::-1])
    return SimpleNamespace(plan=known, record=SimpleNamespace(t=t, q=q, axes=axes))


def test_errors_are_turned_from_body_and_reporting_axes_into_inertial_ones():
    prepared, wanted = _prepared(None), np.random.default_rng(3).standard_normal((2, 4, 3, 3))
    stored = np.empty((2, 4, 12))
    for h in range(4):
        C, axes = matrices(prepared.record.q)[h], prepared.record.axes[h]
        stored[:, h, :3] = wanted[:, h, 0] @ C
        stored[:, h, 3:6], stored[:, h, 6:9] = wanted[:, h, 1] @ axes.T, wanted[:, h, 2] @ axes.T
    np.testing.assert_allclose(in_inertial_axes(prepared, stored), wanted.reshape(2, 4, 9), atol=1e-12)


def test_a_run_is_that_of_its_number_whatever_the_block():
    prepared = _prepared(plan())
    errors = np.zeros((3, 4, 9))
    whole, alone = injections(prepared, 9, 0, errors), injections(prepared, 9, 2, errors[:1])
    np.testing.assert_array_equal(whole[2], alone[0])
    assert len({row[1] for row in whole}) == 3
    assert np.all(whole[:, 3 + len(ORBIT) :] == 0.0)  # a perfect navigation knows its orbit
    assert inject(prepared.plan, {}).outcome == INJECTED


def test_a_case_without_guidance_has_no_injections():
    assert injections(_prepared(None), 9, 0, np.zeros((3, 4, 9))) is NO_INJECTIONS
