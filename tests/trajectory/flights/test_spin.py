"""Steps of the spin rate, and the roll angle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.trajectory.flights.spin import SpinStep, spin_angle


def spin(*steps):
    return tuple(SpinStep.model_validate(dict(zip(("at", "frequency", "over"), step, strict=True))) for step in steps)


def test_the_roll_angle_counts_the_turns():
    angle = spin_angle(spin(("5 s", "2 Hz", "4 s"), ("stop", "0 Hz", "1 s")), {"stop": 20.0}, -10.0, 30.0)
    # A smooth step has its middle's mean: 2 s of 2 Hz while it rises, half a second while it falls.
    assert angle(30.0) - angle(-10.0) == pytest.approx(2.0 * math.pi * 2.0 * (2.0 + 11.0 + 0.5), rel=1e-12)
    t = np.array([-10.0, 5.0, 7.0, 9.0, 15.0, 20.0, 20.5, 21.0, 30.0])
    assert angle(t, 1) / (2.0 * math.pi) == pytest.approx([0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 1.0, 0.0, 0.0], abs=1e-12)
    edges = np.array([5.0, 9.0, 20.0, 21.0])
    assert np.max(np.abs(angle(edges - 1e-9, 2) - angle(edges + 1e-9, 2))) < 1e-6


def test_no_steps_are_no_spin():
    assert spin_angle((), {}, 0.0, 10.0) is None


def test_steps_that_overlap_or_outlast_the_flight_are_refused():
    with pytest.raises(InputError, match="spin: the step at '6 s' overlaps"):
        spin_angle(spin(("5 s", "2 Hz", "4 s"), ("6 s", "0 Hz", "1 s")), {}, 0.0, 30.0)
    with pytest.raises(InputError, match="outside the flight"):
        spin_angle(spin(("28 s", "2 Hz", "4 s")), {}, 0.0, 30.0)


@pytest.mark.parametrize("text", ["600 deg/s", "10 rad/s"])
def test_a_spin_that_is_not_written_in_turns_is_refused(text):
    with pytest.raises(ValidationError, match="give the turns per second, in Hz"):
        spin(("5 s", text, "4 s"))
