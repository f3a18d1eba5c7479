"""Spin of a body about its roll axis: steps of the spin rate, and the roll angle."""

import math
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field
from scipy.interpolate import PPoly

from lvnav_trade.quantities.conditions import Instant, resolve
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.units import Card, TimeConstant, TurnRate


def _refuse_angle_rate(value: Any) -> Any:
    """Refuse an angle per time, because as a frequency it would be read as turns per time, 6 times too fast."""
    if isinstance(value, str) and ("rad" in value or "deg" in value):
        raise ValueError(f"{value!r}: give the turns per second, in Hz")
    return value


class SpinStep(Card):
    """A smooth change of the spin rate, for example due to canted fins or a yo-yo despin."""

    at: Instant = Field(description="event, also with a duration added, or a time since lift-off")
    frequency: Annotated[TurnRate, BeforeValidator(_refuse_angle_rate)] = Field(
        description="spin rate about the x axis from that time, in turns per second"
    )
    over: TimeConstant


def spin_angle(steps: tuple[SpinStep, ...], events: dict[str, float], start: float, end: float) -> PPoly | None:
    """Return the roll angle (rad) from start to end (s) with an initial spin of zero; None without any spin.

    The spin rate is constant between the steps. In a step it changes to the next rate by 6 x^5 - 15 x^4 + 10 x^3.
    """
    if not steps:
        return None
    times = [start - 1.0]
    coefficients = []  # of the spin rate (Hz) in each interval, from the highest power of time down
    rate = 0.0
    for step in steps:
        begin = resolve(step.at, events)
        if begin < times[-1] or begin + step.over > end:
            raise InputError(f"spin: the step at {step.at!r} overlaps the one before, or lies outside the flight")
        change = step.frequency - rate
        span = step.over
        quintic = [
            6.0 * change / span**5,
            -15.0 * change / span**4,
            10.0 * change / span**3,
            0.0,
            0.0,
            rate,
        ]
        coefficients += [_constant(rate), quintic]
        times += [begin, begin + span]
        rate = step.frequency
    coefficients.append(_constant(rate))
    edges = np.array([*times, end + 1.0])
    angular_coefficients = 2.0 * math.pi * np.array(coefficients).T
    angular_rate = PPoly(angular_coefficients, edges)
    return angular_rate.antiderivative()


def _constant(rate: float) -> list[float]:
    """Return the coefficients of a constant, as a polynomial of fifth degree."""
    return [0.0] * 5 + [rate]
