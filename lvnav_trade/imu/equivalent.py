"""IMU equivalent to the fused triad of an IMU array: its sigmas from those of the sensing axes."""

import math
from collections.abc import Callable
from operator import attrgetter
from typing import Any

import numpy as np

from lvnav_trade.imu.array import ImuSet, Triad, list_triads
from lvnav_trade.imu.error_model import AccelCard, GyroCard, ImuCard
from lvnav_trade.kernels.transition import ACCEL, GYRO
from lvnav_trade.quantities.per_axis import PerAxis, rms, squares
from lvnav_trade.quantities.records import Floats


def _fused_axes(imu: ImuSet, sensor: int) -> list[tuple[Triad, Floats, GyroCard | AccelCard]]:
    """Return every triad with its columns A (3, 3) of the fused triad, and its gyro or accelerometer card."""
    axes: list[tuple[Triad, Floats, GyroCard | AccelCard]] = []
    for triad in list_triads(imu):
        unit = imu.units[triad.unit]
        if sensor == GYRO:
            axes.append((triad, triad.gyro, unit.gyro))
        else:
            axes.append((triad, triad.accel, unit.accel))
    return axes


def _fused_sigma(imu: ImuSet, sensor: int, value: Callable[[Any], PerAxis]) -> PerAxis:
    """Return the sigma of the fused triad for an error that is independent between sensing axes.

    It is the root mean square over the body axes if the axes of every IMU are equal, otherwise by axis.

    Parameters
    ----------
    imu : ImuSet
    sensor : int
        GYRO or ACCEL.
    value : callable
        Function that returns the sigma of a gyro or accelerometer card.
    """
    variance = np.zeros(3)
    has_equal_axes = True
    for _, A, card in _fused_axes(imu, sensor):
        sigma = value(card)
        variance += A**2 @ squares(sigma)
        has_equal_axes &= not isinstance(sigma, tuple)
    if has_equal_axes:
        mean_variance = float(variance.sum()) / 3.0
        return math.sqrt(mean_variance)
    x, y, z = np.sqrt(variance).tolist()
    return x, y, z


def _fused_matrix(imu: ImuSet, sensor: int, scale_field: str, skew_field: str = "") -> tuple[float, float]:
    """Return the sigmas of the fused scale-factor and misalignment matrix: diagonal, off-diagonal.

    Each is the root mean square over the entries. The scale factor of a skewed axis contributes to both.

    Parameters
    ----------
    imu : ImuSet
    sensor : int
        GYRO or ACCEL.
    scale_field, skew_field : str
        Fields of the card with the sigmas of scale factor and misalignment; an empty name means no misalignment.
    """
    variance = np.zeros((3, 3))
    for triad, A, card in _fused_axes(imu, sensor):
        scale_sigma = getattr(card, scale_field)
        scale = rms(scale_sigma) ** 2
        skew = rms(getattr(card, skew_field)) ** 2 if skew_field else 0.0
        squares_of_frames = triad.frames**2
        axis = squares_of_frames[:, 0]
        skew_plane = squares_of_frames[:, 1] + squares_of_frames[:, 2]
        axis_variance = scale * axis + skew * skew_plane
        variance += A**2 @ axis_variance
    diagonal = float(np.trace(variance))
    off_diagonal = float(variance.sum()) - diagonal
    scale_factor = math.sqrt(diagonal / 3.0)
    misalignment = math.sqrt(off_diagonal / 6.0)
    return scale_factor, misalignment


def _instability_drive(imu: ImuSet, sensor: int) -> float:
    """Return the driving noise sigma^2 / T of the fused bias instability, mean over the axes.

    Driving noises of independent Gauss-Markov processes add up; with the total sigma they give T of the sum.
    """
    total = 0.0
    for _, A, card in _fused_axes(imu, sensor):
        process = card.instability
        drive = process.sigma**2 / process.time_constant
        total += drive * float(np.sum(A**2))
    return total / 3.0


def _fused_fields(imu: ImuSet, sensor: int) -> dict[str, Any]:
    """Return the fields of the gyro or accelerometer card of the equivalent IMU."""
    fields: dict[str, Any] = {}
    for name in ("random_walk", "rate_random_walk", "bias_repeatability", "quantisation"):
        fields[name] = _fused_sigma(imu, sensor, attrgetter(name))
    fields["bias_instability"] = _fused_sigma(
        imu, sensor, lambda triad: triad.instability_axes(triad.instability_sigma)
    )
    scale_factor, misalignment = _fused_matrix(imu, sensor, "scale_factor", "misalignment")
    scale_factor_drift, _ = _fused_matrix(imu, sensor, "scale_factor_drift")
    fields["scale_factor"] = scale_factor
    fields["misalignment"] = misalignment
    fields["scale_factor_drift"] = scale_factor_drift
    if sensor == GYRO:
        fields["g_sensitivity"] = _fused_sigma(imu, sensor, attrgetter("g_sensitivity"))
    drive = _instability_drive(imu, sensor)
    fields["instability_time"] = 100.0
    if drive > 0.0:
        variance = rms(fields["bias_instability"]) ** 2
        fields["instability_time"] = variance / drive
    return fields


def equivalent(imu: ImuCard | ImuSet) -> ImuCard:
    """Return the IMU equivalent to the fused triad of an array; a single IMU is returned unchanged.

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
        gyro=GyroCard.model_construct(**_fused_fields(imu, GYRO)),
        accel=AccelCard.model_construct(**_fused_fields(imu, ACCEL)),
    )
