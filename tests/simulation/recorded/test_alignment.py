"""Attitude and gyro bias from a log whose true ones are known."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.recorded_log import read_card
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, gmst, matrices, rotation_i_n
from lvnav_trade.simulation.recorded.alignment import align
from lvnav_trade.simulation.recorded.navigation_log import read_recording
from tests import recorded_log


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    card, ref = recorded_log.write(folder)
    stated = read_card(card)
    return stated, read_recording(stated, folder), ref


def true_attitude(ref, t: float):
    at = int(np.argmin(np.abs(ref.t - t)))
    turn = rotation_i_n(ref.r_i[at : at + 1], earth_angle(gmst(recorded_log.EPOCH), ref.t[at : at + 1]))[0]
    return turn @ matrices(ref.q_b_i[at : at + 1])[0]


def test_level_heading_and_bias_are_the_true_ones(drive):
    card, log, ref = drive
    found = align(log, card)
    off = found.C_b_n @ true_attitude(ref, found.t).T
    tilt = np.hypot(off[2, 0], off[2, 1])
    bias = np.linalg.norm(recorded_log.ACCEL_BIAS) / 9.8  # levels the axes wrongly, and nothing at rest tells
    assert tilt < 1.2 * bias
    assert abs(np.arctan2(off[1, 0], off[0, 0])) < np.radians(1.0)
    np.testing.assert_allclose(found.gyro_bias, recorded_log.GYRO_BIAS, atol=4.0 * recorded_log.ARW / np.sqrt(20.0))


def test_a_stated_heading_is_taken(drive):
    card, log, _ = drive
    found = align(log, card.model_copy(update={"heading": 2.0}))
    assert (found.heading, found.heading_sigma) == (2.0, 0.0)
    assert np.arctan2(found.C_b_n[1, 0], found.C_b_n[0, 0]) == pytest.approx(2.0)
    still = align(log, card.model_copy(update={"heading": 2.0, "gyro_bias": "none"}))
    assert not still.gyro_bias.any()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"still": (40.0, 60.0)}, "the vehicle moves at up to"),
        ({"still": (500.0, 600.0)}, "no solutions from"),
        ({"heading_within": 0.3}, "state the heading"),
    ],
)
def test_a_rest_that_is_none_is_refused(drive, changes, said):
    card, log, _ = drive
    with pytest.raises(InputError, match=said):
        align(log, card.model_copy(update=changes))


def test_a_force_that_is_not_gravity_is_refused(drive):
    card, log, _ = drive
    with pytest.raises(InputError, match=r"a mean specific force of 10\.7"):
        align(log._replace(velocity_sums=1.1 * log.velocity_sums), card)


def test_a_body_that_stands_upright_has_the_heading_of_its_z_axis(drive):
    card, log, _ = drive
    turned, pushed = (
        part @ np.array([[0, 0, 1.0], [0, 1.0, 0], [-1.0, 0, 0]]).T for part in (log.angle_sums, log.velocity_sums)
    )
    found = align(log._replace(angle_sums=turned, velocity_sums=pushed), card.model_copy(update={"heading": 1.0}))
    assert np.arctan2(found.C_b_n[1, 2], found.C_b_n[0, 2]) == pytest.approx(1.0)
    assert abs(found.C_b_n[2, 0]) > 0.99
