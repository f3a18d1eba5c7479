"""Write configs/receivers/l1_recorded.csv: errors of a receiver over an ascent, as a user's recording would hold them.

Run: python docs/design/recorded_receiver.py. Ranges of the satellites in view of the shipped two-stage ascent get
slowly varying errors (multipath and what corrections leave, 60 s) and errors of half a second (the loops), and a least
squares over the satellites of every epoch makes errors of position and velocity of them: errors that follow the
geometry, jump where a satellite comes or goes, and last. No engine of the tool draws them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.gnss.visibility import sky
from lvnav_trade.quantities.frames import earth_angle, rotation_i_n
from lvnav_trade.trajectory.flight import build, motion

FILE = Path(__file__).resolve().parents[2] / "configs/receivers/l1_recorded.csv"
SLOW, SLOW_TIME, FAST = 3.0, 60.0, 0.4  # m, s, m
SLOW_RATE, FAST_RATE = 0.03, 0.02  # m/s
SEED = 20261121


def rows() -> np.ndarray:
    """Return time (s since lift-off) and errors of position (m) and velocity (m/s), north, east, down, (n, 7)."""
    base = load(campaign_file("campaigns/smoke.yaml"), ()).base
    flight = build(base.trajectory)
    t = np.arange(np.floor(flight.start), np.ceil(flight.end) + 1.0)  # the flight, and what is left of its last second
    inside = np.clip(t, flight.start, flight.end)
    seen = sky(base.constellation, base.receiver, flight, inside)
    at = motion(flight, inside)
    line = seen.r_i - at.r_i[:, None, :]
    line /= np.linalg.norm(line, axis=2, keepdims=True)
    axes = rotation_i_n(at.r_i, earth_angle(flight.theta0, inside))
    line = np.einsum("nij,nsj->nsi", axes, line)
    draw, n_sat = np.random.default_rng(SEED), len(seen.names)
    fade = np.exp(-1.0 / SLOW_TIME)
    slow = draw.standard_normal((2, n_sat)) * np.array([[SLOW], [SLOW_RATE]])
    found = np.zeros((t.size, 7))
    for k, time in enumerate(t):
        drive = draw.standard_normal((2, 2, n_sat))
        slow = fade * slow + np.sqrt(1.0 - fade**2) * drive[0] * np.array([[SLOW], [SLOW_RATE]])
        errors = slow + drive[1] * np.array([[FAST], [FAST_RATE]])
        on = seen.is_tracked[k]
        design = np.column_stack([-line[k, on], np.ones(np.count_nonzero(on))])
        solved = np.linalg.lstsq(design, errors[:, on].T)[0][:3]
        found[k] = [time, *solved[:, 0], *solved[:, 1]]
    return found


def main() -> None:
    """Write the file and print the RMS of its columns."""
    table = rows()
    lines = [
        "# Errors of a receiver over the two-stage ascent, 1 Hz: docs/design/recorded_receiver.py made them.",
        "time_s,north_m,east_m,down_m,north_m_s,east_m_s,down_m_s",
        *(
            f"{row[0]:.0f},{','.join(f'{x:.3f}' for x in row[1:4])},{','.join(f'{x:.5f}' for x in row[4:])}"
            for row in table
        ),
    ]
    FILE.write_text("\n".join(lines) + "\n")
    print(f"{len(table)} rows, RMS {np.sqrt(np.mean(table[:, 1:] ** 2, axis=0)).round(3)}")


if __name__ == "__main__":
    main()
