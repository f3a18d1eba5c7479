"""filterpy (PyPI): its predict and update on 17 states, one run at a time; the covariance step that a user would
write.
"""

from __future__ import annotations

import numpy as np

from benchmarks.common import best

STEPS = 200


def measure() -> dict[str, float]:
    """Return nanoseconds of one predict (dense) and of one scalar update."""
    from filterpy.kalman import KalmanFilter

    kf = KalmanFilter(dim_x=17, dim_z=1)
    rng = np.random.default_rng(0)
    kf.F = np.eye(17) + 1e-6 * rng.standard_normal((17, 17))
    kf.Q = 1e-9 * np.eye(17)
    kf.H = rng.standard_normal((1, 17))

    def predicts() -> None:
        for _ in range(STEPS):
            kf.predict()

    def updates() -> None:
        for _ in range(STEPS):
            kf.update(np.zeros(1))

    return {
        "filterpy_predict_ns": best(predicts) / STEPS * 1e9,
        "filterpy_update_ns": best(updates) / STEPS * 1e9,
    }
