"""The combination matrix: a pairwise covering design over measurements and policies, each case flown by both engines.

`python -m tests.engines.combinations` runs every case and writes reports/combinations/.
"""

from __future__ import annotations

import itertools
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError
from scipy.stats import chi2

from lvnav_trade.engines.analysis.explain import flown_events
from lvnav_trade.engines.lincov.history import covariance, forward_tape
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.engines.simulate.montecarlo import run_block
from lvnav_trade.errors import InputError
from lvnav_trade.filters.scheduled import schedule_of
from lvnav_trade.layout import state_names
from lvnav_trade.refusals import refused
from lvnav_trade.scenario import Scenario
from tests.building import UNLIKE, loaded, prepare_hop, with_fields, with_units
from tests.engines.flown import FROM_PAD, STEADY, flight

RUNS, SEED = 64, 20261122
TIMES = (15.0, 30.0, 45.0, 60.0)
LEVEL = 1e-3
"""Probability that a case which agrees is called out, over all of its comparisons."""

BASE = (
    "base.imu=imu/tactical_fog_matched", "base.receiver=receivers/l1_two_metre", "base.initial.tilt=0.2 deg",
    "base.initial.heading=0.2 deg", "base.initial.position=5 m", "base.initial.velocity=0.1 m/s",
    "base.receiver.lever_b=[1 m, 0.5 m, -0.3 m]",
)  # fmt: skip
REFERENCE = {"kind": "attitude_reference", "name": "reference", "source": "test", "sigma": "5 mrad"}
ALTIMETER = {"kind": "altimeter", "name": "altimeter", "source": "test", "sigma": "20 m", "bias": "10 m",
             "highest": "1000 km"}  # fmt: skip
ON_PAD = {
    "zero_velocity": {"kind": "zero_velocity", "sigma": "5 cm/s", "jitter": "5 cm/s"},
    "zero_rotation": {"kind": "zero_rotation", "sigma": "1 mrad", "jitter": "1 mrad", "attitude": "0.3 deg"},
    "pad_position": {"kind": "pad_position", "sigma": "10 cm", "jitter": "10 cm", "survey": "5 cm"},
    "azimuth": {"kind": "azimuth", "sigma": "1 mrad", "bias": "0.3 mrad"},
}
"""Sensors of a flight whose first half is the rest on the pad."""
DIFFERENCES = ("angle_difference", "velocity_difference")
TRACKER = {"kind": "star_tracker", "name": "tracker", "source": "test", "boresight": [1.0, 1.0, 0.5],
           "across": "2 mrad", "about": "10 mrad", "misalignment": "1 mrad", "low_frequency": "1 mrad",
           "low_frequency_time": "20 s"}  # fmt: skip
COMPASS = {"kind": "magnetometer", "name": "compass", "source": "test", "sigma": "200 nT", "hard_iron": "200 nT",
           "soft_iron": "0.3 percent"}  # fmt: skip
STATION = {"kind": "ground_station", "name": "station", "source": "test", "latitude": "-38 deg", "longitude": "-55 deg",
           "range_sigma": "10 m", "angle_sigma": "0.2 mrad", "range_bias": "5 m", "survey": "3 m",
           "longest_range": "2000 km"}  # fmt: skip
SENSORS = {"attitude": REFERENCE, "altitude": ALTIMETER, "stellar_attitude": TRACKER, "magnetic_field": COMPASS,
           "ground_tracking": STATION}  # fmt: skip
SENSOR_LATENCY = "0.2 s"
"""Of every sensor, where late measurements are compensated by stored states."""
LATE = {"receiver.latency": "0.3 s"}
BUFFERED = {"kind": "buffered"}
EXTRAPOLATED = {"kind": "extrapolated", "delay_sigma": "1 ms", "acceleration_sigma": "0.1 m/s^2"}
POINT = {"kind": "bancroft", "range_sigma": "2 m", "rate_sigma": "0.1 m/s"}
FILTERED = {"kind": "filtered", "range_sigma": "2 m", "rate_sigma": "0.1 m/s", "jerk": "3 m/s^3",
            "clock_noise": "0.1 m/s^2", "start_acceleration": "50 m/s^2", "reported": True}  # fmt: skip

DIMENSIONS: dict[str, dict[str, dict[str, Any]]] = {
    "measurements": {
        "solution": {"filter.measurements": ["position", "velocity"]},
        "position": {"filter.measurements": ["position"]},
        "ranges": {"filter.measurements": ["pseudorange", "range_rate"]},
        "pseudorange": {"filter.measurements": ["pseudorange"]},
        "solution, attitude": {"filter.measurements": ["position", "velocity", "attitude"]},
        "ranges, star tracker": {"filter.measurements": ["pseudorange", "range_rate", "stellar_attitude"]},
        "solution, magnetometer": {"filter.measurements": ["position", "velocity", "magnetic_field"]},
        "ranges, altitude": {"filter.measurements": ["pseudorange", "range_rate", "altitude"]},
        "solution, attitude, imu": {"filter.measurements": ["position", "velocity", "attitude", "imu"]},
        "ranges, attitude, imu": {"filter.measurements": ["pseudorange", "range_rate", "attitude", "imu"]},
        "attitude": {"filter.measurements": ["attitude"]},
        "zero velocity and rotation, position, azimuth": {
            "filter.measurements": ["zero_velocity", "zero_rotation", "pad_position", "azimuth"]},
        "ranges, zero velocity": {"filter.measurements": ["pseudorange", "range_rate", "zero_velocity"]},
        "solution, differences": {"filter.measurements": ["position", "velocity", "angle_difference",
                                                          "velocity_difference"]},
        "solution, tracking": {"filter.measurements": ["position", "velocity", "ground_tracking"]},
        "none": {"filter.measurements": []},
    },
    "correction": {"closed": {}, "open": {"filter.feedback": "open"}},
    "gains": {"own": {}, "stored": {"gains": True}},
    "start": {
        "at once": {},
        # ten sigma of the start: linear covariance follows the mode logic of the nominal flight
        "mode logic": {"filter.logic": {"start_after": 3, "wild_position": "3 km", "wild_velocity": "50 m/s"}},
        "from GNSS": {"filter.init": "from_gnss"},
    },
    "latency": {
        "none": {},
        "buffered": {**LATE, "filter.delay_compensation": BUFFERED},
        "buffered, 1.4 s": {"receiver.latency": "1.4 s", "filter.delay_compensation": BUFFERED},
        "extrapolated": {**LATE, "filter.delay_compensation": EXTRAPOLATED},
    },
    "receiver": {"direct": {}, "point": {"receiver.solution": POINT}, "filtered": {"receiver.solution": FILTERED}},
    "states": {
        "biases": {},
        "considered": {"filter.consider": ["accel_scale_factor", "accel_bias"], "imu.accel.scale_factor": "300 ppm"},
        "neglected": {"filter.neglect": ["gyro_bias"]},
        "scale factors": {"filter.extra_states": ["gyro_scale_factor", "accel_scale_factor"],
                          "imu.gyro.scale_factor": "20 ppm", "imu.accel.scale_factor": "300 ppm"},
        "of sensors": {"sensor states": True},
        "unmodelled": {"imu.accel.misalignment": "0.3 mrad", "imu.gyro.scale_factor": "10 ppm",
                       "gravity": {"sigma": "30 mGal"}},
    },
    "units": {
        "one": {},
        "two": {"units": [{"lever_arm": ["0.3 m", "0 m", "0.1 m"]}, UNLIKE]},
        "skewed": {"units": [{"axes": [[1, 0, 1.2], [0, 1, 1.2], [-1, 0, 1.2]]},
                             {"axes": [[0, -1, 1.2]], "lever_arm": ["0.2 m", "0 m", "0 m"]}]},
    },
    "vehicle": {"steady": {}, "spinning": {"flight": "spinning"}, "oscillating": {"flight": "oscillating"}},
    "fault": {
        "none": {},
        "gyro bias step": {"faults": [{"kind": "gyro_bias_step", "size": ["20 deg/h", "0 deg/h", "0 deg/h"],
                                       "start": "20 s", "duration": "15 s"}]},
        "frozen output": {"faults": [{"kind": "frozen_output", "start": "30 s", "duration": "3 s"}]},
        "noise": {"faults": [{"kind": "degraded_noise", "factor": 3.0, "start": "20 s", "duration": "20 s"}]},
    },
}  # fmt: skip

Case = dict[str, str]


def covering(seed: int = 1) -> list[Case]:
    """Return cases in which every pair of levels of two dimensions stands at least once, in a case that is not refused
    if there is one; a pair that physics refuses stands in one refused case.

    A case of which new kernels have to be compiled takes as long as ten others: among candidates one that needs none
    is taken unless it covers far fewer pairs.
    """
    rng = np.random.default_rng(seed)
    names = list(DIMENSIONS)
    levels = {name: list(DIMENSIONS[name]) for name in names}
    left = {((a, x), (b, y)) for a, b in itertools.combinations(names, 2) for x in levels[a] for y in levels[b]}
    cases: list[Case] = []
    compiled: dict[tuple[object, ...], Case] = {}
    while left:
        (a, x), (b, y) = sorted(left)[rng.integers(len(left))]
        pair = {a: x, b: y}
        begun = [pair] * 30 + [
            {name: case[name] for name in POLICIES} | pair for case in compiled.values()
            if all(case[name] == level for name, level in pair.items() if name in POLICIES)
        ]  # fmt: skip
        candidates = [_grown(start, names, levels, left, rng) for start in begun]
        possible = [case for case in candidates if not refusal(case)]
        chosen = max(
            possible or candidates,
            key=lambda case: len(_pairs(names, case) & left) - (0 if kernels_of(case) in compiled else NEW_KERNELS),
        )
        left -= _pairs(names, chosen) if possible else {((a, x), (b, y))}
        if possible:
            compiled.setdefault(kernels_of(chosen), chosen)
        cases.append({name: chosen[name] for name in names})
    return cases


POLICIES = ("correction", "gains", "start", "latency", "receiver", "units")
NEW_KERNELS = 6
"""Pairs of levels that a case has to cover beyond others, if new kernels have to be compiled for it."""


def kernels_of(case: Case) -> tuple[object, ...]:
    """Return what of a case decides which kernels are compiled: the options of a flight that it has."""
    listed = DIMENSIONS["measurements"][case["measurements"]]["filter.measurements"]
    return (
        bool(set(listed) - {"position", "velocity", "pseudorange", "range_rate", "imu"}), "imu" in listed,
        case["correction"], case["gains"], case["start"] == "mode logic", case["latency"] == "none", case["receiver"],
        case["units"] == "one",
    )  # fmt: skip


def _grown(
    case: Case, names: list[str], levels: dict[str, list[str]], left: set[Any], rng: np.random.Generator
) -> Case:
    """Return a case with the other dimensions filled in, each by a level that covers most new pairs and is possible."""
    for name in rng.permutation([n for n in names if n not in case]).tolist():
        gain = np.array([sum(_key(names, (o, case[o]), (name, lv)) in left for o in case) for lv in levels[name]])
        order = np.lexsort((rng.random(gain.size), -gain))
        ranked = [case | {name: levels[name][int(k)]} for k in order]
        case = next((one for one in ranked if not refusal(one)), ranked[0])
    return case


def refusal(case: Case) -> str:
    """Return why a case is refused, empty if it is not; what it leaves open is at its first level."""
    fields: dict[str, Any] = {}
    for name, found in DIMENSIONS.items():
        fields |= found[case.get(name, next(iter(found)))]
    listed, late = fields["filter.measurements"], fields.get("filter.delay_compensation")
    card = SimpleNamespace(
        measurements=listed, aided=bool(listed), models_vehicle="imu" in listed,
        tight="pseudorange" in listed, loose="position" in listed, init=fields.get("filter.init", "from_card"),
        logic=fields.get("filter.logic"), gains=fields.get("gains"), extra_states=["standing_attitude"], consider=[],
        delay_compensation=None if late is None else SimpleNamespace(**late),
        sensor_models=SimpleNamespace(**dict.fromkeys((*SENSORS, *DIFFERENCES), "matched")),
    )  # fmt: skip
    latency = 1.0 if _lateness(case) else 0.0
    sensors = {
        name: SimpleNamespace(measurement=name, latency=latency, at_once=False) for name in SENSORS if name in listed
    }
    exact = SimpleNamespace(quantisation=0.0)
    trajectory = SimpleNamespace(kind="vehicle", pad_hold=60.0)
    units = tuple(
        SimpleNamespace(gyro=exact, accel=exact, directions=np.array(unit.get("axes", np.eye(3)), dtype=float))
        for unit in fields.get("units", [{}])
    )
    imu = SimpleNamespace(units=units, weights="random_walk") if "units" in fields else units[0]
    sensors |= {
        name: SimpleNamespace(measurement=name, units=(1, 2), at_once=True, latency=0.0)
        for name in listed
        if name in DIFFERENCES
    }
    found_one = refused(
        SimpleNamespace(filter=card, imu=imu, control=None, sensors=sensors, faults=(), trajectory=trajectory)
    )
    return "" if found_one is None else f"{found_one.path}: {found_one.reason}"


def _key(names: list[str], one: tuple[str, str], two: tuple[str, str]) -> tuple[tuple[str, str], tuple[str, str]]:
    return (one, two) if names.index(one[0]) < names.index(two[0]) else (two, one)


def _pairs(names: list[str], case: Case) -> set[tuple[tuple[str, str], tuple[str, str]]]:
    return {((a, case[a]), (b, case[b])) for a, b in itertools.combinations(names, 2)}


def scenario_of(case: Case) -> tuple[Scenario, str, bool]:
    """Return the scenario of a case, its flight, and whether its gains are stored; ValidationError with the reason."""
    fields: dict[str, Any] = {}
    for name, level in case.items():
        fields |= DIMENSIONS[name][level]
    kind, stored = fields.pop("flight", "steady"), fields.pop("gains", False)
    units = fields.pop("units", None)
    listed = fields["filter.measurements"]
    if case["fault"] == "frozen output" and {"position", "pseudorange"} & set(listed):
        # the output of eight kilometres ago is beyond a linear model: a filter has to check the flag
        fields.setdefault("filter.logic", {"start_after": 1})
    if (case["vehicle"], case["latency"]) == ("spinning", "extrapolated"):
        # a solution of a swinging antenna, extrapolated by its velocity, turns the roll by 10 deg: not linear either
        fields["receiver.lever_b"] = ["1 m", "0 m", "0 m"]
    if "imu" in listed and case["states"] == "scale factors":
        kind += STEADY  # at a step the estimated acceleration, which scale factors are multiplied with, is wrong
    if set(listed) & set(ON_PAD):
        kind = FROM_PAD + kind
    found = SENSORS | {name: {"kind": name} for name in DIFFERENCES}
    found |= {name: {"name": name, "source": "test"} | card for name, card in ON_PAD.items()}
    late = _lateness(case)
    fields["sensors"] = {
        name: card | (late if name in SENSORS else {}) for name, card in found.items() if name in listed
    }
    if fields.pop("sensor states", False):
        fields["filter.extra_states"] = [state for name in listed for state in _STATES.get(name, ())]
    if "zero_rotation" in listed:
        fields["filter.extra_states"] = ["standing_attitude", *fields.get("filter.extra_states", [])]
    of_unit = {path: value for path, value in fields.items() if path.startswith("imu.")}
    scenario = with_fields(loaded(*BASE), **of_unit)
    if units is not None:
        scenario = with_units(scenario, units)
    return with_fields(scenario, **{path: fields[path] for path in fields if path not in of_unit}), kind, stored


_STATES = {
    "altitude": ["altitude_bias"],
    "stellar_attitude": ["tracker_misalignment", "tracker_low_frequency"],
    "magnetic_field": ["hard_iron"],
}


def _lateness(case: Case) -> dict[str, Any]:
    """Return the latency of a case's sensors."""
    return {"latency": SENSOR_LATENCY} if case.get("latency", "none").startswith("buffered") else {}


class Verdict(NamedTuple):
    """What came of a case: refused with a reason, or agreement: lowest and highest RMS ratio with their bounds, and the
    output and time of the worst.
    """

    refused: str = ""
    low: float = 0.0
    high: float = 0.0
    bounds: tuple[float, float] = (0.0, 0.0)
    worst: str = ""
    seconds: float = 0.0

    @property
    def agrees(self) -> bool:
        """Whether both engines agree."""
        return not self.refused and self.bounds[0] < self.low and self.high < self.bounds[1]


def evaluate(case: Case, runs: int = RUNS) -> Verdict:
    """Run a case with both engines, or say why it is refused."""
    start = time.perf_counter()
    try:
        scenario, kind, stored = scenario_of(case)
        if stored:
            scenario = with_stored_gains(case, scenario)
        prepared = prepare_hop(scenario, flight(kind))
    except ValidationError as error:
        return Verdict(refused=str(error.errors()[0]["msg"]).removeprefix("Value error, "))
    except InputError as error:
        return Verdict(refused=str(error))
    low, high, bounds, worst = compare(prepared, runs)
    return Verdict("", low, high, bounds, worst, time.perf_counter() - start)


def with_stored_gains(case: Case, scenario: Scenario) -> Scenario:
    """Return the scenario with stored gains: those of the same filter with a direct solution that is not late.

    A filter that starts late needs gains of a late start: the first ones, taken later, turn the attitude by 8 deg.
    """
    start = "at once" if case["start"] == "from GNSS" else case["start"]
    plain, kind, _ = scenario_of(case | {"receiver": "direct", "latency": "none", "start": start})
    prepared = prepare_hop(plain, flight(kind))
    tape = forward_tape(prepared)
    used, n, names = int(tape.used[0]), prepared.layout.n_state, prepared.channels.names
    gains = np.zeros((prepared.t_epoch.size, len(names), n))
    gains[tape.epoch[:used], tape.channel[:used]] = tape.gain[:used, :n]
    taken = np.unique(tape.channel[:used])
    if not taken.size:
        raise InputError("filter.gains: the filter has no measurement that a gain could be for")
    schedule = schedule_of(
        "stored", "test", "time", state_names(prepared.layout), prepared.t_epoch, gains[:, taken],
        flown_events(prepared), tolerance=1e-6, measurements=[names[k] for k in taken],
    )  # fmt: skip
    return with_fields(scenario, **{"filter.gains": schedule.model_dump(mode="json")})


def compare(prepared: Prepared, runs: int) -> tuple[float, float, tuple[float, float], str]:
    """Return the lowest and highest ratio of RMS to linear covariance, their bounds, and where the worst is."""
    history, block = covariance(prepared), run_block(prepared, SEED, 0, runs)
    at = [int(np.argmin(np.abs(history.t - t))) for t in TIMES]
    expected = np.sqrt(history.true_sigma[at] ** 2 + history.mean[at] ** 2)
    rms = np.sqrt(np.mean(block.err[:, at] ** 2, axis=0))
    known = expected > 1e-12 * np.maximum(1e-30, np.nanmax(expected, axis=0))
    ratio = np.where(known, rms / np.where(known, expected, 1.0), 1.0)
    ratio = np.where(np.isfinite(ratio), ratio, np.inf)
    bounds = np.sqrt(chi2.ppf([0.5 * LEVEL / ratio.size, 1.0 - 0.5 * LEVEL / ratio.size], runs) / runs)
    off = np.maximum(ratio / bounds[1], bounds[0] / np.maximum(ratio, 1e-30))
    k, column = np.unravel_index(int(np.argmax(off)), off.shape)
    output = prepared.outputs[int(column)]
    worst = f"{output.quantity} {output.axis} at {TIMES[int(k)]:g} s: {ratio[k, column]:.3f}"
    return float(ratio.min()), float(ratio.max()), (float(bounds[0]), float(bounds[1])), worst


def main() -> int:
    """Run every case (or those whose numbers are given) and write reports/combinations/."""
    cases = covering()
    chosen = [int(k) for k in sys.argv[1:]] or range(len(cases))
    rows = []
    for number in chosen:
        verdict = evaluate(cases[number])
        rows.append((number, cases[number], verdict))
        text = verdict.refused or f"{'agree' if verdict.agrees else 'DIFFER'} {verdict.low:.3f} {verdict.high:.3f}"
        print(number, text, verdict.worst, f"{verdict.seconds:.0f} s", cases[number], flush=True)  # noqa: T201
    if len(rows) == len(cases):
        write(rows, Path("reports/combinations"))
    return int(any(not (v.refused or v.agrees) for _, _, v in rows))


def write(rows: list[tuple[int, Case, Verdict]], folder: Path) -> None:
    """Write the matrix as CSV and as a page."""
    folder.mkdir(parents=True, exist_ok=True)
    head = ["case", *DIMENSIONS, "verdict", "lowest ratio", "highest ratio", "lower bound", "upper bound", "worst"]
    lines = [",".join(f'"{name}"' for name in head)]
    for number, case, v in rows:
        verdict = f"refused: {v.refused}" if v.refused else "agree" if v.agrees else "differ"
        numbers = ["", "", "", ""] if v.refused else [f"{x:.3f}" for x in (v.low, v.high, *v.bounds)]
        lines.append(",".join(f'"{cell}"' for cell in [str(number), *case.values(), verdict, *numbers, v.worst]))
    (folder / "matrix.csv").write_text("\n".join(lines) + "\n")
    agree, refusals = sum(v.agrees for _, _, v in rows), sorted({v.refused for _, _, v in rows if v.refused})
    differ = [number for number, _, v in rows if not v.refused and not v.agrees]
    page = [
        "# Combination matrix",
        "",
        f"{len(rows)} cases in which every pair of levels of {len(DIMENSIONS)} dimensions stands at least once, on a",
        f"minute of flight, {RUNS} runs each: RMS of Monte Carlo over linear covariance of every output at",
        f"{', '.join(f'{t:g} s' for t in TIMES)}, within its chi-square interval ({LEVEL:g} a case).",
        "",
        f"- Both engines agree: {agree} cases.",
        f"- They differ: {len(differ)}{' (' + ', '.join(map(str, differ)) + ')' if differ else ''}.",
        f"- Refused: {sum(bool(v.refused) for _, _, v in rows)}, for these reasons:",
        *(f"  - {reason}" for reason in refusals),
        "",
        "Every case is a line of [matrix.csv](matrix.csv). Made by `python -m tests.engines.combinations`.",
        "",
    ]
    (folder / "README.md").write_text("\n".join(page))


if __name__ == "__main__":
    sys.exit(main())
