"""Write configs/trajectories/example_table.csv: rows of the shipped two-stage ascent, as a user's own file would be.

Run: python docs/design/example_table.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from ruamel.yaml import YAML

from lvnav_trade.quantities.frames import earth_angle, earth_velocity, ecef_from_eci, geodetic_from_ecef, rotation_i_n
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.flight import build, motion

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
RATE = 2.0  # Hz


def lines() -> list[str]:
    """Return the lines of the file."""
    settings = YAML(typ="safe").load((CONFIGS / "trajectories/two_stage_leo.yaml").read_text())
    settings["vehicle"] = YAML(typ="safe").load((CONFIGS / f"{settings['vehicle']}.yaml").read_text())
    flight = build(VehicleAscent.model_validate(settings))
    m = motion(flight, np.arange(0.0, np.floor(flight.end * RATE) + 1.0) / RATE)
    theta = earth_angle(flight.theta0, m.t)
    latitude, longitude, height = geodetic_from_ecef(ecef_from_eci(m.r_i, theta))
    v_n = np.einsum("kij,kj->ki", rotation_i_n(m.r_i, theta), earth_velocity(m.r_i, m.v_i))
    rows = zip(m.t, np.degrees(latitude), np.degrees(longitude), height, v_n, m.q_b_i, strict=True)
    return [
        "# The two-stage ascent of this folder as rows of a file, 2 Hz: docs/design/example_table.py made it.",
        "time_s,latitude_deg,longitude_deg,height_m,north_m_s,east_m_s,down_m_s,q0,q1,q2,q3",
        *(
            f"{t:.1f},{lat:.9f},{lon:.9f},{h:.4f},{','.join(f'{x:.5f}' for x in v)},{','.join(f'{x:.9f}' for x in q)}"
            for t, lat, lon, h, v, q in rows
        ),
    ]


def main() -> None:
    """Write the file and print the events for its card."""
    (CONFIGS / "trajectories/example_table.csv").write_text("\n".join(lines()) + "\n")
    settings = YAML(typ="safe").load((CONFIGS / "trajectories/two_stage_leo.yaml").read_text())
    settings["vehicle"] = YAML(typ="safe").load((CONFIGS / f"{settings['vehicle']}.yaml").read_text())
    flight = build(VehicleAscent.model_validate(settings))
    print({name: f"{time:.4f} s" for name, time in flight.events.items()})


if __name__ == "__main__":
    main()
