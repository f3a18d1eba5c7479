"""IMU arrays: position and sensing axes of each IMU, and their least-squares combination.

Every sensing axis h (unit vector, body axes) gives y = h . x + e of the same rate or specific force x. The fused triad
is x^ = A y with A = (H' W H)^-1 H' W, so an error e of an axis enters as its column of A.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Discriminator, Field, Tag

from lvnav_trade.imu.error_model import ImuCard, error_terms
from lvnav_trade.imu.redundancy import ParityCard
from lvnav_trade.quantities import units
from lvnav_trade.quantities.conditions import Instant
from lvnav_trade.quantities.per_axis import rms
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
        lengths = np.linalg.norm(axes, axis=1)
        axes = axes / lengths[:, None]
        if not any(self.orientation):
            return np.asarray(axes)
        sr, sp, sy = np.sin(self.orientation)  # roll, pitch, yaw
        cr, cp, cy = np.cos(self.orientation)
        # axes of the IMU in body axes
        x_axis = (cp * cy, cp * sy, -sp)
        y_axis = (sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp)
        z_axis = (cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp)
        body_to_imu = np.array([x_axis, y_axis, z_axis])
        return np.asarray(axes @ body_to_imu)


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
        yield from _redundancy_faults(self)
        for number, unit in enumerate(self.units[1:], start=1):
            if unit.rate != self.rate:
                yield (
                    f"units.{number}.rate: {unit.rate:g} Hz, the first unit has {self.rate:g} Hz; increments are fused "
                    "sample by sample"
                )
        axes = np.vstack([unit.directions for unit in self.units])
        singular = np.linalg.svd(axes, compute_uv=False)
        rank = int(np.sum(singular > SMALLEST * singular[0]))
        if rank < 3:
            yield f"units: the sensing axes span {rank} of 3 dimensions: a rate across them is not measured"
        for label in ("gyro", "accel"):
            sizes = _sizes(self, label)
            if sizes.any() and not sizes.all():
                number = int(np.argmin(sizes))
                yield f"weights: {self.weights}: units.{number}.{label} has none; weight them equally"

    @property
    def rate(self) -> float:
        """Sample rate (Hz), common to all IMUs."""
        return self.units[0].rate

    @property
    def process_rate(self) -> float:
        """Rate (Hz) of the steps of time-varying errors: the highest of the IMUs."""
        return max(unit.process_rate for unit in self.units)


def _redundancy_faults(card: ImuSet) -> Iterable[str]:
    """Yield the input errors of mid-value selection, of a hand-over and of the parity test."""
    spans = [int(np.linalg.matrix_rank(unit.directions, tol=SMALLEST)) for unit in card.units]
    if card.selection == "mid_value":
        yield from _mid_value_faults(card, spans)
    yield from _hand_over_faults(card, spans)
    if card.parity is not None:
        yield from _parity_faults(card, card.parity)
    if card.parity is not None and card.parity.window * card.rate < 1.0:
        sample = 1.0 / card.rate
        yield f"parity.window: {card.parity.window:g} s is less than a sample of {sample:g} s"
    if card.parity is None and card.selection != "mid_value":
        return
    for number, unit in enumerate(card.units):
        sensor_triads = (("gyro", unit.gyro), ("accel", unit.accel))
        for name, triad in sensor_triads:
            if rms(triad.random_walk) <= 0.0:
                yield f"units.{number}.{name}.random_walk: is zero; thresholds of redundant units need it, give it"


def _hand_over_faults(card: ImuSet, spans: Sequence[int]) -> Iterable[str]:
    """Yield the input errors of a prime IMU and its hand-over; spans: dimensions that each IMU senses along."""
    has_parity_hand_over = card.parity is not None and card.parity.after_detection == "hand_over"
    if card.selection != "prime":
        if has_parity_hand_over or card.hand_over is not None:
            field = "parity.after_detection" if has_parity_hand_over else "hand_over"
            yield f"{field}: a hand-over from a prime unit to the next one needs selection: prime"
        return
    if len(card.units) < 2:
        yield "selection: prime: there is no unit to hand over to; give two or more"
    if min(spans, default=3) < 3:
        number = int(np.argmin(spans))
        yield f"selection: prime: units.{number} senses along {min(spans)} of 3 dimensions"
    if card.weights != "random_walk":
        yield f"weights: {card.weights}: one unit is used at a time, so there are no weights"
    if (card.hand_over is None) == (card.parity is None):
        yield "selection: prime: a hand-over is at a time or by parity; state either hand_over or parity"


def excludes_units(card: ImuCard | ImuSet) -> bool:
    """Whether a failed IMU is excluded from the fused increments: by parity, mid-value selection, or a hand-over."""
    if isinstance(card, ImuCard):
        return False
    excludes_by_parity = card.parity is not None and card.parity.after_detection != "report"
    return card.selection == "mid_value" or excludes_by_parity or card.hand_over is not None


def _parity_faults(card: ImuSet, parity: ParityCard) -> Iterable[str]:
    """Yield the input error of a parity test that can detect or isolate nothing."""
    if sum(len(unit.directions) for unit in card.units) <= 3:
        yield "parity: the axes are as many as the test needs to fit: no failure can be detected"
    elif parity.after_detection == "exclude" and not any(_is_testable_without(card, k) for k in range(len(card.units))):
        yield (
            "parity: without a unit the others have no axis more than they need: none can be isolated; give a third "
            "unit, or skewed axes, or after_detection: report"
        )


def _mid_value_faults(card: ImuSet, spans: Sequence[int]) -> Iterable[str]:
    """Yield the input errors of mid-value selection; spans: dimensions that each IMU senses along."""
    if min(spans, default=3) < 3:
        number = int(np.argmin(spans))
        yield f"selection: mid_value: units.{number} senses along {min(spans)} of 3 dimensions"
    if card.weights != "random_walk":
        yield f"weights: {card.weights}: mid-value selection has no weights"
    if len(card.units) < 3:
        yield f"selection: mid_value: the middle of {len(card.units)} is their mean; it takes three units or more"
    triads = [triad for unit in card.units for triad in (unit.gyro, unit.accel)]
    if any(triad.quantisation > 0.0 for triad in triads):
        yield "selection: mid_value: the rounding residual of a unit is lost when another unit is selected"


def _is_testable_without(card: ImuSet, number: int) -> bool:
    """Return whether the array without IMU `number` has four axes or more that span three dimensions."""
    remaining = [unit.directions for index, unit in enumerate(card.units) if index != number]
    if not remaining:
        return False
    axes = np.vstack(remaining)
    if len(axes) <= 3:
        return False
    rank = int(np.linalg.matrix_rank(axes, tol=SMALLEST))
    return rank == 3


def _card_tag(value: Any) -> str:
    if isinstance(value, dict):
        is_array = "units" in value
    else:
        is_array = isinstance(value, ImuSet)
    return "several_units" if is_array else "one_unit"


Imu = Annotated[Annotated[ImuCard, Tag("one_unit")] | Annotated[ImuSet, Tag("several_units")], Discriminator(_card_tag)]
"""An IMU, or an IMU array with a list `units`."""


def _sizes(card: ImuSet, sensor: str) -> Floats:
    """Return the sigma of each IMU (n_unit,) whose inverse square weights its axes; 1 for equal weights."""
    cards = [getattr(unit, sensor) for unit in card.units]
    if card.weights == "equal":
        return np.ones(len(cards))
    if card.weights == "bias":
        biases = []
        for triad in cards:
            repeatability = rms(triad.bias_repeatability)
            biases.append(math.hypot(repeatability, triad.instability_sigma))
        return np.array(biases)
    random_walks = [rms(triad.random_walk) for triad in cards]
    return np.array(random_walks)


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

    Parameters
    ----------
    directions : (n, 3)
        Unit vectors of the axes, rows of H.
    weights : (n,)
        Diagonal of W.
    """
    weighted_directions = directions * weights[:, None]
    normal_matrix = weighted_directions.T @ directions
    return np.asarray(np.linalg.solve(normal_matrix, weighted_directions.T))


def _frames(axes: Floats) -> Floats:
    """Return a right-handed frame (n, 3, 3) for each of the axes (n, 3).

    The frame of an axis of an orthogonal triad is the triad itself in cyclic order, so that its misalignments are
    towards the other two axes.
    """
    is_orthogonal = len(axes) == 3 and np.allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    if is_orthogonal and np.linalg.det(axes) > 0.0:
        cyclic = [np.roll(axes, -k, axis=0) for k in range(3)]
        return np.array(cyclic)
    # second direction: across the axis and the body axis that is farthest from it
    closeness = np.abs(axes)
    farthest_number = np.argmin(closeness, axis=1)
    farthest_axis = np.eye(3)[farthest_number]
    second = np.cross(axes, farthest_axis)
    length = np.linalg.norm(second, axis=1)
    second /= length[:, None]
    third = np.cross(axes, second)
    return np.stack([axes, second, third], axis=1)


def list_triads(card: ImuSet) -> tuple[Triad, ...]:
    """Return the triads of an IMU array, IMU by IMU."""
    directions = [unit.directions for unit in card.units]
    gyro_columns = _fused_columns(card, "gyro", directions)
    accel_columns = _fused_columns(card, "accel", directions)
    triads = []
    column = 0
    for number, axes in enumerate(directions):
        for first in range(0, len(axes), 3):
            members = axes[first : first + 3]
            n = len(members)
            end = column + n
            frames = np.zeros((3, 3, 3))
            frames[:n] = _frames(members)
            gyro = np.zeros((3, 3))
            gyro[:, :n] = gyro_columns[:, column:end]
            accel = np.zeros((3, 3))
            accel[:, :n] = accel_columns[:, column:end]
            triad = Triad(unit=number, n_axis=n, frames=frames, gyro=gyro, accel=accel)
            triads.append(triad)
            column = end
    return tuple(triads)


def source_key(label: str, unit: int) -> str:
    """Return the key of an error source of an IMU (index from 0); the first IMU has the keys of a single IMU."""
    return f"unit {unit + 1} {label}" if unit else label


def _fused_columns(card: ImuSet, sensor: str, directions: Sequence[Floats]) -> Floats:
    """Return A (3, n_axis) of all sensing axes of an array; a prime IMU has all the weight."""
    n_axis = [len(axes) for axes in directions]
    sizes = _sizes(card, sensor)
    relative = sizes / sizes[0] if sizes.all() else np.ones(len(sizes))
    imu_weights = relative**-2.0
    weights = np.repeat(imu_weights, n_axis)
    if card.selection == "prime":
        n_prime = n_axis[0]
        weights[n_prime:] = 0.0
    axes = np.vstack(directions)
    return least_squares(axes, weights)


def single_imu_columns(card: ImuSet) -> Floats:
    """Return the columns (n_triad, 3, 3) by which errors of the axes enter the solution of their own IMU alone.

    An IMU with fewer than three axes has no solution; its columns are not used.
    """
    triads = list_triads(card)
    columns = np.zeros((len(triads), 3, 3))
    for number, unit in enumerate(card.units):
        A = np.linalg.pinv(unit.directions)
        column = 0
        for index, triad in enumerate(triads):
            if triad.unit == number:
                n = triad.n_axis
                columns[index, :, :n] = A[:, column : column + n]
                column += n
    return columns


def axis_weights(card: ImuSet) -> Floats:
    """Return the least-squares weights of the axes by triad, (2, n_triad): gyro, accelerometer.

    They are relative to the first IMU, and one for mid-value selection.
    """
    owners = [triad.unit for triad in list_triads(card)]
    weights = np.ones((2, len(owners)))
    if card.selection != "mean":
        return weights
    for row, sensor in enumerate(("gyro", "accel")):
        sigma = _sizes(card, sensor)
        if sigma.all():
            relative = sigma / sigma[0]
            weights[row] = relative[owners] ** -2.0
    return weights


def axis_counts(imu: ImuCard | ImuSet) -> tuple[int, ...]:
    """Return the number of sensing axes of each IMU."""
    if isinstance(imu, ImuCard):
        return (3,)
    return tuple(len(unit.directions) for unit in imu.units)


def triad_imus(imu: ImuCard | ImuSet) -> list[tuple[int, ImuCard]]:
    """Return index (from 0) and card of the IMU of every triad; a single IMU has one triad."""
    if isinstance(imu, ImuCard):
        return [(0, imu)]
    return [(triad.unit, imu.units[triad.unit]) for triad in list_triads(imu)]


def imu_error_terms(imu: ImuCard | ImuSet) -> list[ErrorTerm]:
    """Return the true error parameters of an IMU, or of all IMUs of an array, triad by triad."""
    if isinstance(imu, ImuCard):
        return error_terms(imu)
    owners = triad_imus(imu)
    terms = []
    for triad, (unit, card) in enumerate(owners):
        # an IMU with several triads has three parts of an error in each
        first_part = 3 * owners[:triad].count((unit, card))
        for term in error_terms(card):
            name = source_key(term.name, unit)
            number = term.term_index + first_part
            terms.append(term._replace(name=name, term_index=number, triad=triad))
    return terms
