"""Nozzle movement with raw and filtered rate, envelopes of angular acceleration and jerk; behind decision 0020.

Run as ``python docs/design/nozzle_movement.py``: prints tables and draws figures beside the decision, in some minutes.
"""

from __future__ import annotations

import math
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from lvnav_trade.campaign import tree
from lvnav_trade.campaign.cards import shipped
from lvnav_trade.engines.envelopes import improvement
from lvnav_trade.metrics.vehicle.nozzle import reduction
from lvnav_trade.plots.rotation import gain_sweep, inside_envelope, nozzle_movement
from lvnav_trade.steering.loop import (
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
from lvnav_trade.steering.missions import Launch, Missions, fly_missions, prepare_launch, with_rate_gain
from lvnav_trade.world.ascent.vehicle import VehicleAscent
from lvnav_trade.world.control.ascent import ascend
from lvnav_trade.world.control.body import RotationCard
from lvnav_trade.world.control.controller import ControllerCard, FeedbackCard
from lvnav_trade.world.control.wind import WindCard
from lvnav_trade.world.sensors.imu import ImuCard

RUNS = 20
FACTORS = np.array([0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0])
READINGS = ("published", "datasheet")
FOLDER = Path(__file__).resolve().parents[1] / "decisions"


def card(kind: Any, name: str, **over: Any) -> Any:
    """Return a card that comes with the tool, with fields laid over."""
    plain = tree.plain(tree.read_mapping(shipped("configs") / f"{name}.yaml"))
    if isinstance(plain.get("vehicle"), str):
        plain["vehicle"] = tree.plain(tree.read_mapping(shipped("configs") / f"{plain['vehicle']}.yaml"))
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
    return fly_missions(flown, FeedbackCard(rate=rate, noise=noise), runs, every=every)  # type: ignore[arg-type]


def main() -> None:
    """Print the tables and draw the figures."""
    improvements()
    churchill = launch()
    events = churchill.changes
    burning = churchill.body.motor > 0
    edges = np.flatnonzero(np.diff(burning.astype(int), prepend=0, append=0))
    burns = churchill.body.t[np.minimum(edges, burning.size - 1)].reshape(-1, 2)
    print(f"changes of phase at {', '.join(f'{t:.1f}' for t in events)} s")
    for noise in READINGS:
        missions = {rate: fly(churchill, rate, noise) for rate in ("raw", "filtered", "true")}
        totals(noise, missions, burns)
        moved = {f"{rate} rate": missions[rate].history[..., MOVED] for rate in ("raw", "filtered")}
        nozzle_movement(missions["raw"].t, moved, burns).savefig(FOLDER / f"0020-nozzle-movement-{noise}.png", dpi=110)
    sweep(churchill)
    envelope(churchill, burns, "6 s kick, as the card")
    envelope(launch(kick_duration="12 s"), burns, "12 s kick", figure=False)


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
            flown = with_rate_gain(churchill, float(factor))
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


if __name__ == "__main__":
    main()
