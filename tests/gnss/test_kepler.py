"""Kepler's equation."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lvnav_trade.gnss.kepler import eccentric_anomaly


@given(mean=st.floats(-20.0, 20.0), e=st.floats(0.0, 0.95))
def test_the_eccentric_anomaly_solves_keplers_equation(mean, e):
    anomaly = eccentric_anomaly(np.array([mean]), np.array([e]))
    residual = anomaly - e * np.sin(anomaly) - np.mod(mean, 2.0 * math.pi)
    assert abs(residual[0]) < 1e-12
