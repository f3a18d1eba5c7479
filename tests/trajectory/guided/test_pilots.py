"""Pilots: a launch under control that burns as long as the nominal flight, its events and the stretches it keeps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from lvnav_trade.trajectory.control_cards import FeedbackCard
from lvnav_trade.trajectory.guided import autopilot
from lvnav_trade.trajectory.guided.course import ascend
from lvnav_trade.trajectory.guided.draws import deviations
from lvnav_trade.trajectory.guided.guidance_plan import plan_ascent
from lvnav_trade.trajectory.guided.guided_dynamics import PERFECT, commanded_direction
from lvnav_trade.trajectory.guided.missions import fly_mission, steered_launch
from lvnav_trade.trajectory.guided.pilots import GuidedPilot
from tests.trajectory.guided.cases import guided
from tests.trajectory.guided.test_turning import under_control

DRAWS = autopilot.DrawKeys(np.uint64(1), np.uint64(2), np.uint64(3))


def test_a_launch_burns_as_long_as_the_nominal_flight_and_keeps_stretches_that_meet():
    card = under_control()
    ascent = ascend(card)
    pilot = fly_mission(steered_launch(ascent, card.control), FeedbackCard(), DRAWS, 1, path=True)
    nominal = {name: t for name, t in ascent.trajectory.events.items() if name != "max_q"}
    assert pilot.events.keys() == nominal.keys()
    np.testing.assert_allclose([pilot.events[name] for name in nominal], list(nominal.values()), atol=1e-9)
    assert [one.name for one in pilot.stretches] == [leg.name for leg in ascent.legs]
    for before, after in pairwise(pilot.stretches):
        assert before.t[1] == after.t[0]
        np.testing.assert_array_equal(before.y[1, :6], after.y[0, :6])
    masses = [leg.y[-1, 6] for leg in ascent.legs]
    np.testing.assert_allclose([one.y[1, 6] for one in pilot.stretches], masses, rtol=1e-9)
    assert pilot.turning.control.counts[autopilot.STACK] == 3


def test_a_body_with_a_lag_begins_along_its_command_and_is_flown_by_shorter_steps():
    plan = plan_ascent(guided("two_stage_leo", attitude_lag="0.1 s"))
    pilot = GuidedPilot(plan, plan.card, deviations(plan.card, {}), PERFECT)
    np.testing.assert_array_equal(pilot.y[7:], commanded_direction(0.0, pilot.inputs))
    assert pilot.longest == 0.05
    at_once = plan_ascent(guided("two_stage_leo"))
    assert GuidedPilot(at_once, at_once.card, deviations(at_once.card, {}), PERFECT).y.shape == (7,)
