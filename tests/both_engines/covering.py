"""A pairwise covering design over measurements and policies: the levels of each dimension, and what physics refuses.

`python -m tests.both_engines.covering` appends cases to combinations.csv where a new level or dimension stands in none.
"""

from __future__ import annotations

import csv
import functools
import itertools
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from lvnav_trade.filter.card import FilterCard
from lvnav_trade.scenario.rules import first_refusal
from tests.building import UNLIKE

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
OBSERVABLES = {"pseudorange", "range_rate", "carrier_phase", "tdcp", "delta_pseudorange"}
FURTHER = OBSERVABLES - {"pseudorange", "range_rate"}
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
        "pseudorange, tdcp": {"filter.measurements": ["pseudorange", "tdcp"]},
        "tdcp, star tracker": {"filter.measurements": ["tdcp", "stellar_attitude"]},
        "carrier phase, delta-range": {"filter.measurements": ["carrier_phase", "delta_pseudorange"]},
        "pseudorange, tdcp, attitude, imu": {"filter.measurements": ["pseudorange", "tdcp", "attitude", "imu"]},
        "none": {"filter.measurements": []},
    },
    "correction": {"closed": {}, "open": {"filter.feedback": "open"}, "direct": {"filter.feedback": "direct"}},
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
    "receiver": {
        "direct": {}, "point": {"receiver.solution": POINT}, "filtered": {"receiver.solution": FILTERED},
        "smoothed": {"receiver.solution": POINT | {"smoothing": {"time": "20 s"}}},
    },
    "ranges": {
        "one frequency": {}, "two frequencies": {"receiver.frequencies": "L1_L2"},
        "two systems": {"constellation": "constellations/gps_galileo"},
        "noise by altitude": {"receiver.noise_by": [{"altitude": ["200 km", "400 km"], "factor": [1.0, 4.0]}]},
        "slips": {"receiver.cycle_slips": {"rate": "100 1/h"}},
        "offset of rates": {"receiver.range_rate_offset": "0.1 m/s"},
    },
    "earlier epoch": {
        "clone": {}, "considered": {"filter.delayed_state": "consider"},
        "found back": {"filter.delayed_state": "back_propagated"},
        "noise estimated": {"filter.previous_noise": "estimated"},
    },
    "clock": {"two states": {}, "one state": {"filter.clock": "one_state"},
              "differenced": {"filter.clock": "differenced"}},
    "residual delay": {
        "none": {}, "one state": {"filter.extra_states": ["troposphere_scale"]},
        "by satellite": {"filter.extra_states": ["troposphere_scale_by_satellite"]},
        "as noise": {"filter.as_noise": ["ionosphere_scale"]},
    },
    "tuning": {
        "none": {}, "under-weighting": {"filter.underweighting": [{"beta": 0.5, "noise_factor": 2.0, "until": "30 s"}]},
        "fading memory": {"filter.fading_memory": "60 s"},
        "region noise": {"filter.region_noise": [{"force_change": "5 m/s^2", "velocity": "0.1 m/s"}]},
        "transition rate": {"filter.transition_rate": "2 Hz"},
    },
    "strapdown": {
        "two-sample": {}, "summed, half rate": {"filter.strapdown": {"algorithm": "summed", "ratio": 2}},
        "optimised, pad": {"filter.strapdown": {"algorithm": "optimised", "ratio": 4}, "filter.mechanisation": "pad"},
        "4 Hz, Earth": {"filter.update_rate": "4 Hz", "receiver.rate": "4 Hz", "filter.mechanisation": "earth"},
    },
    "backup": {"none": {}, "beside": {"filter.backup": True}},
    "states": {
        "biases": {},
        "considered": {"filter.consider": ["accel_scale_factor", "accel_bias"], "imu.accel.scale_factor": "300 ppm"},
        "neglected": {"filter.neglect": ["gyro_bias"]},
        "scale factors": {"filter.extra_states": ["gyro_scale_factor", "accel_scale_factor"],
                          "imu.gyro.scale_factor": "20 ppm", "imu.accel.scale_factor": "300 ppm"},
        "nonlinear": {"filter.extra_states": ["accel_nonlinearity", "gyro_scale_factor"],
                      "imu.accel.nonlinearity": "0.1 percent", "imu.gyro.scale_factor": "20 ppm"},
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
        "range bias": {"faults": [{"kind": "range_bias", "size": "60 m", "start": "20 s", "duration": "20 s"}]},
    },
    "algorithm": {
        "extended": {}, "iterated": {"filter.algorithm": "iterated"}, "unscented": {"filter.algorithm": "unscented"},
    },
    "integrity": {"none": {}, "tests": {"filter.integrity": {"hold": "8 s"}}},
}  # fmt: skip

PHASES = {name for name, fields in DIMENSIONS["measurements"].items() if FURTHER & set(fields["filter.measurements"])}
Case = dict[str, str]
Pair = tuple[tuple[str, str], tuple[str, str]]
DESIGN = Path(__file__).with_name("combinations.csv")
_FIRST = {name: next(iter(levels)) for name, levels in DIMENSIONS.items()}
_DEFAULTS = {name: field.default for name, field in FilterCard.model_fields.items()}


@functools.cache
def covering() -> list[Case]:
    """Return the design: cases in which every pair of levels of two dimensions stands at least once, in a case that is
    not refused if there is one; a pair that physics refuses stands in one refused case.

    It is stored, so that cases keep their numbers: `python -m tests.both_engines.covering` appends what it lacks.
    """
    with DESIGN.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def extended(cases: list[Case], seed: int = 1) -> list[Case]:
    """Return the cases and others that cover the pairs of levels which stand in none of them.

    A case of which new kernels have to be compiled takes as long as ten others: among candidates one that needs none
    is taken unless it covers far fewer pairs.
    """
    rng = np.random.default_rng(seed)
    names, cases = list(DIMENSIONS), list(cases)
    levels = {name: list(DIMENSIONS[name]) for name in names}
    left = {((a, x), (b, y)) for a, b in itertools.combinations(names, 2) for x in levels[a] for y in levels[b]}
    compiled: dict[tuple[object, ...], Case] = {}
    for case in cases:
        left -= _pairs(names, case)
        if not refusal(case):
            compiled.setdefault(kernels_of(case), case)
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


POLICIES = ("correction", "gains", "start", "latency", "receiver", "units", "backup", "algorithm", "integrity")
NEW_KERNELS = 12
"""Pairs of levels that a case has to cover beyond others, if new kernels have to be compiled for it."""


def kernels_of(case: Case) -> tuple[object, ...]:
    """Return what of a case decides which kernels are compiled: the options of a flight that it has."""
    listed = DIMENSIONS["measurements"][case["measurements"]]["filter.measurements"]
    return (
        bool(set(listed) - {"position", "velocity", "imu", *OBSERVABLES}), "imu" in listed, bool(FURTHER & set(listed)),
        case["correction"], case["gains"], case["start"] == "mode logic", case["latency"] == "none",
        case["receiver"] if {"position", "velocity"} & set(listed) else "", case["units"] == "one", case["backup"],
        case["algorithm"], case["integrity"],
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
    return _refusal(*(case.get(name, next(iter(DIMENSIONS[name]))) for name in _RULED))


# What decides whether a case is refused.
_RULED = (
    "measurements", "gains", "start", "latency", "earlier epoch", "clock", "residual delay", "tuning", "strapdown",
    "units", "backup", "correction", "algorithm",
)  # fmt: skip


@functools.cache
def _refusal(*levels: str) -> str:
    fields = fields_of(_FIRST | dict(zip(_RULED, levels, strict=True)))
    listed, delays = fields["filter.measurements"], fields.get("filter.delay_compensation")
    stated = {path.removeprefix("filter."): value for path, value in fields.items() if path.startswith("filter.")}
    ratio = SimpleNamespace(ratio=stated.pop("strapdown", {"ratio": 1})["ratio"])
    rates = {"covariance_rate": 10.0, "transition_rate": 2.0 if stated.pop("transition_rate", None) else None}
    weighted = [SimpleNamespace(measurements=()) for _ in stated.pop("underweighting", ())]
    own = _DEFAULTS | stated | rates | {"strapdown": ratio, "underweighting": weighted, "logic": None}
    wrong = next(FilterCard._faults(SimpleNamespace(**own | _what_is_measured(listed))), "")
    if wrong:
        return wrong
    card = SimpleNamespace(
        measurements=listed, **_what_is_measured(listed), init=fields.get("filter.init", "from_card"),
        logic=fields.get("filter.logic"), gains=fields.get("gains"), extra_states=["standing_attitude"], consider=[],
        delay_compensation=None if delays is None else SimpleNamespace(**delays),
        sensor_models=SimpleNamespace(**dict.fromkeys((*SENSORS, *DIFFERENCES), "matched")),
    )  # fmt: skip
    latency = 1.0 if lateness({"latency": levels[_RULED.index("latency")]}) else 0.0
    sensors = {
        name: SimpleNamespace(measurement=name, latency=latency, has_no_latency=False)
        for name in SENSORS
        if name in listed
    }
    exact = SimpleNamespace(quantisation=0.0)
    trajectory = SimpleNamespace(kind="vehicle", pad_hold=60.0)
    units = tuple(
        SimpleNamespace(gyro=exact, accel=exact, directions=np.array(unit.get("axes", np.eye(3)), dtype=float))
        for unit in fields.get("units", [{}])
    )
    imu = (
        SimpleNamespace(units=units, weights="random_walk", selection="mean", parity=None)
        if "units" in fields
        else units[0]
    )
    sensors |= {
        name: SimpleNamespace(measurement=name, units=(1, 2), has_no_latency=True, latency=0.0)
        for name in listed
        if name in DIFFERENCES
    }
    found_one = first_refusal(
        SimpleNamespace(filter=card, imu=imu, control=None, sensors=sensors, faults=(), trajectory=trajectory)
    )
    return "" if found_one is None else f"{found_one.path}: {found_one.reason}"


def _what_is_measured(listed: list[str]) -> dict[str, bool]:
    return {
        "is_aided": bool(listed), "models_vehicle": "imu" in listed, "tight": bool(OBSERVABLES & set(listed)),
        "loose": "position" in listed,
    }  # fmt: skip


def fields_of(case: Case) -> dict[str, Any]:
    """Return the fields that a case states, without those that mean nothing to what it measures."""
    fields: dict[str, Any] = {}
    for name, level in case.items():
        fields |= {} if name in _idle(case) else DIMENSIONS[name][level]
    more = [DIMENSIONS[name][case[name]].get("filter.extra_states", []) for name in ("states", "residual delay")
            if name not in _idle(case)]  # fmt: skip
    return fields | ({"filter.extra_states": [*itertools.chain(*more)]} if any(more) else {})


def _idle(case: Case) -> set[str]:
    """Return the dimensions whose setting would mean nothing to what a case measures, so that it is left out."""
    listed = set(DIMENSIONS["measurements"][case["measurements"]]["filter.measurements"])
    is_tight, is_loose = bool(OBSERVABLES & listed), "position" in listed
    found = set() if {"tdcp", "delta_pseudorange"} & listed else {"earlier epoch"}
    found |= set() if is_tight else {"clock"}
    found |= set() if is_tight or {"position", "velocity"} & set(listed) else {"integrity"}
    if not is_loose:
        found.add("receiver")
    of_ranges = {"slips": {"tdcp", "carrier_phase"}, "offset of rates": {"range_rate", "velocity"}}
    level, solves = case["ranges"], is_loose and case["receiver"] != "direct"
    if not (is_tight or solves) or not of_ranges.get(level, listed) & listed or (solves and level == "slips"):
        found.add("ranges")
    if not is_tight and (not is_loose or case["residual delay"] == "by satellite"):
        found.add("residual delay")
    return found


def _key(names: list[str], one: tuple[str, str], two: tuple[str, str]) -> Pair:
    return (one, two) if names.index(one[0]) < names.index(two[0]) else (two, one)


def _pairs(names: list[str], case: Case) -> set[Pair]:
    return {((a, case[a]), (b, case[b])) for a, b in itertools.combinations(names, 2)}


def lateness(case: Case) -> dict[str, Any]:
    """Return the latency of a case's sensors."""
    return {"latency": SENSOR_LATENCY} if case.get("latency", "none").startswith("buffered") else {}


if __name__ == "__main__":
    design = extended(covering())
    with DESIGN.open("w", encoding="utf-8", newline="") as output:
        table = csv.DictWriter(output, list(DIMENSIONS), lineterminator="\n")
        table.writeheader()
        table.writerows(design)
