"""What a parameter of a sensing axis multiplies, and how it enters the fused triad."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.transition import CONSTANT, OTHER_0, OWN_0, SQUARE
from lvnav_trade.simulation.epoch.joint_ticks import lasting_share, unit_input

RATE, FORCE = np.array([0.1, -0.2, 0.3]), np.array([1.0, 20.0, -3.0])


class Array(NamedTuple):
    """As much of several IMUs as an error enters by."""

    stage: np.ndarray
    axis_weights: np.ndarray
    error_factors: np.ndarray


def test_a_parameter_multiplies_what_its_axis_senses():
    """An axis along y of the body, by the frame of its misalignments."""
    frames = np.zeros((3, 3, 3))
    frames[1] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    assert unit_input(frames, 1, CONSTANT, RATE, FORCE) == 1.0
    assert unit_input(frames, 1, OWN_0, RATE, FORCE) == RATE[1]
    assert unit_input(frames, 1, OWN_0 + 1, RATE, FORCE) == RATE[2]
    assert unit_input(frames, 1, OTHER_0 + 1, RATE, FORCE) == FORCE[1]
    assert unit_input(frames, 1, SQUARE, RATE, FORCE) == RATE[1] ** 2


def test_an_error_that_lasts_enters_by_the_weights_of_its_stage():
    solved = np.arange(36.0).reshape(2, 1, 2, 3, 3)
    units = Array(np.array([0, 1]), solved, np.full((2, 2, 2, 3), 0.5))
    assert lasting_share(units, 1, 0, 1, 2, 0) == 0.5 * solved[1, 0, 1, 2, 0]
