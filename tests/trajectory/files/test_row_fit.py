"""Fit of a user's rows: its events, and the angles of its attitude."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.frames import matrices
from lvnav_trade.trajectory.attitude_algebra import product, rotation_quaternions
from lvnav_trade.trajectory.files.row_fit import angles_between, event_marks, mean_forces, path_forces, row_fit
from tests.trajectory.tables import card, example_settings


def test_marks_have_start_end_and_lift_off_in_order_of_time():
    assert event_marks({"cutoff": 5.0}, np.arange(-2.0, 10.0)) == {
        "start": -2.0,
        "liftoff": 0.0,
        "cutoff": 5.0,
        "end": 9.0,
    }
    assert "liftoff" not in event_marks({}, np.arange(3.0, 10.0))


def test_angles_are_those_of_the_rotation_between_two_attitudes():
    q = rotation_quaternions(np.array([[0.2, -0.1, 0.4], [1.0, 0.5, 0.1]]))
    turned = product(q, rotation_quaternions(np.array([[0.3, 0.0, 0.0], [0.0, 0.0, 1e-4]])))
    assert angles_between(2.0 * turned, q) == pytest.approx([0.3, 1e-4])
    cosine = 0.5 * (np.einsum("kij,kij->k", matrices(turned), matrices(q)) - 1.0)
    assert np.cos(angles_between(turned, q)) == pytest.approx(cosine)


def test_forces_of_the_spline_are_those_between_the_rows():
    path = row_fit(card(example_settings()))
    t, force, _ = mean_forces(path.rows)
    fine_t, fine_force = path_forces(path)
    size = np.interp(0.5 * (t[1:] + t[:-1]), fine_t, np.linalg.norm(fine_force, axis=1))
    assert np.median(np.abs(size - force)) < 0.02 * np.median(force)
