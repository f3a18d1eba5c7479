"""Files and cards of trajectories of a user's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, eci_from_ecef, gmst
from lvnav_trade.trajectory.files.columns import TableTrajectory
from tests.trajectory.flight_cases import CONFIGS

EPOCH = "2024-03-20T12:00:00Z"
BREAK = 40.0  # s, at which the force of `path` jumps


def example_settings() -> dict[str, Any]:
    """Settings of the shipped example, its file made absolute."""
    settings = YAML(typ="safe").load((CONFIGS / "trajectories/example_table.yaml").read_text())
    settings["file"] = str(CONFIGS / "trajectories" / settings["file"])
    return settings


def path(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return r_i and v_i (n, 3) of a climb from rest with a jump of force at BREAK."""
    theta0 = gmst(EPOCH)
    start = eci_from_ecef(np.array([5.0e6, -3.0e6, 2.6e6]), theta0)
    up, spin = start / np.linalg.norm(start), np.array([0.0, 0.0, 7.292115e-5])
    late = np.maximum(t - BREAK, 0.0)
    rise = 10.0 * t**2 + 0.02 * t**3 - 9.0 * late**2
    speed = 20.0 * t + 0.06 * t**2 - 18.0 * late
    v0 = np.cross(spin, start)
    r = start + np.outer(t, v0) + np.outer(rise, up)
    return r, v0 + np.outer(speed, up)


def write(
    folder: Path,
    columns: dict[str, Sequence[float]] | None = None,
    digits: int = 12,
    name: str = "mine.csv",
    **own: Any,
) -> dict[str, Any]:
    """Write `path` at 2 Hz for 80 s, columns replaced or added, and return settings of its card, some of them `own`."""
    t = np.arange(0.0, 80.25, 0.5)
    r, v = path(t)
    table = {"t": t, **dict(zip("xyz", r.T, strict=True)), **dict(zip(("vx", "vy", "vz"), v.T, strict=True))}
    table |= {key: np.asarray(value) for key, value in (columns or {}).items()}
    file = folder / name
    rows = zip(*table.values(), strict=True)
    lines = [",".join(table), *(",".join(f"{value:.{digits}f}" for value in row) for row in rows)]
    file.write_text("\n".join(lines) + "\n")
    settings = {
        "name": "mine",
        "source": "a test",
        "epoch": EPOCH,
        "file": str(file),
        "time": {"column": "t", "unit": "s"},
        "position": {"frame": "eci", "columns": ["x", "y", "z"], "unit": "m"},
        "velocity": {"frame": "eci", "columns": ["vx", "vy", "vz"], "unit": "m/s"},
        "events": {"cutoff": f"{BREAK} s"},
    }
    return {**settings, **own}


def card(settings: dict[str, Any], **own: Any) -> TableTrajectory:
    """Return the card of settings, some of them changed."""
    return TableTrajectory.model_validate({**settings, **own})


def to_earth(t: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return vectors (n, 3) of frame i in frame e."""
    return ecef_from_eci(vectors, earth_angle(gmst(EPOCH), t))
