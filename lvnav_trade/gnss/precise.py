"""Precise orbits of SP3 files: positions and clocks of satellites at even times, and their interpolation.

The Extended Standard Product 3 Orbit Format, versions a to d (S. Hilla, NOAA, 2016).
"""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lvnav_trade.gnss.navigation_lines import NumberBounds, number, read_lines
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.input_files import decimal, whole
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.times import GPS_ORIGIN

NODES = 10
"""Nodes of an interpolation polynomial: ninth degree, accurate to a centimetre between nodes of 15 minutes."""
_MARGIN = NODES // 2  # nodes required before and after lift-off
_KM, _MICROSECONDS = NumberBounds(-1e6, 1e6), NumberBounds(-1e6, 1e6)
_NO_CLOCK = 999999.0  # microseconds and more: unknown
_TIMES = {"GPS", "GAL", "QZS", "ccc", ""}  # time systems that agree with GPS time to some tens of nanoseconds


class PreciseFile(NamedTuple):
    """Contents of a file.

    t : (n_node,) s of GPS time. Nodes.
    r_e : By satellite (n_node, 3) m, frame e. Positions; NaN if missing.
    clock : By satellite (n_node,) s. Clock offsets; NaN if missing.
    """

    t: Floats
    r_e: dict[str, Floats]
    clock: dict[str, Floats]


class PreciseEphemerides(NamedTuple):
    """Satellites at evenly spaced nodes.

    Positions are those of the centres of mass, as in the file. Antennas are a metre or two closer to the Earth.

    names : (n_sat,). Names of the satellites.
    systems : (n_sat,). Letters of their systems.
    t : (n_node,) s since a reference time.
    r_e : (n_node, n_sat, 3) m, frame e.
    clocks : (n_node, n_sat) s.
    """

    names: tuple[str, ...]
    systems: tuple[str, ...]
    t: Floats
    r_e: Floats
    clocks: Floats

    def ecef(self, t: Floats) -> tuple[Floats, Floats]:
        """Return position (m) and Earth-relative velocity (m/s), (..., n_sat, 3) each, in the Earth-fixed axes of t.

        InputError for times outside the nodes.
        """
        first, off = self._place(t)
        which = np.arange(len(self.names))
        values, slopes = _polynomials()
        r_e, v_e = np.zeros((*off.shape, 3)), np.zeros((*off.shape, 3))
        for node in range(NODES):
            place = self.r_e[first + node, which]
            r_e += place * np.polyval(values[node], off)[..., None]
            v_e += place * np.polyval(slopes[node], off)[..., None]
        return r_e, v_e / (self.t[1] - self.t[0])

    def clock(self, t: Floats) -> Floats:
        """Return the clock offsets, linear between nodes, (..., n_sat) s, without the relativistic term."""
        step = self.t[1] - self.t[0]
        at = np.broadcast_to((t - self.t[0]) / step, np.broadcast_shapes(np.shape(t), (len(self.names),)))
        below = np.clip(np.floor(at).astype(int), 0, self.t.size - 2)
        which = np.arange(len(self.names))
        share = at - below
        return np.asarray((1.0 - share) * self.clocks[below, which] + share * self.clocks[below + 1, which])

    def relativity(self, t: Floats) -> Floats:
        """Return the relativistic clock term -2 r.v / c^2, (..., n_sat) s, which SP3 clocks do not contain."""
        r_e, v_e = self.ecef(t)
        # r.v is the same in rotating axes
        return np.asarray(-2.0 * np.sum(r_e * v_e, axis=-1) / SPEED_OF_LIGHT**2)

    def _place(self, t: Floats) -> tuple[np.ndarray, Floats]:
        """Return the first node of the polynomial at each time, and the time from its centre in steps."""
        at = (np.asarray(t, dtype=float) - self.t[0]) / (self.t[1] - self.t[0])
        at = np.broadcast_to(at, np.broadcast_shapes(at.shape, (len(self.names),)))
        if at.size and not (-1e-9 <= at.min() and at.max() <= self.t.size - 1 + 1e-9):
            raise InputError(
                f"orbits: the flight goes beyond them, {self.t[0]:g} to {self.t[-1]:g} s from its lift-off"
            )
        first = np.clip(np.floor(at).astype(int) - NODES // 2 + 1, 0, self.t.size - NODES)
        return first, at - first - 0.5 * (NODES - 1)


@lru_cache(maxsize=1)
def _polynomials() -> tuple[Floats, Floats]:
    """Return the coefficients (by rows) of the Lagrange polynomials for unit steps about zero, and of derivatives."""
    at = np.arange(NODES) - 0.5 * (NODES - 1)
    values = []
    for k in range(NODES):
        others = np.delete(at, k)
        values.append(np.poly(others) / np.prod(at[k] - others))
    return np.array(values), np.array([np.polyder(polynomial) for polynomial in values])


def read_positions(path: str | Path) -> PreciseFile:
    """Return the contents of a file; InputError ``file:line: what`` if it is no SP3 file or a number is invalid."""
    lines = read_lines(path, "SP3 file")
    if not lines or lines[0][:1] != "#" or lines[0][1:2] not in "abcd":
        raise InputError(f"{path}:1: not an SP3 file of version a to d")
    system = next((line[9:12].strip() for line in lines if line.startswith("%c")), "")
    if system not in _TIMES:
        raise InputError(f"{path}: times are of {system}; GPS or Galileo time is read")
    times: list[float] = []
    nodes: dict[str, dict[float, tuple[list[float], float]]] = {}
    for at, line in enumerate(lines, 1):
        if line.startswith("* "):
            times.append(_time(f"{path}:{at}", line))
        elif line.startswith("P") and times:
            name = f"{line[1:2].strip() or 'G'}{line[2:4].strip():0>2}"
            x, y, z, clock = (_number(f"{path}:{at}", line, k) for k in range(4))
            nodes.setdefault(name, {})[times[-1]] = ([1e3 * x, 1e3 * y, 1e3 * z], clock)
    t = np.array(times)
    if t.size < 2 * _MARGIN or np.ptp(np.diff(t)) > 1e-6 or t[1] <= t[0]:
        raise InputError(f"{path}: {t.size} epochs; at least {2 * _MARGIN} are needed, evenly spaced")
    missing = ([0.0, 0.0, 0.0], math.nan)
    rows = {name: [places.get(time, missing) for time in times] for name, places in nodes.items()}
    return PreciseFile(
        t,
        {
            name: np.array([place if any(place) else [math.nan] * 3 for place, _ in places])
            for name, places in rows.items()
        },
        {name: np.array([clock for _, clock in places]) for name, places in rows.items()},
    )


def _number(where: str, line: str, k: int) -> float:
    """Return the k-th number of a position line: x, y, z (km), clock (s, NaN if unknown)."""
    value = number(where, line[4 + 14 * k : 18 + 14 * k], _MICROSECONDS if k == 3 else _KM)
    if k < 3:
        return value
    return math.nan if value >= _NO_CLOCK else 1e-6 * value


def _time(where: str, line: str) -> float:
    try:
        year, month, day, hour, minute = map(whole, line[1:].split()[:5])
        seconds = decimal(line.split()[6])
        return (datetime(year, month, day, hour, minute, tzinfo=UTC) - GPS_ORIGIN).total_seconds() + seconds
    except (ValueError, IndexError, OverflowError):
        raise InputError(f"{where}: not a time of an SP3 file") from None


def precise(files: Sequence[PreciseFile], names: Sequence[str], reference: float) -> PreciseEphemerides:
    """Return the satellites with position and clock at every node near a reference time.

    Parameters
    ----------
    files : sequence of PreciseFile
        Files that follow one another.
    names : sequence of str
        Satellites to consider.
    reference : float
        Reference time (s of GPS time), from which the times of the result count.

    Raises
    ------
    InputError
        The nodes of the files are not evenly spaced, the reference is near their ends, or there is no satellite.
    """
    files = sorted(files, key=lambda file: file.t[0])
    t = np.concatenate([file.t for file in files])
    t, kept = np.unique(t, return_index=True)
    steps = np.diff(t)
    if np.ptp(steps) > 1e-6:
        raise InputError("the files are not consecutive with equal steps")
    at = (reference - t[0]) / steps[0]
    if not _MARGIN - 1 <= at <= t.size - _MARGIN:
        raise InputError(f"the lift-off needs {_MARGIN} epochs before it and behind it; it is at epoch {at:.1f}")
    near = slice(max(0, int(at) - NODES), int(at) + 2 * NODES)
    r_e, clocks, taken = [], [], []
    for name in names:
        place = np.concatenate([file.r_e.get(name, np.full((file.t.size, 3), np.nan)) for file in files])[kept][near]
        ahead = np.concatenate([file.clock.get(name, np.full(file.t.size, np.nan)) for file in files])[kept][near]
        if np.isfinite(place).all() and np.isfinite(ahead).all():
            taken.append(name)
            r_e.append(place)
            clocks.append(ahead)
    if not taken:
        raise InputError("no satellite has position and clock at every epoch near the lift-off")
    shown = tuple(taken), tuple(name[0] for name in taken)
    return PreciseEphemerides(*shown, t[near] - reference, np.stack(r_e, axis=1), np.stack(clocks, axis=1))
