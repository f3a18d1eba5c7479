"""What guidance knows before lift-off is the nominal flight."""

from __future__ import annotations

import numpy as np

from lvnav_trade.kernels.earth import GM
from lvnav_trade.quantities.frames import elements_from_state, matrices
from lvnav_trade.trajectory.ascent.launch import build_ascent
from lvnav_trade.trajectory.guided.guidance_plan import plan_ascent
from lvnav_trade.trajectory.truth import motion
from tests.trajectory.guided.cases import guided, plan


def test_the_programme_is_the_direction_of_the_nominal_thrust():
    card, known = guided(), plan()
    t = np.arange(60.0, 540.0, 7.35)
    at = motion(build_ascent(card), t)
    powered = np.linalg.norm(at.f_b, axis=1) > 5.0
    x = np.einsum("kij,kj->ki", matrices(at.q_b_i), np.tile([1.0, 0.0, 0.0], (t.size, 1)))
    grid = known.programme.step * np.arange(len(known.programme.u))
    u = np.stack([np.interp(t, grid, one) for one in known.programme.u.T])
    assert np.max(np.linalg.norm(u.T - x, axis=1)[powered]) < 1e-4


def test_target_and_energy_are_those_of_the_target_orbit():
    known, orbit = plan(), guided().target
    a = 6378137.0 + 0.5 * (orbit.perigee + orbit.apogee)
    assert abs(known.energy + GM / (2.0 * a)) < 1.0
    at = elements_from_state(known.nominal[:3], known.nominal[3:6])
    assert abs(np.degrees(float(at.inclination - orbit.inclination))) < 1e-6
    assert abs(known.target.normal @ known.nominal[:3]) < 1e-3


def test_spreads_are_those_that_the_mission_asks_for():
    card = guided(dispersion={"draw": ["thrust"], "sigmas": {"wind": 2.0}})
    spreads = card.vehicle.dispersions
    assert dict(plan_ascent(card).spreads) == {"thrust": spreads.thrust, "wind": spreads.wind}
    assert plan_ascent(guided()).spreads == ()
