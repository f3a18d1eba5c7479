"""Lines of sight of a flight: from the antenna that hears a satellite, and to the point that is solved for."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.gnss.visibility import sky
from lvnav_trade.kernels.attitude import matrix
from lvnav_trade.simulation.preparation.signals.lines_of_sight import lines_of
from lvnav_trade.trajectory.flight import motion
from tests.building import case, hop, loaded, prepare_hop, with_fields
from tests.simulation.preparation.signals.test_receiver_measurements import T, with_patches
from tests.trajectory.phase_centres import antenna_states


def test_every_range_is_that_of_the_antenna_that_hears_the_satellite():
    scenario = with_patches()
    seen = sky(scenario.constellation, scenario.receiver, hop(), T)
    line = lines_of(hop(), np.array(scenario.receiver.lever_b), seen)
    places, speeds = antenna_states(hop(), scenario.receiver, T)
    assert set(np.unique(seen.antenna[seen.is_tracked])) == {0, 1}
    for epoch in range(T.size):
        for s in np.flatnonzero(seen.is_tracked[epoch]):
            a = seen.antenna[epoch, s]
            away = seen.r_i[epoch, s] - places[epoch, a]
            assert line.sight.distance[epoch, s] == pytest.approx(np.linalg.norm(away), abs=1e-8)
            moving = seen.v_i[epoch, s] - speeds[epoch, a]
            assert line.sight.rate[epoch, s] == pytest.approx(moving @ away / np.linalg.norm(away), abs=1e-9)


def test_the_antenna_is_at_the_lever_arm_and_swings_with_the_body():
    scenario = loaded()
    lever = np.array([1.0, -2.0, 3.0])
    receiver = with_fields(scenario.receiver, lever_b=[f"{x} m" for x in lever])
    prepared_case = prepare_hop(scenario.model_copy(update={"receiver": receiver}))
    at = motion(hop(), prepared_case.t_epoch)
    C = np.array([np.reshape(matrix(*q), (3, 3)) for q in at.q_b_i])
    np.testing.assert_allclose(prepared_case.signals.position, at.r_i + C @ lever, rtol=0, atol=1e-8)
    # the derivative of the position, by differences of 0.01 s: its third derivative, 0.1 m/s^3, leaves 2e-6 m/s
    ends = [motion(hop(), prepared_case.t_epoch[:-1] + dt) for dt in (-0.01, 0.01)]
    where = [a.r_i + np.array([np.reshape(matrix(*q), (3, 3)) for q in a.q_b_i]) @ lever for a in ends]
    quiet = np.abs(prepared_case.t_epoch[:-1] - 20.0) > 0.1  # not where the boost ends
    slope = (where[1] - where[0]) / 0.02
    np.testing.assert_allclose(prepared_case.signals.velocity[:-1][quiet], slope[quiet], rtol=0, atol=1e-5)


def test_range_and_range_rate_are_those_of_the_geometry():
    signals = case().signals
    line = signals.satellite_position - signals.position[:, None]
    distance = np.linalg.norm(line, axis=2)
    np.testing.assert_allclose(signals.range, distance, rtol=1e-15)
    relative = signals.satellite_velocity - signals.velocity[:, None]
    np.testing.assert_allclose(signals.rate, np.einsum("esi,esi->es", line / distance[..., None], relative), rtol=1e-12)
