"""Small campaigns that combine filters, measurements, delays, sensors and faults; as a script it runs those named.

Every combination is laid over COMMON, key by key. The nine runs are a block of eight lanes and one run by itself.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

COMMON: dict[str, Any] = {
    "seed": 1,
    "base": {
        "trajectory": {"card": "trajectories/two_stage_leo", "pad_hold": "2 s"},
        "imu": {"card": "imu/tactical_fog_matched", "rate": "20 Hz"},
        "constellation": "constellations/gps_24",
        "receiver": "receivers/l1_two_metre",
        "filter": "filters/tight",
        "initial": {"tilt": "0.1 deg", "heading": "0.05 deg", "position": "1 m", "velocity": "0.01 m/s"},
    },
    "monte_carlo": {"runs": 9, "block": 16},
    "keep": {"history": "20 s"},
}
_FROM = {"start": "stage1_cutoff", "duration": "30 s"}
_RANGE_FAULTS: list[list[dict[str, Any]]] = [
    [{"kind": "range_bias", "size": "50 m", "drift": "1 m/s", **_FROM}],
    [{"kind": "clock_jump", "size": "100 m", "start": "stage1_cutoff"}],
]
_FAULTS: list[list[dict[str, Any]]] = [
    [],
    [{"kind": "satellite_outage", "keep": 0, **_FROM}],
    [{"kind": "antenna_failure", "antennas": [1, 3, 4], **_FROM}],
    [{"kind": "degraded_noise", "factor": 5, **_FROM}],
    *_RANGE_FAULTS,
    [{"kind": "latency_change", "by": "20 ms", **_FROM}],
    [{"kind": "gyro_bias_step", "size": ["20 deg/h"] * 3, **_FROM}],
    [{"kind": "accel_bias_step", "size": ["5 mg"] * 3, **_FROM}],
    [{"kind": "dropped_samples", "instead": "last", "start": "stage2_ignition + 5 s", "duration": "1 s"}],
]
_SOLUTION_FAULTS: list[list[dict[str, Any]]] = [
    [{"kind": "wild_samples", "sigma": "50 m", **_FROM}],
    [{"kind": "frozen_output", "start": "stage1_cutoff", "duration": "3 s"}],
]
_LATE = {
    "card": "receivers/l1_two_metre",
    "latency": "100 ms",
    "latency_per_satellite": "10 ms",
    "latency_error": "1 ms",
}
_FILTERED = {"kind": "filtered", "range_sigma": "2 m", "rate_sigma": "0.1 m/s", "clock_noise": "0.005 m/s^2"}
_RECOVERY = {
    "trajectory": "trajectories/recovery_polar",
    "imu": {"card": "imu/navigation", "rate": "20 Hz"},
    "receiver": "receivers/gains_004",
    "initial": {"tilt": "0.02 deg", "heading": "0.02 deg", "position": "100 m", "velocity": "0.5 m/s"},
}
_VEHICLE = {
    "imu": {"card": "imu/kvh1750_003", "rate": "20 Hz"},
    "receiver": "receivers/wide_correlator_003",
    "filter": "filters/vehicle_model_003",
    "sensors": {"attitude_reference": "attitude_references/magnetometer_003"},
    "initial": {"tilt": "1 deg", "heading": "1 deg", "position": "10 m", "velocity": "0.1 m/s"},
}


def _axis(path: str, values: list[Any]) -> list[dict[str, Any]]:
    return [{"path": path, "values": values, "labels": [f"{k}" for k in range(len(values))]}]


CAMPAIGNS: dict[str, dict[str, Any]] = {
    "filters": {
        "axes": _axis("filter", ["filters/tight", "filters/tight_extended", "filters/loose", "filters/inertial"])
    },
    "faults of signals": {"base": {"receiver": "receivers/l1_four_patch"}, "axes": _axis("faults", _FAULTS)},
    "faults of solutions": {
        "base": {"receiver": "receivers/l1_four_patch", "filter": "filters/loose"},
        "axes": _axis("faults", [one for one in _FAULTS if one not in _RANGE_FAULTS] + _SOLUTION_FAULTS),
    },
    "late ranges": {
        "base": {"receiver": _LATE},
        "axes": _axis("filter", [
            "filters/tight",
            {"card": "filters/tight", "extra_states": ["timing"]},
            {"card": "filters/tight", "delay_compensation": {"kind": "buffered"}},
            {"card": "filters/tight_extended", "delay_compensation": {"kind": "buffered", "delay": "90 ms"}},
        ]),
    },
    "late solutions": {
        "base": {"receiver": {"card": "receivers/l1_two_metre", "latency": "100 ms"}},
        "axes": _axis("filter", [
            "filters/loose",
            {"card": "filters/loose", "delay_compensation": {"kind": "buffered"}},
            {"card": "filters/loose", "delay_compensation": {"kind": "extrapolated"}},
        ]),
    },
    "solutions with a reported covariance": {
        "base": {"receiver": "receivers/l1_four_patch", "filter": "filters/loose_conae_000", "frame": "ecef"},
        "axes": _axis("receiver.solution", [
            {"kind": "bancroft", "range_sigma": "2 m", "rate_sigma": "0.1 m/s", "reported": True},
            {**_FILTERED, "jerk": "0.5 m/s^3", "reported": True},
            {**_FILTERED, "acceleration_noise": "2 m/s^2", "reported": True},
        ]),
    },
    "constellations": {
        "axes": _axis("constellation", ["constellations/gps_galileo", "constellations/gps_galileo_glonass"])
    },
    "mode logic and stored gains": {
        "base": _RECOVERY,
        "axes": _axis("filter", ["filters/loose_gains_004", "filters/loose_gains_004_12_by_event"]),
    },
    "altimeter": {
        "base": {
            **_RECOVERY,
            "filter": {"card": "filters/loose", "measurements": ["position", "velocity", "altitude"]},
            "sensors": {"altimeter": "altimeters/radar_004"},
        },
    },
    "samples as measurements": {
        "base": _VEHICLE,
        "axes": _axis("filter", ["filters/vehicle_model_003", "filters/baseline_003", "filters/vehicle_unknown_003"]),
    },
    "policies together": {
        "base": {**_VEHICLE, "receiver": {"card": "receivers/wide_correlator_003", "latency": "1400 ms"}},
        "axes": _axis("filter", [
            {"card": "filters/vehicle_model_003", "delay_compensation": {"kind": "buffered"}},
            {"card": "filters/vehicle_model_003", "delay_compensation": {"kind": "extrapolated"}, "feedback": "open"},
            {"card": "filters/vehicle_model_003", "measurements": ["pseudorange", "range_rate", "attitude", "imu"],
             "delay_compensation": {"kind": "buffered"}, "extra_states": [], "consider": ["gyro_bias"],
             "logic": {"start_after": 3}},
            {"card": "filters/tight", "measurements": ["range_rate", "attitude"], "feedback": "open",
             "delay_compensation": {"kind": "buffered"}},
        ]),
    },
    "vehicle under control": {
        "base": {
            **_VEHICLE,
            "trajectory": "trajectories/churchill_sso",
            "imu": "imu/kvh1750_003",
            "control": {
                "rotation": "rotation/three_motor", "controller": "controllers/three_motor", "wind": "wind/moderate",
            },
        },
    },
}  # fmt: skip


def campaign(name: str) -> dict[str, Any]:
    """Return a combination laid over what all have in common."""
    own = CAMPAIGNS[name]
    return {**COMMON, **own, "name": name.replace(" ", "_"), "base": {**COMMON["base"], **own.get("base", {})}}


if __name__ == "__main__":
    from lvnav_trade import api

    for asked in sys.argv[2:]:
        folder = Path(sys.argv[1]) / asked.replace(" ", "_")
        folder.mkdir(parents=True)
        (folder / "campaign.yaml").write_text(json.dumps(campaign(asked)))
        api.run(folder / "campaign.yaml", folder=folder / "results", jobs=1, report=False)
        sys.stdout.write(f"{asked}\n")
