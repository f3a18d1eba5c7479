import numpy as np
import pytest

from lvnav_trade.filter.policies.integrity.state import fit, invert, limit, new_monitor
from lvnav_trade.sensors.jacobian_row import H_CLOCK, H_POS, N_ENTRY

N_SAT = 7


def rows(seed=1):
    """Return Jacobian rows and innovations of ranges and rates of seven satellites, and the weights of the ranges."""
    draw = np.random.default_rng(seed)
    H, z = np.zeros((2 * N_SAT, N_ENTRY)), draw.normal(size=2 * N_SAT)
    for s in range(N_SAT):
        u = draw.normal(size=3)
        H[2 * s, H_POS : H_POS + 3], H[2 * s, H_CLOCK] = -u / np.linalg.norm(u), 1.0
    return H, z, draw.uniform(0.2, 2.0, N_SAT)


@pytest.mark.parametrize("out", [(), (2,), (0, 5)])
def test_it_is_weighted_least_squares_of_what_is_in_use(out):
    H, z, w = rows()
    w[list(out)] = 0.0
    own = new_monitor(1, 2 * N_SAT, 2 * N_SAT, 2)
    own.weight[::2] = w
    square, dof = fit(own, H, z, H_POS, 0, 2, 2 * N_SAT)
    G = np.column_stack([H[::2, H_POS : H_POS + 3], H[::2, H_CLOCK]])
    N = G.T @ (w[:, None] * G)
    x = np.linalg.solve(N, G.T @ (w * z[::2]))
    left = z[::2] - G @ x
    np.testing.assert_allclose(own.fit, x, rtol=1e-8)
    np.testing.assert_allclose(own.inverse, np.linalg.inv(N), rtol=1e-8)
    assert square == pytest.approx(float(w @ left**2), rel=1e-9)
    assert dof == N_SAT - len(out) - 4


def test_too_few_rows_have_no_degrees_of_freedom_and_are_beyond_no_limit():
    H, z, w = rows()
    own = new_monitor(1, 2 * N_SAT, 2 * N_SAT, 2)
    own.weight[: 2 * 3 : 2] = w[:3]
    square, dof = fit(own, H, z, H_POS, 0, 2, 2 * N_SAT)
    assert dof == -1.0
    assert square < limit(np.array([np.inf, 10.0, 13.0]), dof)


def test_a_limit_is_that_of_its_degrees_of_freedom():
    table = np.array([np.inf, 10.0, 13.0, 16.0])
    assert [limit(table, dof) for dof in (0.0, 1.0, 2.0, 3.0, 9.0)] == [np.inf, 10.0, 13.0, 16.0, np.inf]


def test_the_inverse_of_a_covariance():
    draw = np.random.default_rng(3).normal(size=(4, 9))
    A, inverse = draw @ draw.T, np.zeros((4, 4))
    expected = np.linalg.inv(A)
    invert(inverse, A)
    np.testing.assert_allclose(inverse, expected, rtol=1e-9, atol=1e-12)
