"""What several inertial units sense where they sit, and what is left of their lever arms."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.records import Reference
from lvnav_trade.simulation.preparation.imu_arrays import lever_arm_velocity_increments
from lvnav_trade.trajectory.flight import reference
from tests.building import IDEAL, INERTIAL, TURNED, hop, loaded, prepare_hop, with_units


def test_a_lever_arm_on_a_spinning_body_feels_the_centripetal_acceleration():
    """Constant rate w about z, arm l along x: - w^2 l along x; with a rate that grows, w' l along y."""
    n, dt = 100, 0.01
    none, t = np.zeros((n + 1, 3)), dt * np.arange(n + 1)
    rate = np.stack([0.0 * t, 0.0 * t, 2.0 + 3.0 * t], axis=1)
    angle = dt * 0.5 * (rate[1:] + rate[:-1])
    ref = Reference(t, none, none, np.zeros((n + 1, 4)), none, rate, angle, none[1:])
    found = lever_arm_velocity_increments(ref, np.array([0.5, 0.0, 0.0]))
    assert found[:, 1] == pytest.approx(np.full(n, 3.0 * 0.5 * dt))
    spin = 2.0 + 3.0 * t
    assert found[:, 0] == pytest.approx(-0.5 * (spin[1:] ** 3 - spin[:-1] ** 3) / 9.0)


def test_a_lever_arm_that_is_ignored_stays_and_one_that_is_compensated_leaves_half_a_sample():
    """Half of the swing of one unit's lever arm is in the average of two."""
    scenario, lever = loaded(INERTIAL, *IDEAL), np.array([2.0, 1.0, -1.0])
    units = [{}, {"lever_arm": [f"{x} m" for x in lever], **TURNED}]
    ideal = reference(hop(), scenario.imu.rate)
    ignored = prepare_hop(with_units(scenario, units, lever_arms="ignored")).unit.dvel - ideal.dvel
    assert ignored == pytest.approx(0.5 * lever_arm_velocity_increments(ideal, lever), abs=1e-12)
    assert np.max(np.abs(ignored)) > 1e-6
    left = prepare_hop(with_units(scenario, units)).unit.dvel - ideal.dvel
    assert np.abs(np.cumsum(left, axis=0)).max() < 0.02 * np.abs(np.cumsum(ignored, axis=0)).max()


def test_fused_increments_are_those_of_one_ideal_unit_without_lever_arms():
    scenario = loaded(INERTIAL, *IDEAL)
    fused = prepare_hop(with_units(scenario, [TURNED, {"axes": [[1, 1, 1], [0, 0, 1]]}])).unit
    one = prepare_hop(scenario).unit
    assert fused.dtheta == pytest.approx(one.dtheta, abs=1e-15)
    assert fused.dvel == pytest.approx(one.dvel, abs=1e-12)
