"""How true components enter the filter's error over a window; the whole pass is tested in test_history."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lvnav_trade.covariance.components import components
from lvnav_trade.covariance.propagate import input_matrix, set_deviation
from lvnav_trade.filter.model import transition_blocks
from lvnav_trade.imu.error_model import lag
from lvnav_trade.kernels.attitude import multiply, small_rotation
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import J4, N_SUM, POINT, SUM_C, SUM_F, SUM_TH, SUM_V, full_rate
from lvnav_trade.kernels.transition import fill
from lvnav_trade.quantities.state_layout import ErrorTerm
from tests.building import case
from tests.covariance.small import of_lanes, propagate, small

SECONDS = 0.1
CASE = case()
TRUE = components(CASE)


def window_sums():
    sums = np.zeros(N_SUM)
    sums[SUM_C : SUM_C + 9] = SECONDS * np.eye(3).ravel()
    sums[SUM_V : SUM_V + 3], sums[SUM_TH : SUM_TH + 3], sums[SUM_F : SUM_F + 3] = (
        (3, 1, -2),
        (1e-2, 2e-2, 3e-2),
        (3, 1, -2),
    )
    return sums


@pytest.mark.parametrize("j", np.flatnonzero(TRUE.matched < 0))
def test_a_parameter_that_the_filter_does_not_carry_enters_as_the_blocks_of_the_transition(j):
    b = np.full((9, 3), np.nan)
    input_matrix(b, np.zeros(9), j, TRUE, window_sums(), SECONDS)
    stand_in = (ErrorTerm("any", 0, int(TRUE.sensor[j]), int(TRUE.driver[j]), 0.0, offset=9),)
    rows, columns, kinds, drivers = transition_blocks(stand_in, 2)
    blocks, phi = np.zeros((rows.size, 9)), np.eye(12)
    fill(blocks, kinds, drivers, window_sums(), 7e6, 0.0, 0.0, SECONDS)
    for row, column, block in zip(rows, columns, blocks, strict=True):
        phi[row : row + 3] += block.reshape(3, 3) @ phi[column : column + 3]
    np.testing.assert_allclose(b, phi[:9, 9:], rtol=1e-13)


N, STATES = 12, np.array([10, 11])  # two states of the filter for one error: a factor of each satellite
ROWS, COLUMNS = np.array([3, 6]), np.array([0, 3])


@pytest.mark.parametrize("noise", [0.0, 0.3])
@pytest.mark.parametrize("variance", [0.0, 2.0])
def test_components_act_as_in_the_dense_joint_covariance(variance, noise):
    """[e; c] with e+ = Phi e + b c + g w, c+ = f c + w, as one matrix; b of the nine states of motion or, where the
    filter has a state for c, the difference of the two decays there, with g one.
    """
    rng, factor, decay = np.random.default_rng(2), 0.8, np.ones(N)
    decay[9:] = 0.9
    blocks, entering = 0.2 * rng.standard_normal((2, 9)), np.zeros(N)
    blocks[1] = 0.4 * np.eye(3).ravel()  # position takes velocity times a number of seconds
    entering[:9] = rng.standard_normal(9)
    phi = np.eye(N)
    for r, c, block in zip(ROWS, COLUMNS, blocks, strict=True):
        step = np.eye(N)
        step[r : r + 3, c : c + 3] += block.reshape(3, 3)
        phi = step @ phi
    phi = np.diag(decay) @ phi
    full = []
    for _ in range(2):
        root = rng.standard_normal((N + 1, N + 1))
        one = root @ root.T
        scale = np.append(np.ones(N), np.sqrt(variance / one[N, N]))
        full.append(one * np.outer(scale, scale))
    joint, scratch, true, model = small(
        [one[:N, :N] for one in full], [variance] * 2, factor=[factor] * 2, noise=[noise] * 2, decay=decay,
        white=np.zeros((2, N)), blocks=blocks, rows=ROWS, columns=COLUMNS, seconds=0.1,
        states=STATES, state_from=np.array([0, 0, 2]),
    )  # fmt: skip
    for source, one in enumerate(full):
        of_lanes(joint.cross, source)[0] = one[:N, N]
    of_lanes(scratch.b, 0)[0] = entering[:9]
    propagate(joint, scratch, true, model)
    inside, driven = np.zeros(N), np.zeros(N)
    inside[STATES], driven[STATES] = factor - decay[STATES], 1.0
    for source, (b, g) in enumerate([(entering, np.zeros(N)), (inside, driven)]):
        A, drive = np.block([[phi, b[:, None]], [np.zeros(N), factor]]), np.append(g, 1.0)
        expected = A @ full[source] @ A.T + noise * np.outer(drive, drive)
        np.testing.assert_allclose(of_lanes(joint.sources, source), expected[:N, :N], rtol=0, atol=1e-12)
        np.testing.assert_allclose(of_lanes(joint.cross, source)[0], expected[:N, N], rtol=0, atol=1e-12)
        assert of_lanes(joint.variance, source)[0, 0] == pytest.approx(expected[N, N], rel=1e-14)


DT, TICKS, FAR = 1.0 / 400.0, 40, 1e15  # increments, those of a window, and where gravitation is nothing


def integrated(q, dtheta, dvel):
    """The strapdown over increments from rest."""
    nav, sums, previous = np.array([*q, 0.0, 0.0, 0.0, FAR, 0.0, 0.0]), np.zeros(N_SUM), np.zeros(6)
    increments = np.hstack([dtheta, dvel])
    mechanise(nav, sums, previous, increments, len(increments), DT, full_rate(POINT), 0.0)
    return nav


def test_what_a_bandwidth_does_to_a_body_that_spins_and_shakes_is_what_the_strapdown_makes_of_it():
    """Two seconds at 1.7 turns a second with vibration of 60 Hz across: the difference of two integrations of the same
    motion, sensed and true. With the mean attitude of a window of 0.1 s (61 deg) the velocity was 15 mm/s off.
    """
    n = 20 * TICKS
    t = DT * (np.arange(n) + 0.5)
    rate = np.stack([np.full(n, 2 * np.pi * 1.7), 0.5 * np.sin(8.0 * t), 0.5 * np.cos(8.0 * t)], axis=1)
    force = np.stack([np.full(n, 60.0), 15.0 * np.sin(377.0 * t), 15.0 * np.cos(300.0 * t)], axis=1)
    dtheta, dvel = rate * DT, force * DT
    seen = lag(dtheta, 500.0, DT), lag(dvel, 200.0, DT)
    turns = Rotation.from_rotvec(dtheta)
    q, quaternions = np.array([1.0, 0.0, 0.0, 0.0]), []
    for step in turns.as_quat(scalar_first=True):
        quaternions.append(q)
        q = np.array(multiply(*q, *step))
    reference = SimpleNamespace(dtheta=dtheta, dvel=dvel, q_b_i=np.array([*quaternions, q]))
    unit = SimpleNamespace(dtheta=seen[0], dvel=seen[1], dt=DT)
    strapdown = SimpleNamespace(gravity=J4, counted=False)
    deviation, mean = np.zeros(12), np.zeros(6)
    plain, nav = getattr(set_deviation, "py_func", set_deviation), [0.0] * 7 + [FAR, 0.0, 0.0]
    for first in range(0, n, TICKS):
        plain(deviation, unit, nav, SimpleNamespace(strapdown=strapdown), first, TICKS, reference)
        within = slice(first, first + TICKS)
        gained = integrated(reference.q_b_i[first], dtheta[within], dvel[within])[4:7]
        mean[3:] += deviation[3:6] + np.cross(mean[:3], gained)
        mean[:3] += deviation[:3]
    true, sensed = (integrated(reference.q_b_i[0], *both) for both in ((dtheta, dvel), seen))
    expected = np.array([*small_rotation(*sensed[:4], *true[:4]), *(sensed - true)[4:7]])
    assert np.abs(expected[3:]).max() > 5e-3
    np.testing.assert_allclose(mean[3:], expected[3:], rtol=0, atol=2e-4)
    np.testing.assert_allclose(mean[:3], expected[:3], rtol=0, atol=2e-6)
