"""A recorded log of a vehicle: increments of its inertial unit and solutions of its receiver, and the card of both.

The unit's file is that of `imu_log`, its rows perhaps uneven. The receiver's has the columns `t_s`, `latitude_deg`,
`longitude_deg`, `height_m` above the ellipsoid (WGS-84), `v_north_m_s`, `v_east_m_s`, `v_down_m_s`, and perhaps
one-sigma `sigma_north_m`, `sigma_east_m`, `sigma_down_m`, `sigma_v_north_m_s`, `sigma_v_east_m_s`, `sigma_v_down_m_s`.
A file of ranges has `t_s`, `satellite` (as in RINEX, such as G05), `pseudorange_m`, `range_rate_m_s`, a row each.
"""

import os
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.errors import InputError
from lvnav_trade.records import Floats
from lvnav_trade.units import Angle, Card, Duration, Epoch, NamedCard, Pause
from lvnav_trade.world.user_file.imu_log import read_log, time_column
from lvnav_trade.world.user_file.rows import column_names, read_columns, read_texts, refuse_first, refuse_unordered

Axis = Literal["x", "-x", "y", "-y", "z", "-z"]
_SOLUTION = ("latitude_deg", "longitude_deg", "height_m", "v_north_m_s", "v_east_m_s", "v_down_m_s")
_SIGMAS = tuple(f"sigma_{part}" for part in ("north_m", "east_m", "down_m", "v_north_m_s", "v_east_m_s", "v_down_m_s"))
_RANGES = ("pseudorange_m", "range_rate_m_s")
_GAP = 0.1  # s without rows of the unit that increments may bridge


class UnitFile(Card):
    """The file of the inertial unit."""

    file: str
    delimiter: str = Field(",", min_length=1, max_length=1)
    axes: tuple[Axis, Axis, Axis] = Field(
        ("x", "y", "z"), description="axis of the log along each body axis (x forward, y right, z down)"
    )
    delay: Duration = Field(0.0, description="by which its time tags are late against those of the receiver")

    def _faults(self) -> Iterator[str]:
        if round(float(np.linalg.det(turning(self.axes)))) != 1:
            yield f"axes: {', '.join(self.axes)} is no right-handed triad of three axes"


class ReceiverFile(Card):
    """The file of the receiver's solutions."""

    file: str
    delimiter: str = Field(",", min_length=1, max_length=1)
    noise: Literal["filter", "log"] = Field(
        "filter", description="what the filter assumes of a solution: its card, or the sigmas of the file"
    )


class RangesFile(Card):
    """The file of pseudoranges and range rates, for filters that take them."""

    file: str
    delimiter: str = Field(",", min_length=1, max_length=1)


class NavigationLog(NamedCard):
    """A recorded log, and how it is aligned."""

    epoch: Epoch = Field(description="UTC when the columns of time are zero")
    imu: UnitFile
    gnss: ReceiverFile
    ranges: RangesFile | None = None
    still: tuple[Duration, Duration] = Field(description="where the vehicle rests, from the receiver's first row")
    heading: Angle | None = Field(
        None, description="of the body's x axis, or of its z axis where x stands upright; none: from the motion"
    )
    heading_within: Pause = Field(15.0, description="after the rest: the motion that shows the heading")
    gyro_bias: Literal["still", "none"] = Field("still", description="whether the mean rate at rest is taken off")

    def _faults(self) -> Iterator[str]:
        if not 0.0 <= self.still[0] < self.still[1]:
            yield "still: should begin at the first row or later, and end after it begins"


class Ranges(NamedTuple):
    """Rows of ranges: t (n,) s from the receiver's first solution; satellites (n,) names; values (n, 2) pseudorange (m)
    and range rate (m/s), as measured.
    """

    t: Floats
    satellites: tuple[str, ...]
    values: Floats


class Recording(NamedTuple):
    """Rows of a log, times (s) from the receiver's first row.

    t (n,) s bounds of the unit's intervals; turned, pushed (n, 3) sums of its increments up to there, rad and m/s, body
    axes; t_fix (m,) s; place (m, 3) latitude, longitude (rad) and height (m); moving (m, 3) m/s north, east, down;
    sigma (m, 6) of both, NaN without columns; epoch: UTC of time zero; ranges: None without a file of them.
    """

    t: Floats
    turned: Floats
    pushed: Floats
    t_fix: Floats
    place: Floats
    moving: Floats
    sigma: Floats
    epoch: str
    ranges: Ranges | None = None


def turning(axes: tuple[str, ...]) -> Floats:
    """Return the matrix (3, 3) from the axes of a log to body axes."""
    found = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        found[row, "xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return found


def read_recording(card: NavigationLog, folder: Path) -> Recording:
    """Return the rows of a log whose files are named from a folder; InputError names file, row and fault."""
    unit_file, fix_file = (os.fspath(folder / part.file) for part in (card.imu, card.gnss))
    titles = column_names(fix_file, card.gnss.delimiter)
    time, scale = time_column(fix_file, titles)
    known = all(name in titles for name in _SIGMAS)
    if card.gnss.noise == "log" and not known:
        raise InputError(f"{fix_file}: gnss.noise: log needs the columns {', '.join(_SIGMAS)}")
    names = [time, *_SOLUTION, *(_SIGMAS if known else ())]
    table, places = read_columns(fix_file, names, card.gnss.delimiter, 3, "a log")
    t_fix = table[:, 0] * scale
    refuse_unordered(t_fix, fix_file, places)
    table[:, 1:3] = np.radians(table[:, 1:3])
    refuse_first(np.abs(table[:, 1]) > 0.5 * np.pi, fix_file, places, lambda k: "latitude_deg is beyond 90")
    log = read_log(unit_file, card.imu.delimiter, _GAP)
    t = np.concatenate([log.t[:1] - log.dt, log.t]) - card.imu.delay
    if t[-1] <= t_fix[0] + card.still[1] or t[0] > t_fix[0] + card.still[0] + 1e-6:
        spans = f"{t[0]:.9g} to {t[-1]:.9g} s, and {fix_file} from {t_fix[0]:.9g} s on"
        raise InputError(f"{unit_file}: its rows do not span the rest: it has {spans}")
    step, turn = np.diff(t)[:, None], turning(card.imu.axes).T
    turned, pushed = (np.cumsum(np.vstack([np.zeros(3), means * step]), axis=0) for means in (log.gyro, log.accel))
    return Recording(
        t - t_fix[0], turned @ turn, pushed @ turn,
        t_fix - t_fix[0], table[:, 1:4], table[:, 4:7],
        table[:, 7:] if known else np.full((len(table), 6), np.nan), later(card.epoch, float(t_fix[0])),
        _ranges(card.ranges, folder, float(t_fix[0])),
    )  # fmt: skip


def _ranges(card: RangesFile | None, folder: Path, zero: float) -> Ranges | None:
    if card is None:
        return None
    file = os.fspath(folder / card.file)
    time, scale = time_column(file, column_names(file, card.delimiter))
    table, _ = read_columns(file, [time, *_RANGES], card.delimiter, 4, "a log")
    names = read_texts(file, "satellite", card.delimiter)
    return Ranges(table[:, 0] * scale - zero, tuple(names), table[:, 1:])


def later(epoch: str, seconds: float) -> str:
    """Return the time so many seconds after an epoch."""
    return (datetime.fromisoformat(epoch) + timedelta(seconds=seconds)).isoformat()
