"""IMU arrays: position and sensing axes of each IMU, and their least-squares combination.

Every sensing axis h (unit vector, body axes) gives y = h . x + e of the same rate or specific force x. The fused triad
is x^ = A y with A = (H' W H)^-1 H' W, so an error e of an axis enters as its column of A.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from operator import attrgetter
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Discriminator, Field, Tag

from lvnav_trade.imu.error_model import AccelCard, GyroCard, ImuCard, error_terms
from lvnav_trade.imu.redundancy import ParityCard
from lvnav_trade.kernels.transition import ACCEL, GYRO
from lvnav_trade.quantities import units
from lvnav_trade.quantities.conditions import Instant
from lvnav_trade.quantities.per_axis import PerAxis, rms, squares
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.state_layout import ErrorTerm
from lvnav_trade.quantities.units import NamedCard

SMALLEST = 1e-6
"""Smallest ratio of singular values of sensing axes that still span three dimensions."""

Direction = tuple[float, float, float]


class MountedImu(ImuCard):
    """An IMU of an array, with its position and orientation."""

    lever_arm: tuple[units.Length, units.Length, units.Length] = Field(
        (0.0, 0.0, 0.0), description="vector from the reference point of navigation, body axes"
    )
    orientation: tuple[units.Angle, units.Angle, units.Angle] = Field(
        (0.0, 0.0, 0.0), description="roll, pitch, yaw from body axes to those of the unit (3-2-1)"
    )
    axes: tuple[Direction, ...] | None = Field(
        None,
        description="sensing directions in axes of the unit: rows of the mounting matrix, of any length; none: x, y, z",
    )

    def _faults(self) -> Iterable[str]:
        if self.axes == ():
            yield "axes: no direction to sense along"
        for axis in self.axes or ():
            if not any(axis):
                yield "axes: a direction of length zero"

    @property
    def directions(self) -> Floats:
        """Unit vectors (n, 3) of its sensing axes, body axes."""
        axes = np.eye(3) if self.axes is None else np.array(self.axes, dtype=float)
        if not any(self.orientation):
            return np.asarray(axes / np.linalg.norm(axes, axis=1)[:, None])
        (sr, sp, sy), (cr, cp, cy) = np.sin(self.orientation), np.cos(self.orientation)
        turn = np.array(
            [
                [cp * cy, cp * sy, -sp],
                [sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp],
                [cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp],
            ]
        )
        return np.asarray(axes / np.linalg.norm(axes, axis=1)[:, None] @ turn)


class ImuSet(NamedCard):
    """IMU array: the increments of its IMUs are fused, sample by sample, into one triad at the reference point."""

    name: str = "several units"
    source: str = ""
    units: tuple[MountedImu, ...] = Field(description="one or more units, all with the same rate")
    weights: Literal["random_walk", "bias", "equal"] = Field(
        "random_walk",
        description="weight of a sensing axis in the least squares: inverse square of its random walk, or of its bias"
        " (repeatability and instability), or equal",
    )
    lever_arms: Literal["compensated", "ignored"] = Field(
        "compensated",
        description="compensated: tangential and centripetal accelerations, from the fused rate and its change over a"
        " sample, are subtracted from the output of each unit; ignored: they are not",
    )

    selection: Literal["mean", "mid_value", "prime"] = Field(
        "mean",
        description="mean: least squares of all units; mid_value: on each body axis the middle value of the units, or"
        " the mean of the two middle values of an even number; prime: the first unit alone, after a hand-over the next",
    )
    hand_over: Instant | None = Field(
        None, description="time or event at which the next unit replaces the prime one; none: by parity alone"
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
        """Sample rate (Hz), common to all IMUs."""
        return self.units[0].rate

    @property
    def process_rate(self) -> float:
        """Rate (Hz) of the steps of time-varying errors: the highest of the IMUs."""
        return max(unit.process_rate for unit in self.units)


def _unfit_for_redundancy(card: ImuSet) -> Iterable[str]:
    """Yield the input errors of mid-value selection and of the parity test."""
    spans = [np.linalg.matrix_rank(unit.directions, tol=SMALLEST) for unit in card.units]
    if card.selection == "mid_value":
        if min(spans, default=3) < 3:
            yield f"selection: mid_value: units.{int(np.argmin(spans))} senses along {min(spans)} of 3 dimensions"
        if card.weights != "random_walk":
            yield f"weights: {card.weights}: mid-value selection has no weights"
        if len(card.units) < 3:
            yield f"selection: mid_value: the middle of {len(card.units)} is their mean; it takes three units or more"
        if any(triad.quantisation > 0.0 for unit in card.units for triad in (unit.gyro, unit.accel)):
            yield "selection: mid_value: the rounding residual of a unit is lost when another unit is selected"
    yield from _unfit_for_hand_over(card, spans)
    if card.parity is not None:
        yield from _untestable(card, card.parity)
    if card.parity is not None and card.parity.window * card.rate < 1.0:
        yield f"parity.window: {card.parity.window:g} s is less than a sample of {1.0 / card.rate:g} s"
    for number, unit in enumerate(card.units):
        for name, triad in (("gyro", unit.gyro), ("accel", unit.accel)):
            if (card.parity is not None or card.selection == "mid_value") and rms(triad.random_walk) <= 0.0:
                yield f"units.{number}.{name}.random_walk: is zero; thresholds of redundant units need it, give it"


def _unfit_for_hand_over(card: ImuSet, spans: Sequence[int]) -> Iterable[str]:
    """Yield what a prime unit and its hand-over lack; spans: dimensions that each unit senses along."""
    by_parity = card.parity is not None and card.parity.after_detection == "hand_over"
    if card.selection != "prime":
        if by_parity or card.hand_over is not None:
            field = "parity.after_detection" if by_parity else "hand_over"
            yield f"{field}: a hand-over from a prime unit to the next one needs selection: prime"
        return
    if len(card.units) < 2:
        yield "selection: prime: there is no unit to hand over to; give two or more"
    if min(spans, default=3) < 3:
        yield f"selection: prime: units.{int(np.argmin(spans))} senses along {min(spans)} of 3 dimensions"
    if card.weights != "random_walk":
        yield f"weights: {card.weights}: one unit is used at a time, so there are no weights"
    if (card.hand_over is None) == (card.parity is None):
        yield "selection: prime: a hand-over is at a time or by parity; state either hand_over or parity"


def excludes_units(card: ImuCard | ImuSet) -> bool:
    """Whether a failed IMU is excluded from the fused increments: by parity, mid-value selection, or a hand-over."""
    if isinstance(card, ImuCard):
        return False
    tested = card.parity is not None and card.parity.after_detection != "report"
    return card.selection == "mid_value" or tested or card.hand_over is not None


def _untestable(card: ImuSet, parity: ParityCard) -> Iterable[str]:
    """Yield the input error of a parity test that can detect or isolate nothing."""
    if sum(len(unit.directions) for unit in card.units) <= 3:
        yield "parity: the axes are as many as the test needs to fit: no failure can be detected"
    elif parity.after_detection == "exclude" and not any(_tested_without(card, k) for k in range(len(card.units))):
        yield (
            "parity: without a unit the others have no axis more than they need: none can be isolated; give a third "
            "unit, or skewed axes, or after_detection: report"
        )


def _tested_without(card: ImuSet, number: int) -> bool:
    """Return whether the array without IMU `number` has four axes or more that span three dimensions."""
    others = [unit.directions for at, unit in enumerate(card.units) if at != number]
    axes = np.vstack(others) if others else np.zeros((0, 3))
    return len(axes) > 3 and int(np.linalg.matrix_rank(axes, tol=SMALLEST)) == 3


def _kind_of(value: Any) -> str:
    several = "units" in value if isinstance(value, dict) else isinstance(value, ImuSet)
    return "several_units" if several else "one_unit"


Imu = Annotated[Annotated[ImuCard, Tag("one_unit")] | Annotated[ImuSet, Tag("several_units")], Discriminator(_kind_of)]
"""An IMU, or an IMU array with a list `units`."""


def _sizes(card: ImuSet, sensor: str) -> Floats:
    """Return the sigma of each IMU (n_unit,) whose inverse square weights its axes; ones for equal weights."""
    cards = [getattr(unit, sensor) for unit in card.units]
    if card.weights == "equal":
        return np.ones(len(cards))
    if card.weights == "bias":
        return np.array([math.hypot(rms(triad.bias_repeatability), triad.instability_sigma) for triad in cards])
    return np.array([rms(triad.random_walk) for triad in cards])


class Triad(NamedTuple):
    """Up to three sensing axes of an IMU, whose errors are drawn together.

    unit : Index of the IMU.
    n_axis : Number of axes, 1 to 3; the entries of missing axes are zero.
    frames : (3, 3, 3). By axis: its direction, then the two directions of its misalignments, body axes.
    gyro : (3, 3). Columns: fused triad (body axes) by an error of each gyro axis.
    accel : (3, 3). Columns: fused triad (body axes) by an error of each accelerometer axis.
    """

    unit: int
    n_axis: int
    frames: Floats
    gyro: Floats
    accel: Floats


def least_squares(directions: Floats, weights: Floats) -> Floats:
    """Return A = (H' W H)^-1 H' W, (3, n), with x = A y for readings y along sensing axes.

    directions : (n, 3). Unit vectors of the axes, rows of H.
    weights : (n,). Diagonal of W.
    """
    weighted = directions * weights[:, None]
    return np.asarray(np.linalg.solve(weighted.T @ directions, weighted.T))


def _frames(axes: Floats) -> Floats:
    """Return a right-handed frame (n, 3, 3) for each of the axes (n, 3).

    The frame of an axis of an orthogonal triad is the triad itself in cyclic order, so that its misalignments are
    towards the other two axes.
    """
    if len(axes) == 3 and np.allclose(axes @ axes.T, np.eye(3), atol=1e-12) and np.linalg.det(axes) > 0.0:
        return np.array([np.roll(axes, -k, axis=0) for k in range(3)])
    least = np.eye(3)[np.argmin(np.abs(axes), axis=1)]
    first = np.cross(axes, least)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([axes, first, np.cross(axes, first)], axis=1)


def triads_of(card: ImuSet) -> tuple[Triad, ...]:
    """Return the triads of an IMU array, IMU by IMU."""
    directions = [unit.directions for unit in card.units]
    count = [len(axes) for axes in directions]
    solved = []
    for sensor in ("gyro", "accel"):
        sizes = _sizes(card, sensor)
        sizes = sizes / sizes[0] if sizes.all() else np.ones(len(sizes))
        weights = np.repeat(sizes**-2.0, count)
        if card.selection == "prime":
            weights[count[0] :] = 0.0
        solved.append(least_squares(np.vstack(directions), weights))
    triads = []
    at = 0
    for number, axes in enumerate(directions):
        for first in range(0, len(axes), 3):
            members = axes[first : first + 3]
            n = len(members)
            frames = np.zeros((3, 3, 3))
            frames[:n] = _frames(members)
            gyro, accel = (np.pad(A[:, at : at + n], ((0, 0), (0, 3 - n))) for A in solved)
            triads.append(Triad(number, n, frames, gyro, accel))
            at += n
    return tuple(triads)


def keyed(label: str, unit: int) -> str:
    """Return the key of an error source of an IMU (index from 0); the first IMU has the keys of a single IMU."""
    return f"unit {unit + 1} {label}" if unit else label


def own_solutions(card: ImuSet) -> Floats:
    """Return the columns (n_triad, 3, 3) by which errors of the axes enter the solution of their own IMU alone."""
    columns = [np.zeros((3, 3)) for _ in triads_of(card)]
    for number, unit in enumerate(card.units):
        A = np.linalg.pinv(unit.directions)
        at = 0  # no solution with fewer than three axes: then it is not used
        for index, triad in enumerate(triads_of(card)):
            if triad.unit == number:
                columns[index][:, : triad.n_axis], at = A[:, at : at + triad.n_axis], at + triad.n_axis
    return np.array(columns)


def axis_weights(card: ImuSet) -> Floats:
    """Return the least-squares weights of the axes by triad, (2, n_triad): gyro, accelerometer.

    They are relative to the first IMU, and one for mid-value selection.
    """
    owners = [triad.unit for triad in triads_of(card)]
    if card.selection != "mean":
        return np.ones((2, len(owners)))
    sizes = [_sizes(card, sensor) for sensor in ("gyro", "accel")]
    return np.array([(sigma / sigma[0] if sigma.all() else np.ones(sigma.size))[owners] ** -2.0 for sigma in sizes])


def axis_counts(imu: ImuCard | ImuSet) -> tuple[int, ...]:
    """Return the number of sensing axes of each IMU."""
    return (3,) if isinstance(imu, ImuCard) else tuple(len(unit.directions) for unit in imu.units)


def mounted(imu: ImuCard | ImuSet) -> list[tuple[int, ImuCard]]:
    """Return index (from 0) and card of the IMU of every triad; a single IMU has one triad."""
    return [(0, imu)] if isinstance(imu, ImuCard) else [(triad.unit, imu.units[triad.unit]) for triad in triads_of(imu)]


def terms_of(imu: ImuCard | ImuSet) -> list[ErrorTerm]:
    """Return the true error parameters of an IMU, or of all IMUs of an array, triad by triad."""
    if isinstance(imu, ImuCard):
        return error_terms(imu)
    owners = mounted(imu)
    return [
        term._replace(
            name=keyed(term.name, unit),
            part=term.part + 3 * owners[:triad].count((unit, card)),
            triad=triad,
        )
        for triad, (unit, card) in enumerate(owners)
        for term in error_terms(card)
    ]


def _fused(imu: ImuSet, sensor: int, value: Callable[[Any], PerAxis]) -> PerAxis:
    """Return the sigma of the fused triad for an error that is independent between sensing axes.

    It is the root mean square over the body axes if the axes of every IMU are equal, otherwise by axis.

    value : Function that returns the sigma of a gyro or accelerometer card.
    """
    variance = np.zeros(3)
    alike = True
    for triad in triads_of(imu):
        A, card = (
            (triad.gyro, imu.units[triad.unit].gyro) if sensor == GYRO else (triad.accel, imu.units[triad.unit].accel)
        )
        variance += A**2 @ squares(value(card))
        alike &= not isinstance(value(card), tuple)
    if alike:
        return math.sqrt(float(variance.sum()) / 3.0)
    x, y, z = np.sqrt(variance).tolist()
    return x, y, z


def _fused_matrix(imu: ImuSet, sensor: int, own: str, across: str) -> tuple[float, float]:
    """Return the sigmas of the fused scale-factor and misalignment matrix: diagonal, off-diagonal.

    Each is the root mean square over the entries. The scale factor of a skewed axis contributes to both.
    """
    variance = np.zeros((3, 3))
    for triad in triads_of(imu):
        unit = imu.units[triad.unit]
        A, card = (triad.gyro, unit.gyro) if sensor == GYRO else (triad.accel, unit.accel)
        scale = rms(getattr(card, own)) ** 2
        skew = rms(getattr(card, across, 0.0)) ** 2 if across else 0.0
        of_axis = scale * triad.frames[:, 0] ** 2 + skew * (triad.frames[:, 1] ** 2 + triad.frames[:, 2] ** 2)
        variance += A**2 @ of_axis
    diagonal = float(np.trace(variance))
    return math.sqrt(diagonal / 3.0), math.sqrt((float(variance.sum()) - diagonal) / 6.0)


def _fused_card(imu: ImuSet, sensor: int) -> dict[str, Any]:
    cards = [unit.gyro if sensor == GYRO else unit.accel for unit in imu.units]
    names = ["random_walk", "rate_random_walk", "bias_repeatability", "quantisation"]
    fields: dict[str, Any] = {name: _fused(imu, sensor, attrgetter(name)) for name in names}
    fields["bias_instability"] = _fused(imu, sensor, lambda triad: triad.instability_axes(triad.instability_sigma))
    fields["scale_factor"], fields["misalignment"] = _fused_matrix(imu, sensor, "scale_factor", "misalignment")
    fields["scale_factor_drift"], _ = _fused_matrix(imu, sensor, "scale_factor_drift", "")
    if sensor == GYRO:
        fields["g_sensitivity"] = _fused(imu, sensor, attrgetter("g_sensitivity"))
    # driving noise sigma^2 / T of independent Gauss-Markov processes adds up and gives T of their sum
    drive = (
        sum(
            process.sigma**2 / process.time_constant * float(np.sum((t.gyro if sensor == GYRO else t.accel) ** 2))
            for t in triads_of(imu)
            for process in [cards[t.unit].instability]
        )
        / 3.0
    )
    fields["instability_time"] = rms(fields["bias_instability"]) ** 2 / drive if drive > 0.0 else 100.0
    return fields


def equivalent(imu: ImuCard | ImuSet) -> ImuCard:
    """Return the IMU equivalent to the fused triad of an array; a single IMU is returned as it is.

    Sigmas are root mean squares over the three axes, or by axis if the axes of an IMU differ. Those of scale factor and
    misalignment are always root mean squares. Nonlinearity, bandwidth and warming are omitted, because their sum over
    several IMUs is not an error of the same kind.
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
