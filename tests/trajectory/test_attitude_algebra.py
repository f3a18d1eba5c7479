"""Quaternions, rotation vectors and body axes against matrices and differences."""

from __future__ import annotations

import numpy as np

from lvnav_trade.quantities.frames import matrices
from lvnav_trade.trajectory.attitude_algebra import (
    body_axes,
    product,
    quaternion_rate,
    rotation_quaternions,
    rotation_vector_rate,
)


def test_quaternions_of_rotation_vectors_multiply_as_matrices_do():
    draw = np.random.default_rng(3)
    p, q = (rotation_quaternions(draw.normal(size=(20, 3))) for _ in range(2))
    assert np.max(np.abs(matrices(product(p, q)) - matrices(p) @ matrices(q))) < 1e-14
    assert np.array_equal(rotation_quaternions(np.zeros((1, 3))), [[1.0, 0.0, 0.0, 0.0]])


def test_the_rate_of_a_rotation_vector_is_the_derivative_of_its_quaternion():
    draw = np.random.default_rng(4)
    p, dp = draw.normal(size=(2, 20, 3))
    p[:5] *= 0.01  # by the series
    h = 1e-5
    slope = (rotation_quaternions(p + h * dp) - rotation_quaternions(p - h * dp)) / (2.0 * h)
    inverse = rotation_quaternions(p) * [1.0, -1.0, -1.0, -1.0]
    assert np.max(np.abs(rotation_vector_rate(p, dp) - 2.0 * product(inverse, slope)[:, 1:])) < 1e-8


def test_the_rate_of_a_quaternion_is_that_of_its_rotation_vector():
    draw = np.random.default_rng(5)
    p, dp = draw.normal(size=(2, 20, 3))
    h = 1e-5
    slope = (rotation_quaternions(p + h * dp) - rotation_quaternions(p - h * dp)) / (2.0 * h)
    assert np.max(np.abs(quaternion_rate(rotation_quaternions(p), slope) - rotation_vector_rate(p, dp))) < 1e-8


def test_body_axes_are_orthonormal_and_roll_about_x():
    x, right = np.array([[0.0, 0.0, 2.0]]) / 2.0, np.array([[0.0, 1.0, 0.3]])
    C = body_axes(np.repeat(x, 2, axis=0), np.repeat(right, 2, axis=0), np.array([0.0, 0.5 * np.pi]))
    assert np.max(np.abs(np.einsum("kij,kil->kjl", C, C) - np.eye(3))) < 1e-15
    assert np.allclose(C[0, :, 1], [0.0, 1.0, 0.0])
    assert np.allclose(C[1, :, 1], C[0, :, 2])
