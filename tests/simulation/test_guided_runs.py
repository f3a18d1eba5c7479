"""Guided runs in the engine: errors in inertial axes, numbers of the orbit, and runs of a small case."""

from __future__ import annotations

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest

from lvnav_trade.quantities.frames import matrices
from lvnav_trade.quantities.records import NO_INJECTIONS, NO_LOST, ORBIT, OUTCOMES
from lvnav_trade.simulation.guided_runs import inertial_errors_of, injection_rows, injections
from lvnav_trade.trajectory.ascent.dispersion_card import SOURCES
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.guided.ascent_runs import Injection, inject
from lvnav_trade.trajectory.guided.draws import draw
from lvnav_trade.trajectory.guided.guidance_plan import plan_ascent
from lvnav_trade.trajectory.guided.guided_dynamics import NavigationErrors
from lvnav_trade.trajectory.guided.orbit_numbers import osculating_orbit
from lvnav_trade.trajectory.guided.pilots import INJECTED
from lvnav_trade.trajectory.guided.sensitivity import sensitivity
from tests.trajectory.flight_cases import launcher_settings
from tests.trajectory.guided.cases import guided, plan, state_of


def test_a_row_is_achieved_less_target_and_achieved_less_navigated():
    target, reached = state_of(), state_of(semi_major_axis=6.803e6, node=0.01)
    error = np.concatenate([np.zeros(3), [0.1, -0.2, 0.3], [10.0, 20.0, -30.0]])
    one = Injection(INJECTED, 500.0, reached, 12.0, error)
    row = injection_rows([one], target)[0]
    n = len(ORBIT)
    assert (OUTCOMES[int(row[0])], row[1], row[2]) == (INJECTED, 500.0, 12.0)
    assert row[3] == pytest.approx(3000.0, abs=1e-3)
    assert row[3 + ORBIT.index("node")] == pytest.approx(0.01 - 6.28 + 2.0 * np.pi)
    navigated = reached.copy()
    navigated[:3] -= error[6:]
    navigated[3:6] -= error[3:6]
    wanted = osculating_orbit(reached[None])[0] - osculating_orbit(navigated[None])[0]
    np.testing.assert_allclose(row[3 + n :], wanted, rtol=1e-9, atol=1e-15)


def _prepared(known):
    draws = np.random.default_rng(2)
    t = np.array([-60.0, 0.0, 300.0, 600.0])
    q = draws.standard_normal((4, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    axes = matrices(q[::-1])
    return SimpleNamespace(plan=known, record=SimpleNamespace(t=t, q=q, axes=axes))


def test_errors_are_turned_from_body_and_reporting_axes_into_inertial_ones():
    prepared_case, wanted = _prepared(None), np.random.default_rng(3).standard_normal((2, 4, 3, 3))
    stored = np.empty((2, 4, 12))
    for h in range(4):
        C, axes = matrices(prepared_case.record.q)[h], prepared_case.record.axes[h]
        stored[:, h, :3] = wanted[:, h, 0] @ C
        stored[:, h, 3:6], stored[:, h, 6:9] = wanted[:, h, 1] @ axes.T, wanted[:, h, 2] @ axes.T
    np.testing.assert_allclose(inertial_errors_of(prepared_case, stored), wanted.reshape(2, 4, 9), atol=1e-12)


def test_a_run_is_that_of_its_number_whatever_the_block():
    prepared_case = _prepared(plan())
    errors = np.zeros((3, 4, 9))
    (whole, lost), (alone, _) = injections(prepared_case, 9, 0, errors), injections(prepared_case, 9, 2, errors[:1])
    assert lost.shape == (0, 4)
    np.testing.assert_array_equal(whole[2], alone[0])
    assert len({row[1] for row in whole}) == 3
    n = len(ORBIT)
    assert np.all(whole[:, 3 + n :] == 0.0)  # a perfect navigation knows its orbit
    assert inject(prepared_case.plan, {}).outcome == INJECTED


def test_a_case_without_guidance_has_no_injections():
    found, lost = injections(_prepared(None), 9, 0, np.zeros((3, 4, 9)))
    assert found is NO_INJECTIONS
    assert lost is NO_LOST


def test_the_budget_of_the_vehicle_is_the_spread_of_runs_in_the_linear_range():
    """Spreads of a tenth: 300 runs with a perfect navigation against differences of whole flights."""
    settings = launcher_settings("electron_leo")
    spreads = settings["vehicle"]["dispersions"]
    small = {name: f"{float(str(spreads[name]).split()[0]) / 10.0} {str(spreads[name]).split()[1]}" for name in SOURCES}
    settings["vehicle"]["dispersions"] = {**spreads, **small}
    known = plan_ascent(
        VehicleAscent.model_validate({**settings, "guidance": "explicit", "dispersion": {"draw": "all"}})
    )
    prepared_case = _prepared(known)
    budget = dict(sensitivity(known, prepared_case.record.t).vehicle)
    assert set(budget) == set(SOURCES)
    runs, _ = injections(prepared_case, 11, 0, np.zeros((300, 4, 9)))
    found = runs[:, 3 : 3 + len(ORBIT)].std(axis=0, ddof=1)
    wanted = np.sqrt(np.sum([np.sum(one**2, axis=0) for one in budget.values()], axis=0))[: len(ORBIT)]
    np.testing.assert_allclose(found, wanted, rtol=0.15)  # 300 runs know a sigma to 4 %, one sigma


def test_perigee_and_apogee_of_a_circular_target_have_no_budget():
    prepared_case = _prepared(plan_ascent(guided(dispersion={"draw": ["tail_off"]})))
    ((_, slopes),) = sensitivity(prepared_case.plan, prepared_case.record.t).vehicle
    sigma = np.abs(slopes[0])
    assert np.isnan(sigma[[ORBIT.index("perigee"), ORBIT.index("apogee")]]).all()
    # speed gained along a circular orbit: da = 2 a^2 v / GM dv
    at = prepared_case.plan.nominal
    a, speed = np.linalg.norm(at[:3]), np.linalg.norm(at[3:6])
    spread = prepared_case.plan.card.vehicle.dispersions.tail_off
    slope = 2.0 * a**2 * speed / 3.986004418e14 * spread
    assert 0.97 * slope < sigma[0] <= slope * (1.0 + 1e-6)  # the thrust is a little off the velocity


def test_lost_runs_keep_what_their_vehicles_drew():
    card = guided("electron_leo", dispersion={"draw": ["propellant"], "sigmas": {"specific_impulse": -3.5}})
    prepared_case = _prepared(plan_ascent(card))
    rows, lost = injections(prepared_case, 5, 30, np.zeros((6, 4, 9)))
    depleted = 30 + np.flatnonzero(rows[:, 0] == OUTCOMES.index("depleted"))
    assert depleted.size
    assert set(lost[:, 0]) == set(depleted)
    mine = lost[lost[:, 0] == depleted[0]]
    drawn = draw(card, 5, int(depleted[0]))
    for name, values in drawn.items():
        np.testing.assert_array_equal(mine[mine[:, 1] == SOURCES.index(name), 3], values)


def test_the_memory_does_not_grow_with_the_runs():
    known = plan()
    navigated = NavigationErrors(np.array([0.0, 1.0, 2.0]), np.full((3, 9), 1e-3))
    inject(known, {}, navigated)
    tracemalloc.start()
    try:
        inject(known, {}, navigated)
        before, _ = tracemalloc.get_traced_memory()
        for _ in range(4):
            inject(known, {}, navigated)
        assert tracemalloc.get_traced_memory()[0] - before < 100_000  # bytes; a run without arrays given back: 1.6 MB
    finally:
        tracemalloc.stop()
