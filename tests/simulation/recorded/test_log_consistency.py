"""A log's unit held against its receiver: what cannot be true is left out or refused, what can is left alone."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.recorded_log import read_card
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.recorded.log_consistency import remove_wild_solutions
from lvnav_trade.simulation.recorded.navigation_log import read_recording
from tests import recorded_log

ROW, LEVER = 150, np.zeros(3)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    file, _ = recorded_log.write(folder)
    card = read_card(file)
    return read_recording(card, folder), card


def test_a_log_without_faults_is_left_alone(drive):
    log, card = drive
    assert remove_wild_solutions(log, card, LEVER) is log


@pytest.mark.parametrize("row", [ROW, 0, -1])
def test_a_velocity_that_the_unit_contradicts_is_left_out(drive, row):
    log, card = drive
    moving = log.velocity_ned.copy()
    moving[row, 1] += 2.5
    found = remove_wild_solutions(log._replace(velocity_ned=moving), card, LEVER)
    assert found.t_fix.size == log.t_fix.size - 1
    assert log.t_fix[row] not in found.t_fix
    line = log.lines[row]
    assert found.notes[-1].startswith(f"velocities of 1 of {log.t_fix.size} solutions contradict the unit, by up to 2.")
    assert found.notes[-1].endswith(f"left out (gnss.csv:{line})")


@pytest.mark.parametrize(
    ("factor", "hint"),
    [
        (np.full(3, 180.0 / np.pi), r"if the rates were deg/s \(rad/s are stated\)"),
        (np.full(3, np.pi / 180.0), r"if the rates were rad/s \(deg/s are stated\)"),
        (np.array([1.0, 1.0, -1.0]), "with the sign of the rates about .*z reversed"),
    ],
)
def test_rates_of_another_unit_or_sign_are_refused_with_what_they_may_be(drive, factor, hint):
    log, card = drive
    with pytest.raises(InputError, match=rf"imu.csv: the rates contradict the receiver's velocities, .*{hint}"):
        remove_wild_solutions(log._replace(angle_sums=log.angle_sums * factor), card, LEVER)


def test_a_jump_of_the_unit_is_refused_at_the_row_where_the_receiver_does_not_see_it(drive):
    log, card = drive
    pushed = log.velocity_sums + np.where(log.t[:, None] > 60.1, [20.0, 0.0, 0.0], 0.0)
    at = int(np.searchsorted(log.t_fix, 60.1))
    with pytest.raises(InputError, match=rf"gnss.csv:{log.lines[at]}: in the 0.25 s before it the velocity gains"):
        remove_wild_solutions(log._replace(velocity_sums=pushed), card, LEVER)


def test_an_antenna_far_from_a_turning_unit_is_no_contradiction(drive):
    log, card = drive
    lever = np.array([0.0, 30.0, 0.0])
    rate = np.diff(log.angle_sums, axis=0) / np.diff(log.t)[:, None]
    swing = np.cross(np.vstack([rate[:1], rate]), lever)  # body axes; the drive is level
    at = np.searchsorted(log.t, log.t_fix - 1e-6)
    course = np.arctan2(log.velocity_ned[:, 1], log.velocity_ned[:, 0])
    smooth = np.stack([np.cos(course), np.sin(course)], axis=1) * swing[at, :1]
    moving = log.velocity_ned + np.where(log.t_fix[:, None] > 22.0, np.column_stack([smooth, 0.0 * at]), 0.0)
    seen = remove_wild_solutions(log._replace(velocity_ned=moving), card, lever)
    assert seen.t_fix.size >= log.t_fix.size - 1  # the row at which the swing sets in
