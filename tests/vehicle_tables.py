"""Tables of a vehicle with known answers: rate and acceleration, nozzle movement, envelopes, stretches; in memory."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pyarrow as pa

from lvnav_trade.results.tables.dictionary import arrow_schema
from lvnav_trade.results.tables.read import Tables

CASES = {
    "aaaaaaaaaaaa": {"imu": "noisy", "rate_gain": "1"},
    "bbbbbbbbbbbb": {"imu": "noisy", "rate_gain": "2"},
}
T = np.arange(0.0, 101.0)
RAW, FILTERED, SIGMA = 7e-4, 6e-5, 8e-5
LESS = 0.7
"""What the filtered rate takes off the nozzle's movement in pitch; in yaw half of that."""
RUNS = 20

DURING = "liftoff + 10 s to stage1_cutoff"
REFERENCES = [
    {"source": "a paper", "case": {"rate_gain": gain}, "metric": "rate_error_roll", "than": "raw_rate_error_roll",
     "statistic": "formal", "during": DURING, "value": value, "unit": "%"}
    for gain, value in (("1", 88.0), ("2", 57.0))
]  # fmt: skip


def _table(name: str, rows: list[dict[str, Any]]) -> pa.Table:
    schema = arrow_schema(name)
    return pa.table({f.name: pa.array([row.get(f.name) for row in rows], type=f.type) for f in schema}, schema=schema)


def _history(case: str) -> list[dict[str, Any]]:
    rows = []
    for quantity, size in (("raw_rate", RAW), ("corrected_rate", RAW), ("rate", FILTERED), ("raw_acceleration", 0.24),
                           ("corrected_acceleration", 0.23), ("acceleration", 0.1)):  # fmt: skip
        for axis in ("roll", "pitch", "yaw") if "rate" in quantity else ("x", "y", "z"):
            believed = SIGMA if quantity == "rate" else size
            rows += [{"case": case, "t_s": t, "quantity": quantity, "axis": axis, "unit": "rad/s", "run_count": RUNS,
                      "mean_si": 0.0, "rms_si": size, "filter_sigma_si": believed, "lincov_formal_si": believed,
                      "lincov_true_si": size, "lincov_mean_si": 0.0, "dof_ratio": 1.0} for t in T]  # fmt: skip
    for quantity, size in (
        ("attitude", 1e-3),
        ("velocity", 0.1),
        ("position", 5.0 if case == "aaaaaaaaaaaa" else 10.0),
    ):
        rows += [{"case": case, "t_s": t, "quantity": quantity, "axis": "3d", "unit": "SI", "run_count": RUNS,
                  "lincov_true_si": size} for t in T]  # fmt: skip
    roll = 1e-4 if case == "aaaaaaaaaaaa" else 4e-4
    rows += [{"case": case, "t_s": t, "quantity": "attitude", "axis": "roll", "unit": "SI", "run_count": RUNS,
              "lincov_true_si": roll} for t in T]  # fmt: skip
    return rows


def _outputs(case: str) -> list[dict[str, Any]]:
    found = []
    for prefix in ("", "raw_", "corrected_"):
        for name, axes, label, factor in (("rate", ("roll", "pitch", "yaw"), "deg/h", 206264.8),
                                          ("acceleration", ("x", "y", "z"), "mg", 1e3 / 9.80665)):  # fmt: skip
            found += [{"case": case, "quantity": prefix + name, "axis": axis, "unit": "SI", "label_unit": label,
                       "label_factor_ratio": factor} for axis in axes]  # fmt: skip
    return found


def _nozzle(case: str) -> list[dict[str, Any]]:
    rows = []
    for run in range(RUNS):
        wind = 1.0 + 0.1 * run
        for axis, less in (("pitch", LESS), ("yaw", 0.5 * LESS)):
            for feed, part in (("raw", 1.0), ("filtered", 1.0 - less), ("true", 0.1)):
                rows += [{"case": case, "controller_rate": feed, "run_number": run, "burn": burn, "axis": axis,
                          "travel_rad": share * wind * part}
                         for burn, share in (("flight", 1.0), ("burn 1", 0.6))]  # fmt: skip
    return rows


def _movement(case: str) -> list[dict[str, Any]]:
    return [{"case": case, "t_s": t, "controller_rate": feed, "axis": axis, "mean_rad": part * t,
             "minimum_rad": 0.9 * part * t, "maximum_rad": 1.1 * part * t}
            for feed, part in (("raw", 0.01), ("filtered", 0.003))
            for axis in ("pitch", "yaw") for t in T]  # fmt: skip


def _turning(case: str) -> list[dict[str, Any]]:
    return [{"case": case, "controller_rate": feed, "axis": axis, "phase": "burn", "tick_count": 1000,
             "angular_acceleration_inside_ratio": 0.99, "jerk_inside_ratio": 1.0,
             "angular_acceleration_peak_ratio": 2.0, "jerk_peak_ratio": 0.5, "attitude_error_rad": 1e-3,
             "rate_error_rad_per_s": 1e-4,
             "rate_sigma_rad_per_s": 1.2e-4}
            for feed in ("raw", "filtered", "true") for axis in ("pitch", "yaw")]  # fmt: skip


def _consistency(case: str) -> list[dict[str, Any]]:
    return [{"case": case, "t_s": t} for t in T]


def _motion(case: str) -> list[dict[str, Any]]:
    return [{"case": case, "t_s": t, "axis": axis, "angular_acceleration_rad_per_s2": 0.01,
             "angular_acceleration_envelope_rad_per_s2": 0.02, "jerk_m_per_s3": -5.0,
             "jerk_envelope_m_per_s3": 10.0} for axis in ("pitch", "yaw") for t in T]  # fmt: skip


def _observability(case: str) -> list[dict[str, Any]]:
    reported = (
        (1e4, "+1.00 rate roll"),
        (0.5, "+1.00 position bias x, -0.80 position north"),
        (2e-3, "+1.00 gyro bias x"),
    )
    return [{"case": case, "phase": f"{start:g} s to {start + 50:g} s", "t_s": start, "t_end_s": start + 50.0,
             "measurement_count": 9, "state_count": 3, "rank_count": 2, "tolerance_ratio": 1e-2, "singular_number": k,
             "singular_ratio": value, "weakest_direction": reported[-1][1], "direction": text}
            for start in (0.0, 50.0) for k, (value, text) in enumerate(reported, 1)]  # fmt: skip


def tables() -> Tables:
    """Return the tables of two cases."""
    makers = {"outputs": _outputs, "history": _history, "nozzle_travel": _nozzle, "nozzle_travel_history": _movement,
              "motion_statistics": _turning, "motion_history": _motion, "observability": _observability,
              "consistency": _consistency}  # fmt: skip
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in ("cases", "events", *makers)}
    for case, axes in CASES.items():
        label = ", ".join(axes.values())
        rows["cases"].append({"case": case, "label": label, "axes": json.dumps(axes), "run_count": RUNS})
        events = (("liftoff", 0.0), ("stage1_cutoff", 60.0), ("injection", 100.0))
        rows["events"] += [{"case": case, "event": name, "kind": "event", "t_s": t, "t_end_s": t} for name, t in events]
        for name, make in makers.items():
            rows[name] += make(case)
    found = Tables.from_arrow({name: _table(name, some) for name, some in rows.items()})
    found.__dict__["campaign"] = {"references": REFERENCES}
    return found
