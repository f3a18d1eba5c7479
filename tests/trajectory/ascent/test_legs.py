"""Legs of an ascent."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from lvnav_trade.quantities.frames import earth_velocity
from lvnav_trade.trajectory.ascent.legs import (
    TargetingUnknowns,
    fly_ascent,
    lift_off_mass,
    mass_above,
    pad_state,
    site_axes,
)
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from tests.trajectory.flight_cases import ascent_card, launcher_settings

AIM = TargetingUnknowns(azimuth=1.1, kick=0.05, tangent=0.6, tangent_end=-0.1, burn=380.0)


def test_mass_at_lift_off_is_the_sum_of_the_card():
    assert lift_off_mass(ascent_card()) == pytest.approx(54000 + 4600 + 9000 + 850 + 700 + 250)


def test_on_the_pad_the_vehicle_rests_relative_to_the_earth():
    r_i, v_i = pad_state(ascent_card().site, 0.3)
    assert np.max(np.abs(earth_velocity(r_i, v_i))) < 1e-12


def test_site_axes_are_orthonormal_and_right_handed():
    up, downrange, right = site_axes(ascent_card().site, 1.1)
    assert np.allclose(np.cross(downrange, -up), -np.cross(up, downrange) * -1.0)
    assert np.allclose(np.array([downrange, right, -up]) @ np.array([downrange, right, -up]).T, np.eye(3), atol=1e-15)
    assert np.linalg.det(np.array([downrange, right, -up])) == pytest.approx(1.0)


def test_legs_follow_one_another_without_a_gap():
    legs = fly_ascent(ascent_card(), AIM).legs
    for before, after in pairwise(legs):
        assert before.t[-1] == after.t[0]
        assert np.array_equal(before.y[-1, :6], after.y[0, :6])


def test_events_are_named_and_in_order_of_time():
    events = fly_ascent(ascent_card(), AIM).events
    names = "liftoff kick stage1_cutoff stage1_separation stage2_ignition fairing_separation stage2_cutoff injection"
    assert list(events) == names.split()
    assert list(events.values()) == sorted(events.values())
    assert events["fairing_separation"] - events["stage2_ignition"] == pytest.approx(25.0)


def test_a_stage_burns_out_and_is_dropped_with_its_dry_mass():
    legs = fly_ascent(ascent_card(), AIM).legs
    assert legs[0].y[-1, 6] == pytest.approx(lift_off_mass(ascent_card()) - 54000.0, abs=1e-6)
    assert legs[1].y[-1, 6] - legs[2].y[0, 6] == pytest.approx(4600.0, abs=1e-6)


def test_boosters_are_in_the_mass_at_lift_off_and_leave_with_their_casings():
    card = VehicleAscent.model_validate(launcher_settings("pslv_sub_gto"))
    aim = AIM._replace(kick=0.38, azimuth=1.86)
    legs = fly_ascent(card, aim).legs
    assert legs[0].y[0, 6] == lift_off_mass(card)
    drops = [before.y[-1, 6] - after.y[0, 6] for before, after in pairwise(legs)]
    assert [drop for drop in drops if drop > 1.0] == pytest.approx(
        [4 * 2800.0, 2 * 2800.0, 30200.0, 1150.0, 5300.0, 1100.0], abs=1e-6
    )
    burnt = sum(leg.y[0, 6] - leg.y[-1, 6] for leg in legs if leg.name.startswith("stage 1 burn"))
    assert burnt == pytest.approx(138200.0 + 6 * 12200.0, abs=1e-6)


def test_what_a_stage_carries_in_orbit_is_what_stands_above_it():
    card = ascent_card()
    assert mass_above(card, 1) == pytest.approx(9000.0 + 850.0 + 700.0)
    assert mass_above(card, 2) == pytest.approx(700.0)


def test_halving_the_step_of_integration_moves_injection_by_less_than_a_metre(monkeypatch):
    whole = fly_ascent(ascent_card(), AIM, final_coast=False).legs[-1].y[-1]
    monkeypatch.setattr("lvnav_trade.trajectory.ascent.legs.STEP", 0.125)
    half = fly_ascent(ascent_card(), AIM, final_coast=False).legs[-1].y[-1]
    assert np.linalg.norm(whole[:3] - half[:3]) < 1.0
    assert math.isclose(whole[6], half[6], rel_tol=1e-6)
