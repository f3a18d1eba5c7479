"""Write configs/trajectories/landing_approach.csv: glide, flare and touch-down of a winged vehicle at the sea.

Speed and path angle over time are closed forms; the path is their integral, which ends at the threshold of the runway.

Run: python docs/design/landing_approach.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from lvnav_trade.kernels.earth import ECCENTRICITY_2, SEMI_MAJOR

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
RATE = 4.0  # Hz
RUNWAY = np.radians(13.72), np.radians(80.23)  # latitude, longitude of the touch-down
HEADING = np.radians(20.0)
GLIDE, FLARE, ROUND_OUT = 147.0, 12.0, 13.0  # s
STEEP, SHALLOW = np.radians(-20.0), np.radians(-1.5)  # path angle of the glide, at touch-down
FAST, SLOW = 150.0, 97.0  # m/s, of the glide, at touch-down
END = GLIDE + FLARE + ROUND_OUT


def blend(t: float, start: float, length: float) -> float:
    """Return 0 before an interval, 1 after it, and half a cosine between."""
    return 0.5 - 0.5 * np.cos(np.pi * np.clip((t - start) / length, 0.0, 1.0))


def velocity(t: float) -> np.ndarray:
    """Return the velocity to the north, the east and down, m/s."""
    speed = FAST + (SLOW - FAST) * blend(t, GLIDE, FLARE + ROUND_OUT)
    path = STEEP + (SHALLOW - STEEP) * blend(t, GLIDE, FLARE)
    return speed * np.array([np.cos(path) * np.cos(HEADING), np.cos(path) * np.sin(HEADING), -np.sin(path)])


def slope(t: float, place: np.ndarray) -> np.ndarray:
    """Return the rates of latitude, longitude (rad/s) and height (m/s) on the ellipsoid."""
    north, east, down = velocity(t)
    latitude, _, height = place
    root = 1.0 - ECCENTRICITY_2 * np.sin(latitude) ** 2
    meridian, across = SEMI_MAJOR * (1.0 - ECCENTRICITY_2) / root**1.5, SEMI_MAJOR / np.sqrt(root)
    return np.array([north / (meridian + height), east / ((across + height) * np.cos(latitude)), -down])


def lines() -> list[str]:
    """Return the lines of the file."""
    t = np.arange(0.0, END * RATE + 0.5) / RATE
    backwards = solve_ivp(slope, (END, 0.0), [*RUNWAY, 0.0], "DOP853", t[::-1], rtol=1e-13, atol=1e-12)
    rows = zip(t, backwards.y[:, ::-1].T, (velocity(one) for one in t), strict=True)
    return [
        "# Approach of a winged vehicle to a runway, 4 Hz: docs/design/landing_approach.py made it.",
        "time_s,latitude_deg,longitude_deg,height_m,north_m_s,east_m_s,down_m_s",
        *(
            f"{time:.2f},{np.degrees(place[0]):.10f},{np.degrees(place[1]):.10f},{place[2]:.5f},"
            f"{','.join(f'{x:.6f}' for x in v)}"
            for time, place, v in rows
        ),
    ]


def main() -> None:
    """Write the file."""
    (CONFIGS / "trajectories/landing_approach.csv").write_text("\n".join(lines()) + "\n")


if __name__ == "__main__":
    main()
