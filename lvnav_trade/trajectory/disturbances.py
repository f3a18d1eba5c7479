"""Coning, vibration, and disturbance of the true gravity: the cards, and the sums of sinusoids that they become."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lvnav_trade.kernels.random import source_word
from lvnav_trade.kernels.waves import sum_of_waves
from lvnav_trade.quantities import units
from lvnav_trade.quantities.conditions import Instant, resolve
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.state_layout import NO_SENSOR, ErrorTerm
from lvnav_trade.quantities.units import AccelerationSigma, Card, TimeConstant, require_rising

Complex = NDArray[np.complex128]
Axis = Literal["x", "y", "z"]


class Coning(Card):
    """Coning: `axis` describes a cone, and the rotation vector of constant length turns in the plane across it."""

    angle: Annotated[units.Angle, Field(gt=0.0, lt=0.5)] = Field(description="half-angle of the cone")
    frequency: units.Frequency
    axis: Axis = "x"
    phase: units.Angle = 0.0


class Tone(Card):
    """A sinusoid along or about a body axis, such as a thrust oscillation or a bending mode, given by its peak."""

    frequency: units.Frequency
    axis: Axis
    phase: units.Angle = 0.0
    acceleration: units.AccelerationSigma | None = Field(None, description="peak acceleration along the axis")
    angle: units.AngleSigma | None = Field(None, description="peak angle about the axis")

    def _faults(self) -> Iterator[str]:
        if (self.acceleration is None) == (self.angle is None):
            yield "give acceleration or angle, one of the two"


class Noise(Card):
    """Random vibration: a one-sided spectral density over a band, as `lines` sinusoids of fixed frequency and phase.

    The density is interpolated on logarithmic axes between the breakpoints. Phases differ by axis and depend on `name`
    alone, so that the vibration is the same in every run, case and campaign.
    """

    name: str = "vibration"
    frequency: tuple[units.Frequency, ...] = Field(
        min_length=2, description="frequencies of the breakpoints of the density, increasing"
    )
    acceleration: tuple[units.AccelerationDensity, ...] | None = Field(None, description="along each axis")
    rate: tuple[units.RateDensity, ...] | None = Field(None, description="of the body rate about each axis")
    axes: tuple[Axis, ...] = ("x", "y", "z")
    lines: int = Field(64, ge=4, le=1024)

    def _faults(self) -> Iterator[str]:
        if (self.acceleration is None) == (self.rate is None):
            yield "give acceleration or rate, one of the two"
        density = self.acceleration or self.rate or ()
        if len(density) != len(self.frequency):
            yield f"{len(self.frequency)} frequencies but {len(density)} densities"
        if any(value <= 0.0 for value in density):
            yield "a density on logarithmic axes is greater than zero"
        require_rising("frequency", self.frequency)


class SwayMode(Card):
    """Sway of a vehicle on its pad: rocking or bending about a body axis, or torsion, excited by wind.

    The IMU is rotated by an angle and displaced by that angle times the lever arm. With a damping ratio the motion is
    random and has the spectral density of a damped oscillator under white torque. It is a sum of `lines` sinusoids of
    equal power, whose frequencies and phases depend on `name` and axis alone, so that it is the same in every run, case
    and campaign. Without a damping ratio it is a single sinusoid.
    """

    name: str = "sway"
    frequency: units.Frequency
    axis: Axis
    angle: Annotated[units.Angle, Field(gt=0.0, lt=0.1)] = Field(description="root mean square at the IMU")
    lever: tuple[units.Length, units.Length, units.Length] = Field(
        (0.0, 0.0, 0.0),
        description="vector from the axis of rotation to the IMU, body axes; for a bending mode, deflection divided "
        "by slope",
    )
    damping: units.Share | None = Field(None, gt=0.0, lt=0.5, description="damping ratio; none: one sinusoid")
    lines: int = Field(32, ge=8, le=1024)


class OscillationCard(Card):
    """Coning and vibration between two times of the flight, with a ramp of length `ramp` at either end.

    They are added to the trajectory; the mean position and attitude of the IMU do not change.
    """

    start: Instant = Field(description="event, also with a duration added, or a time since lift-off")
    end: Instant
    ramp: units.TimeConstant = 0.5
    coning: tuple[Coning, ...] = ()
    tones: tuple[Tone, ...] = ()
    noise: tuple[Noise, ...] = ()
    modes: tuple[SwayMode, ...] = ()

    def _faults(self) -> Iterator[str]:
        if not (self.coning or self.tones or self.noise or self.modes):
            yield "an oscillation needs coning, tones, noise or modes"


class Oscillation(NamedTuple):
    """A small motion: the real part of a sum of k complex sinusoids, times a window with ramps.

    start, end : s since lift-off.
    ramp : s. Length of the ramps.
    omega : (k,) rad/s. Angular frequencies.
    turn : (k, 3) rad. Complex amplitude of the rotation vector at `start`, body axes.
    shift : (k, 3) m. Complex amplitude of the displacement at `start`, body axes.
    """

    start: float
    end: float
    ramp: float
    omega: Floats
    turn: Complex
    shift: Complex


class SmallMotion(NamedTuple):
    """Small motion of the body relative to its mean motion at n times, body axes.

    turn, turn_rate : (n, 3) rad, rad/s. Rotation vector and its derivative.
    shift, shift_rate, shift_acceleration : (n, 3) m, m/s, m/s^2. Displacement and its two derivatives.
    """

    turn: Floats
    turn_rate: Floats
    shift: Floats
    shift_rate: Floats
    shift_acceleration: Floats


def small_motion(oscillations: Iterable[Oscillation], t: Floats) -> SmallMotion:
    """Return the sum of oscillations at times t (n,), s since lift-off, in body axes; zero outside their windows."""
    total = SmallMotion(*(np.zeros((t.size, 3)) for _ in SmallMotion._fields))
    for oscillation in oscillations:
        motion = _oscillation_motion(oscillation, t)
        for sum_, term in zip(total, motion, strict=True):
            sum_ += term
    return total


def _oscillation_motion(oscillation: Oscillation, t: Floats) -> SmallMotion:
    """Return the motion of one oscillation, by the product rule of window and waves."""
    window, window_rate, window_acceleration = _window(oscillation, t)
    w = window[:, None]
    dw = window_rate[:, None]
    ddw = window_acceleration[:, None]
    turn_parts = np.hstack([oscillation.turn.real, oscillation.turn.imag])
    shift_parts = np.hstack([oscillation.shift.real, oscillation.shift.imag])
    waves = sum_of_waves(t - oscillation.start, oscillation.omega, turn_parts, shift_parts)
    turn, turn_rate, shift, shift_rate, shift_acceleration = np.split(waves, 5, axis=1)
    return SmallMotion(
        turn=w * turn,
        turn_rate=dw * turn + w * turn_rate,
        shift=w * shift,
        shift_rate=dw * shift + w * shift_rate,
        shift_acceleration=ddw * shift + 2.0 * dw * shift_rate + w * shift_acceleration,
    )


def _window(oscillation: Oscillation, t: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the window (n,) and its two derivatives, all exactly zero outside.

    Its ramps are quintics w = 10 x^3 - 15 x^4 + 6 x^5 with zero slope and curvature at both ends, so that attitude,
    body rate, velocity and specific force have no jump.
    """
    ramp = oscillation.ramp
    ramp_up = (t - oscillation.start) / ramp
    ramp_down = (oscillation.end - t) / ramp
    x = np.clip(np.minimum(ramp_up, ramp_down), 0.0, 1.0)
    x_rate = np.where(ramp_up <= ramp_down, 1.0, -1.0) / ramp
    to_end = 1.0 - x
    polynomial = 10.0 + x * (6.0 * x - 15.0)
    w = x**3 * polynomial
    dw = 30.0 * x**2 * to_end**2 * x_rate
    ddw = 60.0 * x * to_end * (1.0 - 2.0 * x) / ramp**2
    return w, dw, ddw


def oscillations(
    cards: Iterable[OscillationCard], events: Mapping[str, float], span: tuple[float, float]
) -> tuple[Oscillation, ...]:
    """Return the oscillations of a flight.

    Parameters
    ----------
    cards : iterable of OscillationCard
    events : mapping
        Times (s) of the events by name.
    span : (float, float)
        First and last time (s) of the flight.

    Raises
    ------
    InputError
        A time lies outside the flight, or a window is too short for its ramps.
    """
    first, last = span
    instants = {"start": first, "end": last, **events}
    result = []
    for k, card in enumerate(cards, start=1):
        start, end = resolve(card.start, instants), resolve(card.end, instants)
        place = f"oscillation {k}: "
        if end - start < 2.0 * card.ramp:
            raise InputError(f"{place}from {start:g} to {end:g} s there is no room for two ramps of {card.ramp:g} s")
        if start < first or end > last:
            raise InputError(f"{place}{start:g} to {end:g} s is not within the flight, {first:g} to {last:g} s")
        omega, turn, shift = zip(*_sinusoids(card), strict=True)
        oscillation = Oscillation(
            start=start,
            end=end,
            ramp=card.ramp,
            omega=np.array(omega),
            turn=np.array(turn),
            shift=np.array(shift),
        )
        result.append(oscillation)
    return tuple(result)


Sinusoid = tuple[float, Complex, Complex]
"""Angular frequency (rad/s), complex amplitudes of rotation vector (3,) rad and displacement (3,) m."""
_NONE: Complex = np.zeros(3, dtype=complex)


def _sinusoids(card: OscillationCard) -> list[Sinusoid]:
    """Return the sinusoids of a card."""
    sinusoids = [_coning_sinusoid(coning) for coning in card.coning]
    sinusoids += [_tone_sinusoid(tone) for tone in card.tones]
    for noise in card.noise:
        sinusoids += _noise_sinusoids(noise)
    for mode in card.modes:
        sinusoids += _mode_sinusoids(mode)
    return sinusoids


def _unit(axis: Axis, step: int = 0) -> Complex:
    """Return the unit vector of the axis `step` positions after `axis` in the cycle x, y, z."""
    index = ("xyz".index(axis) + step) % 3
    return np.eye(3, dtype=complex)[index]


def _coning_sinusoid(card: Coning) -> Sinusoid:
    # The real part of (e1 - i e2) exp(i w t) is e1 cos w t + e2 sin w t: a vector that turns about the axis.
    circle = _unit(card.axis, 1) - 1j * _unit(card.axis, 2)
    turn = card.angle * np.exp(1j * card.phase) * circle
    omega = 2.0 * math.pi * card.frequency
    return omega, turn, _NONE


def _tone_sinusoid(card: Tone) -> Sinusoid:
    omega = 2.0 * math.pi * card.frequency
    wave = -1j * np.exp(1j * card.phase) * _unit(card.axis)
    if card.angle is not None:
        return omega, card.angle * wave, _NONE
    assert card.acceleration is not None
    return omega, _NONE, -card.acceleration / omega**2 * wave  # two integrals of the acceleration


def _random_pairs(name: str, count: int) -> tuple[Floats, Floats]:
    """Return two arrays (count,) of uniform numbers from 0 to 1, from the fixed stream of a name."""
    word = source_word(name)
    raw = np.random.Philox(key=int(word)).random_raw(2 * count)
    first, second = raw.reshape(2, count) / 2.0**64
    return first, second


def _noise_sinusoids(card: Noise) -> Iterator[Sinusoid]:
    """Yield the lines of a band: equal steps of log frequency, each with one line that has the power of the step.

    Frequencies within a step and phases are drawn from a fixed stream, so that lines of two axes do not beat.
    """
    density = np.array(card.acceleration or card.rate or ())
    breakpoints = np.array(card.frequency)
    edges = np.geomspace(card.frequency[0], card.frequency[-1], card.lines + 1)
    quantity = "acceleration" if card.rate is None else "rate"
    for axis in card.axes:
        place, turns = _random_pairs(f"{card.name} {axis} {quantity}", card.lines)
        ratio = edges[1:] / edges[:-1]
        frequencies = edges[:-1] * ratio**place
        power = np.diff(_cumulative_power(breakpoints, density, edges))
        amplitudes = np.sqrt(2.0 * power)  # a sinusoid of amplitude a has the power a^2 / 2
        phases = 2.0 * np.pi * turns
        for frequency, amplitude, phase in zip(frequencies, amplitudes, phases, strict=True):
            omega = 2.0 * math.pi * frequency
            wave = amplitude * np.exp(1j * phase) * _unit(axis)
            if card.rate is not None:
                yield omega, wave / (1j * omega), _NONE
            else:
                yield omega, _NONE, -wave / omega**2


_SLOWEST, _FASTEST = 0.02, 20.0  # times the frequency of a mode: less than 1e-4 of the power lies outside


def _mode_sinusoids(card: SwayMode) -> Iterator[Sinusoid]:
    """Yield the lines of a mode: of equal power, with fixed frequencies within equal parts of the density."""
    if card.damping is None:
        yield _sway_sinusoid(card, card.frequency, math.sqrt(2.0) * card.angle, 0.0)
        return
    place, turns = _random_pairs(f"{card.name} {card.axis} mode", card.lines)
    ratio = np.geomspace(_SLOWEST, _FASTEST, 20001)
    power = _mode_power(ratio, card.damping)
    quantiles = (np.arange(card.lines) + place) / card.lines
    line_ratios = np.interp(quantiles, power / power[-1], ratio)
    peak = card.angle * math.sqrt(2.0 / card.lines)
    for line_ratio, turn in zip(line_ratios.tolist(), turns.tolist(), strict=True):
        yield _sway_sinusoid(card, line_ratio * card.frequency, peak, 2.0 * math.pi * turn)


def _mode_power(ratio: Floats, damping: float) -> Floats:
    """Return the power (n,) up to ratios (n,) of a frequency to that of a mode, of a damped oscillator.

    Its response to white torque has the density 1 / ((1 - ratio^2)^2 + (2 damping ratio)^2).
    """
    stiffness = (1.0 - ratio**2) ** 2
    friction = (2.0 * damping * ratio) ** 2
    density = 1.0 / (stiffness + friction)
    mean_density = 0.5 * (density[1:] + density[:-1])
    steps = mean_density * np.diff(ratio)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _sway_sinusoid(card: SwayMode, frequency: float, peak: float, phase: float) -> Sinusoid:
    """Return a sinusoid of a mode: its rotation vector, and the displacement of the IMU at the lever arm.

    frequency : Hz.
    peak, phase : rad. Amplitude of the rotation, and phase of the sine at the start of the window.
    """
    omega = 2.0 * math.pi * frequency
    wave = -1j * peak * np.exp(1j * phase)
    turn = wave * _unit(card.axis)
    shift = np.cross(turn, card.lever)
    return omega, turn, shift


def _cumulative_power(f: Floats, density: Floats, upper_limit: Floats) -> Floats:
    """Return the power (n,) between f[0] and `upper_limit` of a density that is linear on logarithmic axes.

    Each piece is density f^s, with the integral f^(s + 1) / (s + 1), or log f for s = -1.

    f : (m,) Hz. Breakpoints.
    density : (m,). One-sided density at the breakpoints, square of an SI unit per Hz.
    upper_limit : (n,) Hz. Upper limits of integration.
    """
    slope = np.diff(np.log(density)) / np.diff(np.log(f))
    total = np.zeros_like(upper_limit)
    for k, exponent in enumerate(slope + 1.0):
        upper = np.clip(upper_limit, f[k], f[k + 1]) / f[k]
        scale = density[k] * f[k]
        if abs(exponent) < 1e-12:
            total += scale * np.log(upper)
        else:
            total += scale / exponent * (upper**exponent - 1.0)
    return total


# Driver of a disturbance that is no sensor error: an acceleration along the axes of frame i.
GRAVITY = -2


class GravityCard(Card):
    """Gravity disturbance as a Gauss-Markov process in time, per axis (10 to 50 mGal over land; a correlation length of
    tens of kilometres passes in seconds at orbital speed: Jordan, J. Geophys. Res. 77 (1972) 3660).
    """

    sigma: AccelerationSigma
    time: TimeConstant | None = Field(20.0, description="correlation time; none: constant over the flight")


def disturbance(card: GravityCard | None) -> tuple[ErrorTerm, ...]:
    """Return the disturbance as a true error term in a tuple; an empty tuple without a card or with zero sigma."""
    if card is None or card.sigma == 0.0:
        return ()
    correlation_time = card.time or math.inf
    return (ErrorTerm("gravity disturbance", 0, NO_SENSOR, GRAVITY, card.sigma, 0.0, correlation_time),)
