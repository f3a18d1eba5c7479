"""Quaternion algebra, property by property, and small rotations against an independent library."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lvnav_trade.kernels.attitude import cross, from_rotation, matrix, multiply, normalise, small_rotation

# Rounding of a few dozen operations on numbers of order one.
ROUNDING = 4e-15

component = st.floats(-1.0, 1.0, allow_subnormal=False)
vectors = st.tuples(component, component, component).map(np.array)
unit_quaternions = (
    st.tuples(component, component, component, component)
    .map(np.array)
    .filter(lambda q: np.linalg.norm(q) > 1e-3)
    .map(lambda q: q / np.linalg.norm(q))
)


def matrix_of(q):
    return np.array(matrix(*q)).reshape(3, 3)


def rotation(v):
    return np.array(from_rotation(*v))


@given(unit_quaternions, unit_quaternions)
def test_the_product_of_quaternions_is_the_product_of_their_matrices(p, q):
    product = np.array(multiply(*p, *q))
    np.testing.assert_allclose(matrix_of(product), matrix_of(p) @ matrix_of(q), rtol=0, atol=ROUNDING)


@given(unit_quaternions, unit_quaternions, unit_quaternions)
def test_multiplication_is_associative(p, q, r):
    left = multiply(*multiply(*p, *q), *r)
    np.testing.assert_allclose(left, multiply(*p, *multiply(*q, *r)), rtol=0, atol=ROUNDING)


@given(unit_quaternions)
def test_a_unit_quaternion_gives_a_rotation_matrix(q):
    C = matrix_of(q)
    np.testing.assert_allclose(C @ C.T, np.eye(3), rtol=0, atol=ROUNDING)
    assert abs(np.linalg.det(C) - 1.0) < ROUNDING


@given(unit_quaternions)
def test_the_matrix_is_that_of_scipy_and_the_same_for_q_and_minus_q(q):
    expected = Rotation.from_quat(q, scalar_first=True).as_matrix()
    np.testing.assert_allclose(matrix_of(q), expected, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(matrix_of(q), matrix_of(-q))


@given(vectors)
def test_a_rotation_vector_below_a_fifth_of_a_radian_is_exact_to_rounding(v):
    v = 0.2 * v / max(1.0, np.linalg.norm(v))
    expected = Rotation.from_rotvec(v).as_quat(scalar_first=True)
    np.testing.assert_allclose(rotation(v), expected, rtol=0, atol=5e-16)


@given(vectors)
def test_the_series_of_a_rotation_leaves_out_the_tenth_power_only(v):
    # the cosine's first term left out: (angle / 2)^10 / 10!, 2.6e-13 at half a radian
    v = 0.5 * v / max(1.0, np.linalg.norm(v))
    expected = Rotation.from_rotvec(v).as_quat(scalar_first=True)
    bound = (0.5 * np.linalg.norm(v)) ** 10 / 3628800.0 + 5e-16
    np.testing.assert_allclose(rotation(v), expected, rtol=0, atol=bound)


def test_a_rotation_about_x_takes_y_to_z():
    # right-handed, body to inertial: at 90 degrees (built of eight steps) the body's y axis points along inertial z
    step = rotation(np.array([np.pi / 16, 0.0, 0.0]))
    q = step
    for _ in range(7):
        q = np.array(multiply(*q, *step))
    np.testing.assert_allclose(matrix_of(q) @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], atol=ROUNDING)


@given(vectors, vectors)
def test_the_vector_product_is_that_of_numpy(a, b):
    np.testing.assert_allclose(cross(*a, *b), np.cross(a, b), rtol=0, atol=ROUNDING)


@given(unit_quaternions, st.floats(-1e-5, 1e-5))
def test_one_newton_step_restores_unit_length(q, off):
    # the error e of the length becomes 1.5 e^2: 1.5e-10 at 1e-5
    restored = np.array(normalise(*((1.0 + off) * q)))
    assert abs(np.linalg.norm(restored) - 1.0) < 1.5 * off * off + ROUNDING
    np.testing.assert_allclose(restored, q, rtol=0, atol=1.5 * off * off + ROUNDING)


@given(unit_quaternions, vectors)
def test_a_small_rotation_comes_back_to_1e_12(q, v):
    # the arc sine is kept to its cube; the fifth power leaves 0.15 (angle / 2)^5, 5e-13 rad at 10 mrad
    v = 1e-2 * v / max(1.0, np.linalg.norm(v))
    p = multiply(*rotation(v), *q)
    np.testing.assert_allclose(small_rotation(*p, *q), v, rtol=0, atol=1e-12)
    np.testing.assert_allclose(small_rotation(*(-np.array(p)), *q), v, rtol=0, atol=1e-12)


@given(unit_quaternions, vectors)
def test_the_small_rotation_is_in_inertial_axes_from_the_second_attitude_to_the_first(q, v):
    v = 1e-3 * v
    expected = Rotation.from_rotvec(v).as_matrix() @ matrix_of(q)
    np.testing.assert_allclose(matrix_of(np.array(multiply(*rotation(v), *q))), expected, rtol=0, atol=ROUNDING)
    back = np.array(small_rotation(*q, *multiply(*rotation(v), *q)))
    np.testing.assert_allclose(back, -v, rtol=0, atol=1e-12)
