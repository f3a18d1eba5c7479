"""Numbers of a vehicle under control: movement of its nozzle, and ticks within the envelope of its motion."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lvnav_trade.api.measures import FRAMES, Metric, MetricValue, SingleValue, Tables, pick

_AXES, _WHOLE = ("pitch", "yaw"), "flight"


@dataclass(frozen=True)
class NozzleMovement(Metric):
    """By how many percent less a nozzle moves with the filtered than with the raw rate, in a burn or a flight.

    axis : pitch or yaw.
    burn : Such as "burn 1", or "flight".
    """

    axis: str = ""
    burn: str = _WHOLE

    def single(self, tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> SingleValue:
        """Return the reduction by pairs of runs, with its interval as the remark."""
        for row in pick(
            FRAMES["nozzle_travel"](tables), case=tables.labels[case], axis=self.axis, burn=self.burn
        ).itertuples():
            interval = f"{row.low_percent:.1f} to {row.high_percent:.1f} %"
            rows = pick(tables.nozzle_travel, case=case, axis=self.axis, burn=self.burn)
            moved = rows.pivot(index="run_number", columns="controller_rate", values="travel_rad")
            each = 100.0 * (1.0 - moved.filtered / moved.raw).to_numpy()
            remark = f"{row.runs} paired runs, 95 %: {interval}"
            return SingleValue(float(row.reduction_percent), remark, np.sort(each))
        return SingleValue(np.nan, "no vehicle under control, no such burn, or fewer than two runs")

    def value(self, tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the reduction, a number of the runs."""
        found = self.single(tables, case, stated, unit)
        return MetricValue(monte_carlo=found.value, remark=found.remark)

    def label(self, stated: Mapping[str, Any]) -> str:
        """Return what moves, and in which burn."""
        return f"nozzle_movement_{self.axis}, less with the filtered rate, {self.burn}"


@dataclass(frozen=True)
class InsideEnvelope(Metric):
    """The part of a vehicle's ticks whose motion is within the envelope that is assumed of it.

    what : turning_inside (angular acceleration) or jerk_inside (lateral jerk).
    axis : pitch or yaw.
    part : Part of the flight; all of it if empty.
    """

    what: str = ""
    axis: str = ""
    part: str = ""

    def value(self, tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> MetricValue:
        """Return the part (%) of the ticks of all runs."""
        value, remark = inside_envelope(tables, case, self.what, self.axis, self.part or None)
        return MetricValue(true=value, remark=remark)

    def label(self, stated: Mapping[str, Any]) -> str:
        """Return the envelope, and in which part of the flight."""
        return f"{self.what}_{self.axis}, part of ticks, {self.part or _WHOLE}"


def inside_envelope(tables: Tables, case: str, what: str, axis: str, part: str | None) -> tuple[float, str]:
    """Return the part (%) of ticks of all runs with the motion in its envelope, and what is to be said of it: that of
    the rate that it is worse with, of the raw and the filtered one. NaN where there is none.
    """
    rows = pick(tables.motion_statistics, case=case, axis=axis)
    rows = rows[rows.controller_rate.isin(("raw", "filtered"))]
    rows = rows if part is None else pick(rows, phase=part)
    if rows.empty or not rows.tick_count.sum():
        return np.nan, "no vehicle under control"
    column = {"turning_inside": "angular_acceleration_inside_ratio", "jerk_inside": "jerk_inside_ratio"}[what]
    inside = rows.tick_count * rows[column].fillna(1.0)
    shares = inside.groupby(rows.controller_rate).sum() / rows.tick_count.groupby(rows.controller_rate).sum()
    return 100.0 * float(shares.min()), f"fed with the {shares.idxmin()} rate"


def _nozzle(axis: str, part: str) -> NozzleMovement:
    name, meaning = f"nozzle_movement_{axis}{part}", "reduction of the nozzle's movement by the filtered rate"
    return NozzleMovement(name, "%", meaning, axis, part.lstrip("_").replace("_", " ") or _WHOLE)


def _inside(what: str, axis: str, part: str) -> InsideEnvelope:
    name, meaning = f"{what}_{axis}{part}", "part of ticks with the motion within the envelope that is assumed of it"
    return InsideEnvelope(name, "%", meaning, what, axis, part.lstrip("_"))


METRICS: tuple[Metric, ...] = (
    *(_nozzle(axis, part) for axis in _AXES for part in ("", "_burn_1", "_burn_2", "_burn_3")),
    *(
        _inside(what, axis, part)
        for what in ("turning_inside", "jerk_inside")
        for axis in _AXES
        for part in ("", "_burn", "_coast", "_change")
    ),
)
