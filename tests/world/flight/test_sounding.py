"""The card of a sounding rocket refuses what cannot be meant; its spin is the formula."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.errors import InputError
from lvnav_trade.world.flight.sounding import SoundingFlight, SpinStep, spin_angle
from tests.world.flights import sounding_settings


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
    with pytest.raises(ValidationError, match="turns per second are asked for, in Hz"):
        spin(("5 s", text, "4 s"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mach": [0.0, 1.0]}, "2 Mach numbers but 7 drag coefficients"),
        ({"mach": [0.0, 0.8, 0.8, 1.5, 3.0, 5.0, 10.0]}, "mach must rise"),
        ({"apogee": None, "rail": {"azimuth": "0 deg", "length": "9 m"}}, "give the rail's elevation or the apogee"),
        ({"turn_time": "30 s"}, "stage 'S-44M' is turned within turn_time, longer than its ignition_delay"),
    ],
)
def test_a_card_that_cannot_be_meant_is_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        SoundingFlight.model_validate(sounding_settings(**change))


@pytest.mark.parametrize(
    ("stage", "change", "message"),
    [
        (0, {"elevation": "80 deg"}, "the first stage starts from the rail"),
        (0, {"separation_delay": None}, "stage 'S-40TM' stays, but another burns above it"),
        (1, {"elevation": "20 deg"}, "nothing is left for the apogee"),
    ],
)
def test_a_stage_that_does_not_fit_the_others_is_refused(stage, change, message):
    settings = sounding_settings()
    stages = [dict(one) for one in settings["stages"]]
    stages[stage] |= change
    with pytest.raises(ValidationError, match=message):
        SoundingFlight.model_validate(settings | {"stages": stages})
