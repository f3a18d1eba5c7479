"""What is reported: the true state at the history times in the axes of a frame, and names of innovations."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.frames import rotation_i_n, rotation_i_o
from tests.building import LOOSE, case, hop, loaded, prepare_hop, with_fields


@pytest.mark.parametrize("frame", ["ned", "ecef", "inertial", "orbital"])
def test_reporting_axes_are_rotations_of_the_named_frame(frame):
    prepared_case = prepare_hop(with_fields(loaded(), frame=frame))
    axes, record = prepared_case.record.axes, prepared_case.record
    np.testing.assert_allclose(axes @ np.swapaxes(axes, 1, 2), np.tile(np.eye(3), (len(axes), 1, 1)), atol=1e-14)
    theta = hop().theta0 + 7.292115e-5 * prepared_case.t_hist
    expected = {
        "inertial": np.tile(np.eye(3), (len(axes), 1, 1)),
        "orbital": rotation_i_o(record.r, record.v),
        "ned": rotation_i_n(record.r, theta),
    }
    if frame == "ecef":
        rotated = axes @ np.array([1.0, 0.0, 0.0])
        np.testing.assert_allclose(rotated, np.stack([np.cos(theta), -np.sin(theta), 0 * theta], axis=1), atol=1e-14)
    else:
        np.testing.assert_allclose(axes, expected[frame], atol=1e-12)


def test_the_truth_of_the_record_is_the_reference_at_its_ticks():
    prepared_case = case()
    schedule = prepared_case.schedule
    ticks = (schedule.first_tick + schedule.n_tick)[schedule.hist >= 0]
    np.testing.assert_array_equal(prepared_case.record.r, prepared_case.reference.r_i[ticks])
    np.testing.assert_array_equal(prepared_case.record.q, prepared_case.reference.q_b_i[ticks])


def test_innovations_are_named_as_what_is_measured():
    assert case(LOOSE).channel_names == tuple(f"{what} {axis}" for what in ("position", "velocity") for axis in "xyz")
    assert case("base.filter=filters/inertial").channel_names == ("none",)
    tight = case()
    assert tight.channel_names[:2] == (f"{tight.sky.names[0]} range", f"{tight.sky.names[0]} range rate")
