"""Decision 65: one filter, receiver geometry and atmosphere for every table of Canepa and Servidia, by a stated search.

    python docs/design/conae_search.py

Rows: every reference of tables 2 to 5 in campaigns/conae that is one flight of theirs, numbered file by file
and case by case.
Objective: mean of squared logarithms of ours over published. Rows of odd number are fitted, rows of even number
withheld; the rule stands before the first evaluation, and withheld rows take no part in any choice.
Ours: root mean square over 24 runs (of a worst case: the median over runs of each run's largest error).
Search: from table 1 read per root hour and three other starts one parameter after the other over its grid, the others
at their best, until a round changes nothing; the best end, then the satellites, then the filter's noise again.
"""

from __future__ import annotations

import json
import math
import re
import time
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.search.point import with_values
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.quantities.units import parse
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare

FOLDER = Path(__file__).resolve().parents[2] / "campaigns" / "conae"
FILES = ("pvt_sources", "imu_temperature", "delay", "hil_like")
RUNS = 24
LATER = "uncompensated, position"  # came to count as decided by an input after the search; its ratio is 1, no score
SI = {"deg": "rad", "deg/s": "rad/s", "m": "m", "m/s": "m/s"}
CONSTANT = ("Bancroft", "EKF-GNSS #2")  # sources with the constant covariance of point solutions

X, Y, Z = ("-4.5131 deg/h", "-7.5016 deg/h", "9.9218 deg/h")
RAMP = {"x": [X, Y, Z], "y": [Y, Z, X], "z": [Z, X, Y]}  # the printed axis that is longitudinal, then the other two
A, B, C = ("0.28958 mg", "0.93698 mg", "0.85423 mg")
ACCEL = {"x": [A, B, C], "y": [B, C, A], "z": [C, A, B]}
NOISE = ("velocity_noise", "gyro_walk", "position_noise", "attitude_noise", "white", "accel_walk")
GRID: dict[str, tuple[Any, ...]] = {
    "velocity_noise": (0.0, 0.005, 0.01, 0.02, 0.03, 0.05, 0.1),  # m/s/sqrt(s)
    "gyro_walk": (3e-5, 1e-4, 1.944e-4, 4.867e-4, 2e-3, 2.92e-2),  # deg/s/sqrt(s)
    "position_noise": (0.0, 0.01, 0.03, 0.1, 0.3),  # m/sqrt(s)
    "attitude_noise": (0.0, 0.5, 2.0, 5.0),  # deg/sqrt(h)
    "white": (1.0, 0.3, 0.1),  # of the samples, as a part of table 1
    "accel_walk": ("0.0155 mg/sqrt(s)", "0.0155 mg/sqrt(h)"),
    "longitudinal": ("x", "y", "z"),
    "content": (5, 10, 20),  # TECU
}
GEOMETRY: dict[str, tuple[Any, ...]] = {
    "hour": tuple(range(24)),  # of 20 March 2024
    "channels": (6, 7, 8, 10, 12, 16),
    "mask": (5, 10, 15, 20),  # deg at sea level
}
PRINTED = {"gyro_walk": 4.867e-4, "velocity_noise": 0.0, "position_noise": 0.0, "attitude_noise": 0.0, "white": 1.0,
           "accel_walk": "0.0155 mg/sqrt(s)", "longitudinal": "x", "content": 10,
           "hour": 12, "channels": 16, "mask": 10}  # fmt: skip
STARTS: tuple[dict[str, Any], ...] = (
    {},
    {"velocity_noise": 0.03},
    {"white": 0.3},
    {"white": 0.3, "attitude_noise": 2.0},
)


class Row(NamedTuple):
    """A published number: its campaign, case and metric, and its value, SI (of satellites a number)."""

    file: str
    case: str
    item: str
    metric: str
    worst: bool
    phase: bool
    value: float


@cache
def _campaign(file: str):
    found = load(FOLDER / f"{file}.yaml")
    return found, {case.label: case for case in cases(found)}


@cache
def rows() -> tuple[Row, ...]:
    """Return the published numbers, file by file and case by case."""
    found = []
    for file in FILES:
        campaign, labelled = _campaign(file)
        for one in campaign.references:
            if not one.source.startswith("Canepa and Servidia, table"):
                continue
            named = [
                k for k, case in labelled.items() if all(case.axes.get(a, "base") == v for a, v in one.case.items())
            ]
            value = one.value if one.unit == "-" else parse(f"{one.value} {one.unit}", SI[one.unit])
            scored = not one.repeats or one.item.endswith(LATER)
            metric = one.metric if scored else ""  # numbered, but an input decides it: no score
            found.append(Row(file, named[0], one.item, metric, one.statistic == "worst", bool(one.during), value))
    return tuple(sorted(found, key=lambda row: (FILES.index(row.file), list(_campaign(row.file)[1]).index(row.case))))


def _values(file: str, case: str, at: dict[str, Any]) -> dict[str, Any]:
    """Return what a campaign's scenario has in place of its own at a point, but for the filter's noise."""
    found = {
        "imu.gyro.temperature.amplitude": RAMP[at["longitudinal"]],
        "imu.accel.temperature.amplitude": ACCEL[at["longitudinal"]],
        "trajectory.epoch": f"2024-03-20T{at['hour']:02d}:00:00Z",
    }
    if file != "pvt_sources":
        found["atmosphere.ionosphere.vertical"] = f"{at['content']} TECU"
    if file != "hil_like":
        found |= {"receiver.channels": at["channels"], "receiver.mask": f"{at['mask']} deg"}
    if case.removeprefix("solution=") in CONSTANT:
        sigmas = deviation(at["hour"], at["channels"], at["mask"])
        found |= {f"receiver.solution.reported_covariance.{name}": text for name, text in sigmas.items()}
    return found


@lru_cache(maxsize=24)
def _prepared(file: str, case: str, values: str) -> PreparedCase:
    return prepare(with_values(_campaign(file)[1][case].scenario, json.loads(values)), history=1.0)


def _noisy(prepared_case: PreparedCase, at: dict[str, Any]) -> PreparedCase:
    """Return a case with the filter's process noise of a point: over a window densities times its length."""
    layout, model = prepared_case.layout, prepared_case.model
    gyro = parse(f"{0.7 * at['white']} deg/h/sqrt(Hz)", "rad/s**0.5")
    accel = parse(f"{24.0 * at['white']} ug/sqrt(Hz)", "m/s**1.5")
    attitude = math.hypot(gyro, parse(f"{at['attitude_noise']} deg/sqrt(h)", "rad/s**0.5"))
    density = {
        ATT: attitude,
        VEL: math.hypot(accel, at["velocity_noise"]),
        POS: at["position_noise"],
    }
    walks = {
        "gyro_bias": (f"{at['gyro_walk']} deg/s/sqrt(s)", "rad/s**1.5"),
        "accel_bias": (at["accel_walk"], "m/s**2.5"),
    }
    density |= {block.offset: parse(*walks[block.name]) for block in layout.parameters}
    noise = model.noise.copy()
    for first, root in density.items():
        noise[:, first : first + 3] = model.seconds[:, None] * root**2
    return prepared_case._replace(model=model._replace(noise=noise))


@cache
def deviation(hour: int, channels: int, mask: int) -> dict[str, str]:
    """Return the standard deviation per axis of point solutions along the flight, of position and velocity."""
    at = PRINTED | {"hour": hour, "channels": channels, "mask": mask}
    campaign, labelled = _campaign("pvt_sources")
    values = _values("pvt_sources", "", at) | {"receiver.solution.reported": True}
    prepared_case = prepare(with_values(labelled["solution=Bancroft"].scenario, values), history=1.0)
    t, err, names = _errors(prepared_case, campaign.seed)
    flown = (t >= 0.0) & (t <= prepared_case.trajectory.events["injection"])
    found = {}
    for name, unit in (("position", "m"), ("velocity", "m/s")):
        columns = [i for i, (quantity, _) in enumerate(names) if quantity == f"solution_{name}"]
        size = math.sqrt(np.nanmean(err[:, flown][:, :, columns] ** 2))
        found[f"{name}_sigma"] = f"{float(f'{size:.2g}')} {unit}"
    return found


_DONE: dict[str, dict[str, float]] = {}


def _errors(prepared_case: PreparedCase, seed: int) -> tuple[np.ndarray, np.ndarray, list[tuple[str, str]]]:
    runs = run_block(prepared_case, seed, 0, RUNS)
    return runs.t, runs.err, [(one.quantity, one.axis) for one in prepared_case.outputs]


def _measured(row: Row, t: np.ndarray, err: np.ndarray, names: list[tuple[str, str]], end: float) -> float:
    if not row.metric:
        return math.nan
    quantity, axis = re.fullmatch(r"(\w+)_error_(\w+)", row.metric).groups()
    columns = [i for i, (q, a) in enumerate(names) if q == quantity and axis in (a, "3d")]
    if not columns:
        return math.nan
    size = np.linalg.norm(err[:, :, columns], axis=2)
    flown = (t >= 0.0) & (t <= end + 1e-6)
    if row.worst:
        return float(np.median(size[:, flown].max(axis=1)))
    chosen = flown if row.phase else np.abs(t - end) < 1e-6
    return float(np.sqrt(np.mean(size[:, chosen] ** 2)))


def ours(at: dict[str, Any]) -> np.ndarray:
    """Return our value of every row at a point of the search."""
    found = []
    for row in rows():
        campaign, _ = _campaign(row.file)
        values = json.dumps(_values(row.file, row.case, at))
        key = json.dumps([row.file, row.case, values, [at[name] for name in NOISE]])
        if key not in _DONE:
            prepared_case = _noisy(_prepared(row.file, row.case, values), at)
            end = prepared_case.trajectory.events["injection"]
            t, err, names = _errors(prepared_case, campaign.seed)
            mine = [one for one in rows() if (one.file, one.case) == (row.file, row.case)]
            flown = (prepared_case.t_epoch >= 0.0) & (prepared_case.t_epoch <= end)
            least = float(prepared_case.sky.is_tracked.sum(axis=1)[flown].min())
            _DONE[key] = {
                f"{one.item} {one.metric}": least if "satellites" in one.metric else _measured(one, t, err, names, end)
                for one in mine
            }
        found.append(_DONE[key][f"{row.item} {row.metric}"])
    return np.array(found)


def scores(at: dict[str, Any]) -> tuple[float, float, np.ndarray]:
    """Return the objective over fitted and over withheld rows, and the ratio of every row."""
    ratio = ours(at) / np.array([row.value for row in rows()])
    square = np.log(ratio) ** 2
    return float(np.nanmean(square[0::2])), float(np.nanmean(square[1::2])), ratio


def fit(at: dict[str, Any], grid: dict[str, tuple[Any, ...]], most: int = 4) -> tuple[dict[str, Any], float]:
    """Return the best point and its objective: a parameter after the other, until a round changes nothing."""
    best = scores(at)[0]
    for _ in range(most):
        before = dict(at)
        for name, levels in grid.items():
            tried = {level: scores(at | {name: level})[0] for level in levels}
            level = min(tried, key=tried.get)
            if tried[level] < best - 1e-9:
                at, best = at | {name: level}, tried[level]
                print(f"  {name} = {level}: {best:.4f}", flush=True)
        if at == before:
            break
    return at, best


def show(at: dict[str, Any]) -> None:
    """Print the ratio of every row and both scores at a point of the search."""
    fitted, withheld, ratio = scores(at)
    for number, (row, one) in enumerate(zip(rows(), ratio, strict=True), start=1):
        part = "fit " if number % 2 else "held"
        print(f"{number:3d} {part} {row.file:16s} {row.item[:34]:34s} {row.case[:44]:44s} {one:8.3f}")
    print(f"fitted {fitted:.4f} withheld {withheld:.4f}, {_close(ratio)} within a factor of two", at)


def _close(ratio: np.ndarray) -> int:
    return int(np.sum((ratio > 0.5) & (ratio < 2.0)))


def neighbours(at: dict[str, Any]) -> None:
    """Print both scores with every parameter at each of its other levels."""
    for name, levels in (GRID | GEOMETRY).items():
        for level in levels:
            fitted, withheld, ratio = scores(at | {name: level})
            both = f"fitted {fitted:.3f} withheld {withheld:.3f}"
            print(f"  {name:16s} {level!s:20s} {both}, {_close(ratio)} within a factor of two")


def main() -> None:
    """Search the filter's noise from every start, then the satellites, then the noise again; print all of it."""
    began, ends = time.time(), []
    for start in STARTS:
        at = PRINTED | start
        print("from {}: {:.4f} fitted, {:.4f} withheld".format(start or "table 1", *scores(at)[:2]), flush=True)
        ends.append(fit(at, GRID))
        print(f"end {ends[-1][1]:.4f}, {time.time() - began:.0f} s", flush=True)
    at = min(ends, key=lambda end: end[1])[0]
    show(at)
    for grid in (GEOMETRY, GRID):
        at, _ = fit(at, grid)
        show(at)
        print(f"{time.time() - began:.0f} s", flush=True)
    neighbours(at)
    print(f"{time.time() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main()
