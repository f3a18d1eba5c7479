"""How far broadcast orbits depart from later ones of the same satellite, and how they jump; behind decision 0012.

Run as ``python docs/design/ephemeris_age.py FILE`` with a RINEX 2 or 3 navigation file: prints a table, takes a second.
"""

from __future__ import annotations

import sys

import numpy as np

from lvnav_trade.gnss.broadcast import broadcast_ephemerides, integrated_states
from lvnav_trade.gnss.rinex import Ephemeris, StateVector, read_navigation

HOURS = (0.5, 1.0, 2.0, 4.0, 6.0)


def position(item: Ephemeris | StateVector, time: float) -> np.ndarray:
    """Return the position (3,) m of one record at a time (s of GPS time)."""
    above = broadcast_ephemerides([item], time) if isinstance(item, Ephemeris) else integrated_states([item], time)
    return above.ecef(np.zeros(1))[0][0]


def main(path: str) -> None:
    """Print both tables for every system of the file."""
    file = read_navigation(path)
    items = [item for item in (*file.ephemerides, *file.states) if item.health == 0.0]
    times = {(item.name, item.toe if isinstance(item, Ephemeris) else item.time): item for item in items}
    print("system  RMS distance (m) to the broadcast whose reference time it is, by age; jump half way (RMS, most)")
    for letter in sorted({name[0] for name, _ in times}):
        own = {key: item for key, item in times.items() if key[0][0] == letter}
        row = []
        for hours in HOURS:
            pairs = [(item, own.get((name, time + 3600.0 * hours)), time) for (name, time), item in own.items()]
            gaps = [
                np.linalg.norm(position(item, time + 3600.0 * hours) - position(later, time + 3600.0 * hours))
                for item, later, time in pairs
                if later is not None
            ]
            row.append(f"{hours:g} h: {np.sqrt(np.mean(np.square(gaps))):.2f}" if gaps else f"{hours:g} h: -")
        jumps = []
        for (name, time), item in own.items():
            after = [other for other_name, other in own if other_name == name and 0.0 < other - time <= 7200.0]
            if after:
                middle = 0.5 * (time + min(after))
                jumps.append(np.linalg.norm(position(item, middle) - position(own[name, min(after)], middle)))
        print(f"{letter}  {'  '.join(row)}  jump: {np.sqrt(np.mean(np.square(jumps))):.2f}, {max(jumps):.2f}")


if __name__ == "__main__":
    main(sys.argv[1])
