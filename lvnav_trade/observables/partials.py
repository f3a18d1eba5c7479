"""Partial derivatives of measurements beyond the navigation state: biases, delays, timing, lever arm.

Truth and model both ask here, each with its own geometry: a shared error of the measurement on one side, an extra
state of the filter on the other. A channel is an observable of one satellite (tight: pseudorange and range rate, then
what else the filter measures of it) or an axis of the receiver's solution (loose: position, velocity).
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.layout import BY_SATELLITE, RELATIVE
from lvnav_trade.records import Floats, Ints

FURTHER = ("carrier_phase", "tdcp", "delta_pseudorange")
"""Observables of a satellite beside pseudorange and range rate, in the order of their channels."""
PHASES = ("carrier_phase", "tdcp")
DIFFERENCES = {"tdcp": "carrier_phase", "delta_pseudorange": "pseudorange"}
"""Observables that are the difference of two successive epochs, and of what."""
LABELS = {
    "pseudorange": "range",
    "range_rate": "range rate",
    "carrier_phase": "carrier phase",
    "tdcp": "phase difference",
    "delta_pseudorange": "range difference",
}
# Errors of a single observable: the state that a filter has for each.
OF_ONE = {"ambiguity": "carrier_phase", "phase_noise": "tdcp", "code_noise": "delta_pseudorange"}
LEVER_AXES = ("lever_x", "lever_y", "lever_z")
RANGE_ONLY = ("range_bias", "time_offset")
RATE_ONLY = ("range_rate_offset",)
SATELLITE_KINDS = (
    *RANGE_ONLY,
    *RATE_ONLY,
    "timing",
    "troposphere_scale",
    "ionosphere_scale",
    *BY_SATELLITE,
    *LEVER_AXES,
    *OF_ONE,
)
SOLUTION_KINDS = ("position_bias", "velocity_bias", "timing", "troposphere_scale", "ionosphere_scale")


class SensorState(NamedTuple):
    """An extra state of the filter for a lasting error of a sensor: name, label, initial sigma, time constant (s),
    unit (SI unit, unit and factor for people), partial (n_epoch, n_scalar) of the scalars, all as the filter assumes.
    """

    name: str
    label: str
    sigma: float
    time_constant: float
    unit: tuple[str, str, float]
    partial: Floats


class SensorChannels(NamedTuple):
    """The channels of a sensor beside the receiver: name, what it measures, a label for each scalar, and the states
    that a filter may have for its lasting errors.
    """

    name: str
    measures: str
    labels: tuple[str, ...]
    states: tuple[SensorState, ...] = ()


class Channels(NamedTuple):
    """The channels of a case: tight; satellites (n_sat,) names, systems letters, seen whether ever tracked; receiver:
    what it measures is processed; sensors beside the receiver, whose channels come last; further: what is measured of
    each satellite beside range and range rate.
    """

    tight: bool
    satellites: tuple[str, ...]
    systems: tuple[str, ...]
    seen: tuple[bool, ...]
    receiver: bool = True
    sensors: tuple[SensorChannels, ...] = ()
    further: tuple[str, ...] = ()

    @property
    def observables(self) -> tuple[str, ...]:
        """What the channels of a satellite are of, in their order."""
        return ("pseudorange", "range_rate", *self.further)

    def of(self, observable: str) -> slice:
        """Return the channels of an observable of the satellites."""
        return slice(self.observables.index(observable), self.n_receiver, len(self.observables))

    @property
    def n_channel(self) -> int:
        """How many channels there are."""
        return self.n_receiver + sum(len(sensor.labels) for sensor in self.sensors)

    @property
    def n_receiver(self) -> int:
        """How many of them are the receiver's: they come first."""
        return len(self.observables) * len(self.satellites) if self.tight else 6

    @property
    def first(self) -> tuple[int, ...]:
        """The first channel of each sensor."""
        counts = [0, *(len(sensor.labels) for sensor in self.sensors)]
        return tuple(self.n_receiver + sum(counts[: k + 1]) for k in range(len(self.sensors)))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the channels: what is measured of each satellite in turn, or the receiver's position and
        velocity, then those of the sensors.
        """
        if self.tight:
            found = [f"{name} {LABELS[what]}" for name in self.satellites for what in self.observables]
        else:
            found = [f"{what} {axis}" for what in ("position", "velocity") for axis in "xyz"]
        found += [" ".join((s.name, label)).strip() for s in self.sensors for label in s.labels]
        return tuple(found)


class Geometry(NamedTuple):
    """Geometry at the epochs from which the partial derivatives of measurements are computed, SI, frame i.

    rate : (n_epoch, n_sat) m/s. Range rate.
    acceleration : (n_epoch, n_sat) m/s^2. Second derivative of the range.
    velocity : (n_epoch, 3) m/s. Velocity of the antenna.
    push : (n_epoch, 3) m/s^2. Acceleration of the antenna.
    troposphere : (n_epoch, n_sat, 2) m, m/s. Tropospheric delay and its rate.
    ionosphere : (n_epoch, n_sat, 2) m, m/s. Ionospheric delay and its rate.
    solution_troposphere : (n_epoch, 6) m, m/s. Error that the tropospheric delay causes in a least-squares solution.
    solution_ionosphere : (n_epoch, 6) m, m/s. Error that the ionospheric delay causes in a least-squares solution.
    lever : (n_epoch, n_sat, 2, 3). Derivative of range and range rate with respect to the lever arm, body axes.
    """

    rate: Floats
    acceleration: Floats
    velocity: Floats
    push: Floats
    troposphere: Floats
    ionosphere: Floats
    solution_troposphere: Floats
    solution_ionosphere: Floats
    lever: Floats


def members(kind: str, channels: Channels) -> tuple[tuple[str, ...], Ints]:
    """Return the components of a kind by their labels, and which one stands in each channel, (n_channel,), -1 none.

    A range bias, or a scale factor by satellite, has a component for each satellite that is ever tracked, and so have
    an ambiguity and the noise of an observable; a time offset one for each system but GPS (or the first), a solution's
    bias one for each axis of frame i, a relative bias of two inertial units one for each body axis, everything else one
    for all channels.
    """
    member, n = np.full(channels.n_channel, -1, dtype=np.int64), channels.n_receiver
    if kind in RELATIVE.values():
        for at, sensor in zip(channels.first, channels.sensors, strict=True):
            if RELATIVE.get(sensor.measures) == kind:
                member[at : at + 3] = range(3)
        return ("x", "y", "z") if np.any(member >= 0) else (), member
    if not channels.tight:
        if kind not in SOLUTION_KINDS:
            return (), member
        axes = {"position_bias": [0, 1, 2, -1, -1, -1], "velocity_bias": [-1, -1, -1, 0, 1, 2]}
        member[:n] = axes.get(kind, 0)
        return ("x", "y", "z") if kind in axes else ("",), member
    if kind not in SATELLITE_KINDS:
        return (), member
    if kind in OF_ONE and OF_ONE[kind] not in channels.further:
        return (), member
    if kind == "range_bias" or kind in OF_ONE or kind in BY_SATELLITE:
        labels = tuple(name for name, seen in zip(channels.satellites, channels.seen, strict=True) if seen)
        owner = [labels.index(n) if n in labels else -1 for n in channels.satellites]
    elif kind == "time_offset":
        reference = "G" if "G" in channels.systems else channels.systems[0]
        labels = tuple(s for s in dict.fromkeys(channels.systems) if s != reference)
        owner = [labels.index(s) if s in labels else -1 for s in channels.systems]
    else:
        labels, owner = ("",), [0] * len(channels.satellites)
    for observable in channels.observables:
        if _is_in(kind, observable):
            member[channels.of(observable)] = owner
    return labels, member


def sensor_states(name: str, channels: Channels) -> Iterator[tuple[SensorState, Ints, Floats]]:
    """Yield the states of a name for lasting errors of sensors, each with its component in each channel, (n_channel,)
    -1 none, and its partials (n_epoch, n_channel).
    """
    for first, sensor in zip(channels.first, channels.sensors, strict=True):
        own = slice(first, first + len(sensor.labels))
        for state in sensor.states:
            if state.name == name:
                member = np.full(channels.n_channel, -1, dtype=np.int64)
                member[own] = np.where(np.any(state.partial != 0.0, axis=0), 0, -1)
                entering = np.zeros((len(state.partial), channels.n_channel))
                entering[:, own] = state.partial
                yield state, member, entering


def _is_in(kind: str, observable: str) -> bool:
    """Return whether an error of a kind may be in an observable of the satellites."""
    if kind in OF_ONE:
        return OF_ONE[kind] == observable
    is_rate = observable == "range_rate"
    return is_rate if kind in RATE_ONLY else not (is_rate and kind in RANGE_ONLY)


def partial(kind: str, geometry: Geometry, channels: Channels) -> Floats:
    """Return the derivative (n_epoch, n_channel) of the measurements with respect to their component of a kind.

    Units: m/m and (m/s)/m of biases and lever arms, m/1 and (m/s)/1 of scale factors of delays, m/s and m/s^2 of a
    timing error. A measurement that is late by s seconds is that of s seconds before.
    """
    found, n = np.zeros((len(geometry.rate), channels.n_channel)), channels.n_receiver
    if channels.tight:
        for observable in channels.observables:
            found[:, channels.of(observable)] = _of_range(kind, geometry, observable)
    else:
        first, second = slice(0, 3), slice(3, n)
        pairs: dict[str, Any] = {
            "timing": (-geometry.velocity, -geometry.push),
            "troposphere_scale": np.hsplit(geometry.solution_troposphere, 2),
            "ionosphere_scale": np.hsplit(geometry.solution_ionosphere, 2),
            **dict.fromkeys(("position_bias", "velocity_bias"), (1.0, 1.0)),
        }
        found[:, first], found[:, second] = pairs.get(BY_SATELLITE.get(kind, kind), (0.0, 0.0))
    return found


def _of_range(kind: str, geometry: Geometry, observable: str) -> Any:
    """Return the derivative (n_epoch, n_sat), or one number, of an observable of the satellites, see `partial`. That of
    a difference of two epochs is its derivative with respect to the later one.
    """
    is_rate, carrier = observable == "range_rate", -1.0 if observable in PHASES else 1.0
    if kind in (*RANGE_ONLY, *RATE_ONLY, *OF_ONE):
        return float(_is_in(kind, observable))
    order = int(is_rate)
    pairs: dict[str, Any] = {
        "timing": (-geometry.rate, -geometry.acceleration)[order],
        "troposphere_scale": geometry.troposphere[..., order],
        "ionosphere_scale": carrier * geometry.ionosphere[..., order],
        **{axis: geometry.lever[:, :, order, i] for i, axis in enumerate(LEVER_AXES)},
    }
    return pairs.get(BY_SATELLITE.get(kind, kind), 0.0)
