"""Nozzle movement with raw and filtered rate, envelopes of angular acceleration and jerk; behind decision 0020.

Run as ``python docs/design/nozzle_movement.py``: prints tables and draws figures beside the decision, in some minutes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.card_lookup import tool_folder
from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.quantities.shared_cards import steady_ratio
from lvnav_trade.report.figures.style import PALETTE, line_of
from lvnav_trade.results.evaluation.motion_estimates import reduction
from lvnav_trade.simulation.preparation.vehicle_model import burns as burns_of
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.control_cards import ControllerCard, FeedbackCard, RotationCard, WindCard
from lvnav_trade.trajectory.guided.autopilot import (
    INSIDE_JERK,
    INSIDE_TURNING,
    JERK,
    JERK_BOUND,
    JERK_RATIO,
    MOVED,
    SQUARE_ERROR,
    TICKS,
    TURNING,
    TURNING_BOUND,
    TURNING_RATIO,
)
from lvnav_trade.trajectory.guided.course import ascend, stage_event_times
from lvnav_trade.trajectory.guided.missions import Launch, Missions, fly_missions, prepare_launch, scale_rate_gain

RUNS = 20
FACTORS = np.array([0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0])
READINGS = ("published", "datasheet")
AXES = ("pitch", "yaw")
Floats = NDArray[np.float64]
FOLDER = Path(__file__).resolve().parents[1] / "decisions"


def card(kind: Any, name: str, **over: Any) -> Any:
    """Return a card that comes with the tool, with fields laid over."""
    plain = tree.plain_data(tree.read_mapping(tool_folder("configs") / f"{name}.yaml"))
    if isinstance(plain.get("vehicle"), str):
        plain["vehicle"] = tree.plain_data(tree.read_mapping(tool_folder("configs") / f"{plain['vehicle']}.yaml"))
    return kind.model_validate({**plain, **over})


def launch(**over: Any) -> Launch:
    """Return the launch of the three-motor vehicle from Churchill, with fields of its ascent laid over."""
    return prepare_launch(
        ascend(card(VehicleAscent, "trajectories/churchill_sso", **over)),
        card(RotationCard, "rotation/three_motor"),
        card(ControllerCard, "controllers/three_motor"),
        card(WindCard, "wind/moderate"),
        card(ImuCard, "imu/kvh1750_003"),
    )


def fly(flown: Launch, rate: str, noise: str, runs: int = RUNS, every: int = 200) -> Missions:
    """Return missions with a rate and a reading of the gyro's noise."""
    return fly_missions(flown, FeedbackCard(rate=rate, noise=noise), runs, record_interval=every)  # type: ignore[arg-type]


def main() -> None:
    """Print the tables and draw the figures."""
    improvements()
    churchill = launch()
    events = stage_event_times(churchill.ascent.trajectory)
    burns = np.array(burns_of(churchill.ascent.trajectory))
    print(f"changes of phase at {', '.join(f'{t:.1f}' for t in events)} s")
    for noise in READINGS:
        missions = {rate: fly(churchill, rate, noise) for rate in ("raw", "filtered", "true")}
        totals(noise, missions, burns)
        moved = {f"{rate} rate": missions[rate].history[..., MOVED] for rate in ("raw", "filtered")}
        nozzle_movement(missions["raw"].t, moved, burns).savefig(FOLDER / f"0020-nozzle-movement-{noise}.png", dpi=110)
    sweep(churchill)
    envelope(churchill, burns, "6 s kick, as the card")
    envelope(launch(kick_duration="12 s"), burns, "12 s kick", figure=False)


def improvement(envelope: float, noise: float, rate: float, bias: float = 0.0) -> float:
    """Return by what part the steady filter's sigma is below that of the raw measurement, which is charged a bias.

    envelope: standard deviation of the derivative (rad/s^2 or m/s^3); noise and bias of a measurement (rad/s or m/s^2);
    rate of measurements, Hz.
    """
    steady = steady_ratio((envelope / rate) ** 2, noise**2)
    return 1.0 - math.sqrt(steady) * noise / math.hypot(noise, bias)


def improvements() -> None:
    """Print table 2 of the publication by its closed form."""
    unit = card(ImuCard, "imu/kvh1750_003")
    print("% below the raw sigma: envelopes 0.002, 0.02 rad/s^2; 10, 15 m/s^3 with raw bias charged, and without")
    for noise, factor in (("published", unit.rate), ("datasheet", math.sqrt(unit.rate))):
        rates = [improvement(e, factor * unit.gyro.random_walk, unit.rate) for e in (0.002, 0.02)]
        forces = [
            improvement(e, factor * unit.accel.random_walk, unit.rate, bias)
            for bias, e in product((unit.accel.bias_repeatability, 0.0), (10.0, 15.0))
        ]
        print(f"  {noise:10s}", *(f"{100.0 * value:6.1f}" for value in rates + forces))


def totals(noise: str, missions: dict[str, Missions], burns: np.ndarray) -> None:
    """Print total movements by what feeds the controller, and reductions, whole and by burn."""
    print(f"noise as {noise}: mean total nozzle movement (deg) and RMS attitude error in burns (deg), pitch and yaw")
    for rate, flown in missions.items():
        square = flown.sums[:, :, 0, SQUARE_ERROR].sum(axis=0) / flown.sums[:, :, 0, TICKS].sum(axis=0)
        total = np.degrees(flown.movement.mean(axis=0))
        print(f"  {rate:9s} {total[0]:7.1f} {total[1]:7.1f}   {np.degrees(np.sqrt(square)).round(3)}")
    found = reduction(missions["raw"].movement, missions["filtered"].movement)
    print("  filtered against raw, % less:", *(_interval(found, axis) for axis in range(2)))
    for number, (begin, end) in enumerate(burns, start=1):
        spans = []
        for rate in ("raw", "filtered"):
            at = np.searchsorted(missions[rate].t, [begin, end + 1.0])
            rows = missions[rate].history[..., MOVED][:, np.minimum(at, missions[rate].t.size - 1)]
            spans.append(rows[:, 1] - rows[:, 0])
        found = reduction(*spans)
        print(f"  burn {number}:", *(_interval(found, axis) for axis in range(2)))


def _interval(found: Any, axis: int) -> str:
    return f"{100 * found.part[axis]:.1f} ({100 * found.low[axis]:.1f} to {100 * found.high[axis]:.1f})"


def sweep(churchill: Launch) -> None:
    """Print and draw totals and reductions over the rate gain."""
    moved: dict[str, list[np.ndarray]] = {}
    parts: dict[str, list[np.ndarray]] = {}
    for noise in READINGS:
        for factor in FACTORS:
            flown = scale_rate_gain(churchill, float(factor))
            pair = {rate: fly(flown, rate, noise, runs=8).movement for rate in ("raw", "filtered")}
            for rate, total in pair.items():
                moved.setdefault(f"{rate}, {noise}", []).append(total.mean(axis=0))
            found = reduction(pair["raw"], pair["filtered"])
            parts.setdefault(noise, []).append(found.part)
            print(f"rate gain x {factor:4.2f}, {noise:9s}:", *(_interval(found, axis) for axis in range(2)))
    totals_ = {name: np.array(rows) for name, rows in moved.items()}
    figure = gain_sweep(FACTORS, totals_, {name: np.array(rows) for name, rows in parts.items()})
    figure.savefig(FOLDER / "0020-rate-gain.png", dpi=110)


def envelope(flown: Launch, burns: np.ndarray, name: str, figure: bool = True) -> None:
    """Print how often truth lies in the envelopes, and draw the first 100 s of a run."""
    runs = fly(flown, "filtered", "published")
    for axis, title in enumerate(("pitch", "yaw")):
        for phase, what in enumerate(("burn", "coast", "change")):
            row = runs.sums[:, axis, phase]
            inside = 100.0 * row[:, [INSIDE_TURNING, INSIDE_JERK]].sum(axis=0) / row[:, TICKS].sum()
            most = row[:, [TURNING_RATIO, JERK_RATIO]].max(axis=0)
            print(f"{name}: {title} {what}: inside {inside.round(3)} % of ticks, at most {most.round(2)} times")
    if figure:
        one = fly(flown, "filtered", "published", runs=1, every=1)
        first = one.history[0, one.t <= 100.0, 0]
        columns = (first[:, k] for k in (TURNING, TURNING_BOUND, JERK, JERK_BOUND))
        inside_envelope(one.t[one.t <= 100.0], *columns, burns).savefig(FOLDER / "0020-envelopes.png", dpi=110)


def canvas(rows: int, columns: int, row_height: float, **shared: bool) -> tuple[Figure, Any]:
    """Return a figure and its axes (rows, columns); row_height: inches."""
    figure = Figure(figsize=(7.2, row_height * rows), dpi=130, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def nozzle_movement(t: Floats, moved: Mapping[str, Floats], burns: Floats) -> Figure:
    """Draw the total movement of the nozzle so far, in both axes, all runs thin and their mean thick.

    Parameters
    ----------
    t : (n,) s
    moved : by the name of what feeds the controller, (n_run, n, 2) rad
    burns : (k, 2) begin and end of each burn, s, shaded
    """
    figure, grid = canvas(1, 2, 2.9, sharey=True)
    for axis, axes in enumerate(grid.ravel()):
        for number, (name, runs) in enumerate(moved.items()):
            degrees = np.degrees(runs[:, :, axis])
            style: dict[str, Any] = line_of(number)
            axes.plot(t, degrees.T, lw=0.4, alpha=0.35, **style)
            axes.plot(t, degrees.mean(axis=0), lw=1.6, label=name, **style)
        _shade(axes, burns)
        axes.set_title(AXES[axis])
        axes.set_xlabel("time since lift-off (s)")
    grid[0, 0].set_ylim(0.0, 1.2 * grid[0, 0].get_ylim()[1])  # of both; the legend has room
    grid[0, 0].set_ylabel("total nozzle movement (deg)")
    grid[0, 0].legend(loc="upper left")
    return figure


def inside_envelope(
    t: Floats, turning: Floats, turning_bound: Floats, jerk: Floats, jerk_bound: Floats, burns: Floats
) -> Figure:
    """Draw true angular acceleration (rad/s^2) and lateral jerk (m/s^3) of pitch in their envelopes, all (n,)."""
    figure, grid = canvas(2, 1, 2.4, sharex=True)
    named = (
        (grid[0, 0], turning, turning_bound, "angular acceleration\nin pitch (rad/s²)"),
        (grid[1, 0], jerk, jerk_bound, "jerk along z (m/s³)"),
    )
    for axes, value, bound, label in named:
        axes.plot(t, value, lw=0.5, color=PALETTE[0], label="true")
        axes.plot(t, bound, lw=1.2, color=PALETTE[1], label="envelope of the filter, 1 sigma")
        axes.plot(t, -bound, lw=1.2, color=PALETTE[1])
        axes.set_ylabel(label)
        axes.margins(x=0.0)
        _shade(axes, burns)
    grid[0, 0].legend(loc="upper right")
    grid[1, 0].set_xlabel("time since lift-off (s)" + (", burns shaded" if len(burns) else ""))
    return figure


def gain_sweep(factors: Floats, moved: Mapping[str, Floats], reductions: Mapping[str, Floats]) -> Figure:
    """Draw mean total movements (k, 2) rad by what feeds the controller, and reductions (k, 2), over the rate gain."""
    figure, grid = canvas(1, 2, 2.9)
    for axis, dashes in enumerate(("-", "--")):
        for number, (name, total) in enumerate(moved.items()):
            label = name if axis == 0 else None
            grid[0, 0].plot(factors, np.degrees(total[:, axis]), dashes, color=PALETTE[number], label=label)
        for number, (name, part) in enumerate(reductions.items()):
            label = name if axis == 0 else None
            grid[0, 1].plot(factors, 100.0 * part[:, axis], dashes, color=PALETTE[number], label=label)
    grid[0, 1].axhspan(50.0, 85.0, color="0.5", alpha=0.15, lw=0)
    grid[0, 0].set_ylabel("total nozzle movement (deg)")
    grid[0, 1].set_ylabel("less movement with the filtered rate (%)")
    for axes in grid.ravel():
        axes.set_xlabel("rate gain over that of the card (full: pitch, dashed: yaw)")
        axes.set_ylim(0.0)
        axes.legend(loc="best")
    return figure


def _shade(axes: Any, burns: Floats) -> None:
    """Shade the burns within an axis' reach."""
    low, high = axes.get_xlim()
    for begin, end in burns:
        if begin < high and end > low:
            axes.axvspan(max(begin, low), min(end, high), color="0.5", alpha=0.12, lw=0, zorder=0)
    axes.set_xlim(low, high)


if __name__ == "__main__":
    main()
