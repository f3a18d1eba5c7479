"""A correlated error: how it enters the scalars of a sensor."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np

from lvnav_trade.sensors.sensor import CorrelatedError, each_scalar

FLIGHT = SimpleNamespace(t=np.arange(4.0))


def test_an_error_alone_is_added_to_all_scalars():
    error = CorrelatedError("bias", "bias", 2.0, "bias", math.inf)
    np.testing.assert_array_equal(error.partials(FLIGHT, 3), np.ones((4, 3, 1)))


def test_errors_of_their_own_scalars_are_the_same_at_every_epoch():
    error = CorrelatedError("mount", "mount", 1.0, "sigma", math.inf, ("x", "z"), each_scalar(3, 0, 2))
    np.testing.assert_array_equal(error.partials(FLIGHT, 3), np.tile(np.eye(3)[:, [0, 2]], (4, 1, 1)))
