"""Many designs for tests, with known effects: the error follows one axis and one level, and nothing else."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd

from lvnav_trade.results.tables.read import Tables, load
from tests import synthetic

COUNT = 400
LIMIT = 0.3
REQUIREMENT = {
    "name": "fast",
    "metric": "velocity_error_3d",
    "at": "injection",
    "probability": 0.9973,
    "below": f"{LIMIT!r} m/s",
}
AXES = [
    {"path": "imu.gyro.bias_repeatability", "between": ["0.01 deg/h", "10 deg/h"], "log": True, "values": None},
    {"path": "initial.heading", "between": ["0.01 deg", "1 deg"], "log": True, "values": None},
    {"path": "filter", "between": None, "values": [{"name": "Loose"}, {"name": "Tight"}], "labels": ["loose", "tight"]},
]


def frame(count: int = COUNT, seed: int = 1) -> pd.DataFrame:
    """Return the table of designs: velocity grows with the square root of the gyro's bias and is twice as large for a
    loose filter; the heading has no effect; two designs are impossible.
    """
    rng = np.random.default_rng(seed)
    bias, heading = (10.0 ** rng.uniform(a, b, count) for a, b in ((-2.0, 1.0), (-2.0, 0.0)))
    loose = rng.random(count) < 0.5
    velocity = 0.2 * np.sqrt(bias) * np.where(loose, 2.0, 1.0)
    ratio = velocity / LIMIT
    verdict = np.where(ratio <= 1.0, "met", "violated")
    levels = [
        {"bias_repeatability": f"{b:.6g} deg/h", "heading": f"{h:.6g} deg", "filter": "loose" if one else "tight"}
        for b, h, one in zip(bias, heading, loose, strict=True)
    ]
    found = pd.DataFrame(
        {
            "case": [f"{number:012x}" for number in range(count)],
            "design_number": np.arange(count),
            "label": [", ".join(f"{k}={v}" for k, v in one.items()) for one in levels],
            "axes": [json.dumps(one) for one in levels],
            "reason": "",
            "limiting_requirement": "fast",
            "verdict": verdict,
            "verdicts": [json.dumps({"fast": str(word)}) for word in verdict],
            "axis_bias_repeatability_rad_per_s": np.radians(bias) / 3600.0,
            "axis_heading_rad": np.radians(heading),
            "velocity_m_per_s": velocity / 3.0,
            "position_m": 10.0 * velocity,
            "attitude_rad": 1e-3 * velocity,
            "nees_per_state_ratio": np.where(loose, 4.0, 1.0),
            "fast_quantile_m_per_s": velocity,
            "fast_probability_ratio": 0.5,
            "error_ratio": ratio,
            "cost": np.where(loose, 10.0, 20.0),
        }
    )
    impossible = [3, 5]
    numbers = list(found.select_dtypes("number").columns.drop(["design_number"]))
    found.loc[impossible, numbers] = np.nan
    found.loc[impossible, ["case", "limiting_requirement", "verdict", "verdicts"]] = ""
    found.loc[impossible, "reason"] = "filter: the update rate is above … Hz"
    return found


def tables(folder: Path, count: int = COUNT) -> Tables:
    """Return results of many designs, of which the cases of the synthetic results are analysed whole."""
    found = load(synthetic.results(folder, n_run=8)).with_frames(designs=frame(count))
    campaign = {**found.campaign, "axes": AXES, "requirements": [REQUIREMENT], "design": "latin_hypercube"}
    found.__dict__["campaign"] = campaign | {"samples": count, "store": "metrics"}
    space = {"designs": count, "impossible": {"filter: the update rate is above … Hz": 2}, "whole": {"best": 1}}
    found.__dict__["manifest"] = {**found.manifest, "space": space, "command": ["run", "mine.yaml"]}
    return found


def grid(folder: Path) -> Tables:
    """Return results of a full grid of seven biases, three headings and two filters: the velocity grows with the square
    root of the bias and the tenth root of the heading, and is twice as large for a loose filter.
    """
    sampled = tables(folder, 42)
    found = frame(42)
    bias, heading, loose = (
        values.ravel()
        for values in np.meshgrid(np.geomspace(0.01, 10.0, 7), np.geomspace(0.01, 1.0, 3), [True, False], indexing="ij")
    )
    velocity = 0.2 * bias**0.5 * heading**0.1 * np.where(loose, 2.0, 1.0)
    verdict = np.where(velocity <= LIMIT, "met", "violated")
    found = found.assign(
        case=[f"{number:012x}" for number in range(42)],
        axes=[
            json.dumps(
                {
                    "bias_repeatability": f"{b:.6g} deg/h",
                    "heading": f"{h:.6g} deg",
                    "filter": "loose" if one else "tight",
                }
            )
            for b, h, one in zip(bias, heading, loose, strict=True)
        ],
        reason="",
        limiting_requirement="fast",
        verdict=verdict,
        verdicts=[json.dumps({"fast": str(word)}) for word in verdict],
        axis_bias_repeatability_rad_per_s=np.radians(bias) / 3600.0,
        axis_heading_rad=np.radians(heading),
        fast_quantile_m_per_s=velocity,
        error_ratio=velocity / LIMIT,
    )
    whole = sampled.with_frames(designs=found)
    whole.__dict__["campaign"] = {**sampled.campaign, "design": "grid", "samples": None}
    whole.__dict__["manifest"] = {**sampled.manifest, "space": {"designs": 42, "impossible": {}, "whole": {"best": 1}}}
    return whole
