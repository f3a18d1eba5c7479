"""How true components enter the filter's error over a window; the whole pass is tested in test_history."""

from __future__ import annotations

import numpy as np
import pytest

from tests.covariance.small import of_lanes, propagate, small

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
