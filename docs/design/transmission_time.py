"""How far a satellite's position at transmission moves with what a filter does not know; behind decision 0003.

Run as ``python docs/design/transmission_time.py``: prints a table, takes a second.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML

from lvnav_trade.gnss.constellation import NominalConstellation, orbits
from lvnav_trade.gnss.visibility import satellite_inertial, transmission
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.quantities.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, gmst

CARD = Path(__file__).resolve().parents[2] / "configs/constellations/gps_24.yaml"
EPOCH = "2026-08-01T12:00:00Z"
INJECTION_SPEED = 7700.0  # m/s, relative to the inertial frame, at 350 km


def main() -> None:
    """Print by how much the satellites, and the ranges to them, move for each cause."""
    orbit = orbits(NominalConstellation(**YAML(typ="safe").load(CARD)), EPOCH)
    t, theta0 = np.arange(0.0, 86400.0, 300.0), gmst(EPOCH)
    here = eci_from_ecef(ecef_from_geodetic(math.radians(-38.6), math.radians(-62.0), 0.0), earth_angle(theta0, t))
    true = transmission(orbit, theta0, t, here)
    line = true.r_i - here[:, None, :]
    direction = line / np.linalg.norm(line, axis=-1, keepdims=True)

    def report(cause: str, r_i: np.ndarray) -> None:
        moved = r_i - true.r_i
        along = np.abs(np.sum(moved * direction, axis=-1)).max()
        print(f"{cause:60s} {1e3 * np.linalg.norm(moved, axis=-1).max():10.4f} {1e3 * along:10.4f}")

    print(f"{'largest over a day and all satellites, mm':60s} {'satellite':>10s} {'range':>10s}")
    for length in (10.0, 1e3, 1e4):
        error = np.random.default_rng(3).standard_normal((t.size, 3))
        error *= length / np.linalg.norm(error, axis=1, keepdims=True)
        report(f"light time from a position wrong by {length:g} m", transmission(orbit, theta0, t, here + error).r_i)
    for what, length in (("noise of 3 x 2 m", 6.0), ("delay of 100 m", 100.0)):
        sent = t[:, None] - true.travel - length / SPEED_OF_LIGHT
        report(f"transmission time from pseudorange: {what}", satellite_inertial(orbit, theta0, sent)[0])
    print("epochs marked by a receiver clock that is wrong by 300 m (1 us): the vehicle has moved by ", end="")
    print(f"{1e3 * INJECTION_SPEED * 300.0 / SPEED_OF_LIGHT:.1f} mm at injection")


if __name__ == "__main__":
    main()
