"""IMU arrays: position and sensing axes of each IMU, and their least-squares combination.

Every sensing axis h (unit vector, body axes) gives y = h . x + e of the same rate or specific force x. The fused triad
is x^ = A y with A = (H' W H)^-1 H' W, so an error e of an axis enters as its column of A.
"""

import math
from collections.abc import Callable, Iterable
from operator import attrgetter
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Discriminator, Field, Tag

from lvnav_trade import units
from lvnav_trade.kernels.transition import ACCEL, GYRO
from lvnav_trade.layout import ErrorTerm
from lvnav_trade.per_axis import PerAxis, rms, squares
from lvnav_trade.records import Floats
from lvnav_trade.units import NamedCard
from lvnav_trade.world.sensors.imu import AccelCard, GyroCard, ImuCard, error_terms
from lvnav_trade.world.sensors.redundancy import ParityCard

SMALLEST = 1e-6
"""Smallest ratio of singular values of sensing axes that still span three dimensions."""

Direction = tuple[float, float, float]


class MountedUnit(ImuCard):
    """One unit of a set: an inertial unit, and how it is mounted."""

    lever_arm: tuple[units.Length, units.Length, units.Length] = Field(
        (0.0, 0.0, 0.0), description="from the reference point, which is what is navigated, body axes"
    )
    orientation: tuple[units.Angle, units.Angle, units.Angle] = Field(
        (0.0, 0.0, 0.0), description="roll, pitch, yaw from body axes to those of the unit (3-2-1)"
    )
    axes: tuple[Direction, ...] | None = Field(
        None,
        description="directions that it senses along, in its own axes: rows of the mounting matrix, of any length; "
        "none: x, y, z",
    )

    def _faults(self) -> Iterable[str]:
        if self.axes == ():
            yield "axes: no direction to sense along"
        for axis in self.axes or ():
            if not any(axis):
                yield "axes: a direction of length zero"

    @property
    def directions(self) -> Floats:
        """Unit vectors (n, 3) that it senses along, body axes."""
        own = np.eye(3) if self.axes is None else np.array(self.axes, dtype=float)
        if not any(self.orientation):
            return np.asarray(own / np.linalg.norm(own, axis=1)[:, None])
        (sr, sp, sy), (cr, cp, cy) = np.sin(self.orientation), np.cos(self.orientation)
        turn = np.array(
            [
                [cp * cy, cp * sy, -sp],
                [sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp],
                [cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp],
            ]
        )
        return np.asarray(own / np.linalg.norm(own, axis=1)[:, None] @ turn)


class ImuSet(NamedCard):
    """Inertial units whose increments are fused, sample by sample, to those of one triad at the reference point."""

    name: str = "several units"
    source: str = ""
    units: tuple[MountedUnit, ...] = Field(description="one or more, all of one rate")
    weights: Literal["random_walk", "bias", "equal"] = Field(
        "random_walk",
        description="of a sensing axis in the least squares: inverse square of its random walk, or of its bias "
        "(repeatability and instability), or one",
    )
    lever_arms: Literal["compensated", "ignored"] = Field(
        "compensated",
        description="compensated: tangential and centripetal acceleration, from the fused rate and its change over a "
        "sample, are taken off what each unit senses; ignored: they stay in it",
    )

    selection: Literal["mean", "mid_value"] = Field(
        "mean",
        description="mean: least squares of all; mid_value: on each body axis the middle one of what the units sense, "
        "of an even number the mean of the middle two",
    )
    parity: ParityCard | None = Field(None, description="test of the units against each other; none: no test")

    def _faults(self) -> Iterable[str]:
        if not self.units:
            yield "units: there is none"
        yield from _unfit_for_redundancy(self)
        for number, unit in enumerate(self.units[1:], start=1):
            if unit.rate != self.rate:
                yield (
                    f"units.{number}.rate: {unit.rate:g} Hz, the first unit has {self.rate:g} Hz; increments are fused "
                    "sample by sample"
                )
        singular = np.linalg.svd(np.vstack([unit.directions for unit in self.units]), compute_uv=False)
        rank = int(np.sum(singular > SMALLEST * singular[0]))
        if rank < 3:
            yield f"units: the sensing axes span {rank} of 3 dimensions: a rate across them is not measured"
        for label, sizes in (("gyro", _sizes(self, "gyro")), ("accel", _sizes(self, "accel"))):
            if sizes.any() and not sizes.all():
                yield f"weights: {self.weights}: units.{int(np.argmin(sizes))}.{label} has none; weight them equally"

    @property
    def rate(self) -> float:
        """Samples per second (Hz), the same of all units."""
        return self.units[0].rate

    @property
    def process_rate(self) -> float:
        """How often time-varying errors take a step (Hz): the most that a unit asks for."""
        return max(unit.process_rate for unit in self.units)


def _unfit_for_redundancy(card: ImuSet) -> Iterable[str]:
    """Yield what a selection, or a test of units against each other, lacks."""
    spans = [np.linalg.matrix_rank(unit.directions, tol=SMALLEST) for unit in card.units]
    if card.selection == "mid_value":
        if min(spans, default=3) < 3:
            yield f"selection: mid_value: units.{int(np.argmin(spans))} senses along {min(spans)} of 3 dimensions"
        if card.weights != "random_walk":
            yield f"weights: {card.weights}: the middle one of several readings has none"
        if len(card.units) < 3:
            yield f"selection: mid_value: the middle of {len(card.units)} is their mean; it takes three units or more"
        if any(one.quantisation > 0.0 for unit in card.units for one in (unit.gyro, unit.accel)):
            yield "selection: mid_value: what quantisation holds back of a unit is lost where another one is selected"
    if card.parity is not None:
        yield from _untestable(card, card.parity)
    if card.parity is not None and card.parity.window * card.rate < 1.0:
        yield f"parity.window: {card.parity.window:g} s is less than a sample of {1.0 / card.rate:g} s"
    for number, unit in enumerate(card.units):
        for name, one in (("gyro", unit.gyro), ("accel", unit.accel)):
            if (card.parity is not None or card.selection == "mid_value") and rms(one.random_walk) <= 0.0:
                yield f"units.{number}.{name}.random_walk: is zero; thresholds of redundant units need it, give it"


def excludes_units(card: ImuCard | ImuSet) -> bool:
    """Whether a failed unit no longer enters what is fused: by a test that excludes it, or by the middle reading."""
    if isinstance(card, ImuCard):
        return False
    return card.selection == "mid_value" or (card.parity is not None and card.parity.after_detection == "exclude")


def _untestable(card: ImuSet, parity: ParityCard) -> Iterable[str]:
    """Yield why a test of the units against each other can do nothing."""
    if sum(len(unit.directions) for unit in card.units) <= 3:
        yield "parity: the axes are as many as the test needs to fit: no failure can be detected"
    elif parity.after_detection == "exclude" and not any(_tested_without(card, k) for k in range(len(card.units))):
        yield (
            "parity: without a unit the others have no axis more than they need: none can be isolated; give a third "
            "unit, or skewed axes, or after_detection: report"
        )


def _tested_without(card: ImuSet, number: int) -> bool:
    """Return whether the units of a set without one of them sense along four axes or more, in three dimensions."""
    left = [unit.directions for at, unit in enumerate(card.units) if at != number]
    axes = np.vstack(left) if left else np.zeros((0, 3))
    return len(axes) > 3 and int(np.linalg.matrix_rank(axes, tol=SMALLEST)) == 3


def _kind_of(value: Any) -> str:
    several = "units" in value if isinstance(value, dict) else isinstance(value, ImuSet)
    return "several_units" if several else "one_unit"


Imu = Annotated[Annotated[ImuCard, Tag("one_unit")] | Annotated[ImuSet, Tag("several_units")], Discriminator(_kind_of)]
"""An inertial unit, or several as a list `units`."""


def _sizes(card: ImuSet, sensor: str) -> Floats:
    """Return what the weights of the units' axes are the inverse squares of, (n_unit,); ones for equal weights."""
    cards = [getattr(unit, sensor) for unit in card.units]
    if card.weights == "equal":
        return np.ones(len(cards))
    if card.weights == "bias":
        return np.array([math.hypot(rms(one.bias_repeatability), one.instability_sigma) for one in cards])
    return np.array([rms(one.random_walk) for one in cards])


class Triad(NamedTuple):
    """Up to three sensing axes of a unit, whose errors are drawn together: number of the unit; frames (3, 3, 3) of each
    axis in body axes: its own direction, then those that its misalignments are towards; gyro, accel (3, 3) columns by
    which an error of an axis enters the fused triad, body axes. An axis that is missing is zero everywhere.
    """

    unit: int
    n_axis: int
    frames: Floats
    gyro: Floats
    accel: Floats


def least_squares(directions: Floats, weights: Floats) -> Floats:
    """Return A (3, n) with x = A y for readings y along unit vectors (n, 3) of the given weights (n,)."""
    weighted = directions * weights[:, None]
    return np.asarray(np.linalg.solve(weighted.T @ directions, weighted.T))


def _frames(axes: Floats) -> Floats:
    """Return a right-handed frame (n, 3, 3) for each of the axes (n, 3): of an orthogonal triad the axes themselves, in
    turn, so that a misalignment is towards the next one.
    """
    if len(axes) == 3 and np.allclose(axes @ axes.T, np.eye(3), atol=1e-12) and np.linalg.det(axes) > 0.0:
        return np.array([np.roll(axes, -k, axis=0) for k in range(3)])
    least = np.eye(3)[np.argmin(np.abs(axes), axis=1)]
    first = np.cross(axes, least)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([axes, first, np.cross(axes, first)], axis=1)


def triads_of(card: ImuSet) -> tuple[Triad, ...]:
    """Return the triads of a set, unit by unit."""
    directions = [unit.directions for unit in card.units]
    count = [len(axes) for axes in directions]
    solved = []
    for sensor in ("gyro", "accel"):
        sizes = _sizes(card, sensor)
        sizes = sizes / sizes[0] if sizes.all() else np.ones(len(sizes))
        solved.append(least_squares(np.vstack(directions), np.repeat(sizes**-2.0, count)))
    found, at = [], 0
    for number, axes in enumerate(directions):
        for first in range(0, len(axes), 3):
            here = axes[first : first + 3]
            n, frames = len(here), np.zeros((3, 3, 3))
            frames[:n] = _frames(here)
            gyro, accel = (np.pad(A[:, at : at + n], ((0, 0), (0, 3 - n))) for A in solved)
            found.append(Triad(number, n, frames, gyro, accel))
            at += n
    return tuple(found)


def keyed(label: str, unit: int) -> str:
    """Return the key of an error source of a unit (from 0): the first has those of a unit alone."""
    return f"unit {unit + 1} {label}" if unit else label


def own_solutions(card: ImuSet) -> Floats:
    """Return for every triad the columns (n_triad, 3, 3) by which its axes enter the solution of their unit alone."""
    found = [np.zeros((3, 3)) for _ in triads_of(card)]
    for number, unit in enumerate(card.units):
        A, at = np.linalg.pinv(unit.directions), 0  # of fewer than three axes it is none, and stands for nothing
        for triad, one in enumerate(triads_of(card)):
            if one.unit == number:
                found[triad][:, : one.n_axis], at = A[:, at : at + one.n_axis], at + one.n_axis
    return np.array(found)


def axis_weights(card: ImuSet) -> Floats:
    """Return the weight in the least squares of the axes of every triad, (2, n_triad) of gyro and accelerometer; one
    for a selection.
    """
    owners = [triad.unit for triad in triads_of(card)]
    if card.selection == "mid_value":
        return np.ones((2, len(owners)))
    sizes = [_sizes(card, sensor) for sensor in ("gyro", "accel")]
    return np.array([(own / own[0] if own.all() else np.ones(own.size))[owners] ** -2.0 for own in sizes])


def axis_counts(imu: ImuCard | ImuSet) -> tuple[int, ...]:
    """Return how many sensing axes each unit has."""
    return (3,) if isinstance(imu, ImuCard) else tuple(len(unit.directions) for unit in imu.units)


def mounted(imu: ImuCard | ImuSet) -> list[tuple[int, ImuCard]]:
    """Return number (from 0) and card of the unit of every triad; of a unit alone its own."""
    return [(0, imu)] if isinstance(imu, ImuCard) else [(triad.unit, imu.units[triad.unit]) for triad in triads_of(imu)]


def terms_of(imu: ImuCard | ImuSet) -> list[ErrorTerm]:
    """Return the true error parameters of a unit, or of all units of a set, triad by triad."""
    if isinstance(imu, ImuCard):
        return error_terms(imu)
    owners = mounted(imu)
    return [
        term._replace(name=keyed(term.name, unit), part=term.part + 3 * owners[:triad].count((unit, card)), triad=triad)
        for triad, (unit, card) in enumerate(owners)
        for term in error_terms(card)
    ]


def _fused(imu: ImuSet, sensor: int, value: Callable[[Any], PerAxis]) -> PerAxis:
    """Return the fused one-sigma of an error that every sensing axis has of its own; value: its one-sigma. Of units
    whose axes are alike it is the mean over the axes of the body, else that of each.
    """
    found, alike = np.zeros(3), True
    for triad in triads_of(imu):
        A, card = (
            (triad.gyro, imu.units[triad.unit].gyro) if sensor == GYRO else (triad.accel, imu.units[triad.unit].accel)
        )
        found += A**2 @ squares(value(card))
        alike &= not isinstance(value(card), tuple)
    if alike:
        return math.sqrt(float(found.sum()) / 3.0)
    x, y, z = np.sqrt(found).tolist()
    return x, y, z


def _fused_matrix(imu: ImuSet, sensor: int, own: str, across: str) -> tuple[float, float]:
    """Return the one-sigma of the fused matrix of scale factors (diagonal) and misalignments (beside it), mean over its
    entries: a scale factor of a skewed axis is both.
    """
    variance = np.zeros((3, 3))
    for triad in triads_of(imu):
        unit = imu.units[triad.unit]
        A, card = (triad.gyro, unit.gyro) if sensor == GYRO else (triad.accel, unit.accel)
        scale, skew = rms(getattr(card, own)) ** 2, rms(getattr(card, across, 0.0)) ** 2 if across else 0.0
        of_axis = scale * triad.frames[:, 0] ** 2 + skew * (triad.frames[:, 1] ** 2 + triad.frames[:, 2] ** 2)
        variance += A**2 @ of_axis
    diagonal = float(np.trace(variance))
    return math.sqrt(diagonal / 3.0), math.sqrt((float(variance.sum()) - diagonal) / 6.0)


def _fused_card(imu: ImuSet, sensor: int) -> dict[str, Any]:
    cards = [unit.gyro if sensor == GYRO else unit.accel for unit in imu.units]
    names = ["random_walk", "rate_random_walk", "bias_repeatability", "quantisation"]
    found: dict[str, Any] = {name: _fused(imu, sensor, attrgetter(name)) for name in names}
    found["bias_instability"] = _fused(imu, sensor, lambda one: one.instability_axes(one.instability_sigma))
    found["scale_factor"], found["misalignment"] = _fused_matrix(imu, sensor, "scale_factor", "misalignment")
    found["scale_factor_drift"], _ = _fused_matrix(imu, sensor, "scale_factor_drift", "")
    if sensor == GYRO:
        found["g_sensitivity"] = _fused(imu, sensor, attrgetter("g_sensitivity"))
    # the driving noise of several Gauss-Markov processes adds up: the time constant that goes with their sum
    drive = (
        sum(
            one.sigma**2 / one.time_constant * float(np.sum((t.gyro if sensor == GYRO else t.accel) ** 2))
            for t in triads_of(imu)
            for one in [cards[t.unit].instability]
        )
        / 3.0
    )
    found["instability_time"] = rms(found["bias_instability"]) ** 2 / drive if drive > 0.0 else 100.0
    return found


def equivalent(imu: ImuCard | ImuSet) -> ImuCard:
    """Return the unit that the fused triad of a set is like; of a unit alone the unit.

    Its one-sigmas are means over the three axes, or those of each where the axes of a unit differ; of scale factors and
    misalignments means. Nonlinearity, bandwidth and warming, which do not add up to one of their kind, are left out.
    """
    if isinstance(imu, ImuCard):
        return imu
    return ImuCard.model_construct(
        name=imu.name,
        source=imu.source,
        rate=imu.rate,
        process_rate=imu.process_rate,
        gyro=GyroCard.model_construct(**_fused_card(imu, GYRO)),
        accel=AccelCard.model_construct(**_fused_card(imu, ACCEL)),
    )
