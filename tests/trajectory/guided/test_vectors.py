"""Vectors of three components against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.trajectory.guided.vectors import blend, cross, unit_vector

A, B = (1.0, -2.0, 0.5), (0.3, 0.7, -1.1)


def test_a_unit_vector_keeps_its_direction():
    assert unit_vector(*A) == pytest.approx(np.array(A) / np.linalg.norm(A), abs=1e-15)


def test_a_vector_product_is_that_of_numpy():
    assert cross(A, B) == pytest.approx(np.cross(A, B), abs=1e-15)


@pytest.mark.parametrize("weight", [0.0, 0.3, 1.0])
def test_a_blend_is_the_direction_between_two_vectors(weight):
    between = (1.0 - weight) * np.array(A) + weight * np.array(B)
    assert blend(weight, A, B) == pytest.approx(between / np.linalg.norm(between), abs=1e-15)
