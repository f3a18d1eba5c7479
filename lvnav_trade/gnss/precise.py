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
from lvnav_trade.quantities.input_files import decimal, integer
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
        first, steps = self._locate(t)
        satellite = np.arange(len(self.names))
        values, slopes = _polynomials()
        r_e = np.zeros((*steps.shape, 3))
        v_e = np.zeros((*steps.shape, 3))
        for node in range(NODES):
            position = self.r_e[first + node, satellite]
            weight = np.polyval(values[node], steps)
            weight_rate = np.polyval(slopes[node], steps)
            r_e += position * weight[..., None]
            v_e += position * weight_rate[..., None]
        spacing = self.t[1] - self.t[0]
        return r_e, v_e / spacing

    def clock(self, t: Floats) -> Floats:
        """Return the clock offsets, linear between nodes, (..., n_sat) s, without the relativistic term."""
        n_sat = len(self.names)
        step = self.t[1] - self.t[0]
        shape = np.broadcast_shapes(np.shape(t), (n_sat,))
        place = np.broadcast_to((t - self.t[0]) / step, shape)
        whole_place = np.floor(place).astype(int)
        node = np.clip(whole_place, 0, self.t.size - 2)
        satellite = np.arange(n_sat)
        fraction = place - node
        node_clock = self.clocks[node, satellite]
        next_clock = self.clocks[node + 1, satellite]
        return np.asarray((1.0 - fraction) * node_clock + fraction * next_clock)

    def relativity(self, t: Floats) -> Floats:
        """Return the relativistic clock term -2 r.v / c^2, (..., n_sat) s, which SP3 clocks do not contain."""
        r_e, v_e = self.ecef(t)
        product = np.sum(r_e * v_e, axis=-1)  # r.v is the same in rotating axes
        return np.asarray(-2.0 * product / SPEED_OF_LIGHT**2)

    def _locate(self, t: Floats) -> tuple[np.ndarray, Floats]:
        """Return the first node of the polynomial at each time, and the time from its centre in steps."""
        spacing = self.t[1] - self.t[0]
        place = (np.asarray(t, dtype=float) - self.t[0]) / spacing
        shape = np.broadcast_shapes(place.shape, (len(self.names),))
        place = np.broadcast_to(place, shape)
        last = self.t.size - 1
        if place.size and not (-1e-9 <= place.min() and place.max() <= last + 1e-9):
            raise InputError(
                f"orbits: the flight goes beyond them, {self.t[0]:g} to {self.t[-1]:g} s from its lift-off"
            )
        node = np.floor(place).astype(int)
        first = np.clip(node - NODES // 2 + 1, 0, self.t.size - NODES)
        centre = 0.5 * (NODES - 1)
        from_centre = place - first - centre
        return first, from_centre


@lru_cache(maxsize=1)
def _polynomials() -> tuple[Floats, Floats]:
    """Return the coefficients (by rows) of the Lagrange polynomials for unit steps about zero, and of derivatives."""
    nodes = np.arange(NODES) - 0.5 * (NODES - 1)
    values = []
    for k in range(NODES):
        roots = np.delete(nodes, k)
        scale = np.prod(nodes[k] - roots)
        values.append(np.poly(roots) / scale)
    slopes = [np.polyder(polynomial) for polynomial in values]
    return np.array(values), np.array(slopes)


def read_positions(path: str | Path) -> PreciseFile:
    """Return the contents of a file; InputError ``file:line: what`` if it is no SP3 file or a number is invalid."""
    lines = read_lines(path, "SP3 file")
    if not lines or lines[0][:1] != "#" or lines[0][1:2] not in "abcd":
        raise InputError(f"{path}:1: not an SP3 file of version a to d")
    _check_time_system(path, lines)
    times: list[float] = []
    nodes: dict[str, dict[float, _Node]] = {}
    for line_number, line in enumerate(lines, 1):
        where = f"{path}:{line_number}"
        if line.startswith("* "):
            times.append(_time(where, line))
        elif line.startswith("P") and times:
            system = line[1:2].strip() or "G"
            name = f"{system}{line[2:4].strip():0>2}"
            nodes.setdefault(name, {})[times[-1]] = _read_node(where, line)
    t = np.array(times)
    fewest = 2 * _MARGIN
    if t.size < fewest or np.ptp(np.diff(t)) > 1e-6 or t[1] <= t[0]:
        raise InputError(f"{path}: {t.size} epochs; at least {fewest} are needed, evenly spaced")
    r_e = {}
    clock = {}
    for name, satellite_nodes in nodes.items():
        series = [satellite_nodes.get(time, _MISSING) for time in times]
        r_e[name] = np.array([node.r_e for node in series])
        clock[name] = np.array([node.clock for node in series])
    return PreciseFile(t, r_e, clock)


class _Node(NamedTuple):
    """State of a satellite at a node.

    r_e : m. Position, frame e; NaN if missing.
    clock : s. Clock offset; NaN if missing.
    """

    r_e: tuple[float, float, float]
    clock: float


_MISSING = _Node((math.nan, math.nan, math.nan), math.nan)


def _read_node(where: str, line: str) -> _Node:
    """Return the numbers of a position line; a position of zeros is missing."""
    x, y, z, clock = (_number(where, line, k) for k in range(4))
    if x == y == z == 0.0:
        return _Node(_MISSING.r_e, clock)
    position = (1e3 * x, 1e3 * y, 1e3 * z)
    return _Node(position, clock)


def _check_time_system(path: str | Path, lines: list[str]) -> None:
    """Raise InputError if the first line %c names a time system other than those that agree with GPS time."""
    for line in lines:
        if line.startswith("%c"):
            system = line[9:12].strip()
            if system not in _TIMES:
                raise InputError(f"{path}: times are of {system}; GPS or Galileo time is read")
            return


def _number(where: str, line: str, k: int) -> float:
    """Return a number of a position line: x, y, z (km), or clock (s, NaN if unknown).

    Parameters
    ----------
    where : str
        File and line, for messages.
    line : str
        The line.
    k : int
        Index of the number: 0 to 2 position, 3 clock.

    Raises
    ------
    InputError
        The text is not a number, or the number is impossible.
    """
    start = 4 + 14 * k
    text = line[start : start + 14]
    value = number(where, text, _MICROSECONDS if k == 3 else _KM)
    if k < 3:
        return value
    return math.nan if value >= _NO_CLOCK else 1e-6 * value


def _time(where: str, line: str) -> float:
    """Return the time of an epoch line, s of GPS time."""
    words = line[1:].split()
    try:
        year, month, day, hour, minute = map(integer, words[:5])
        seconds = decimal(words[5])
        moment = datetime(year, month, day, hour, minute, tzinfo=UTC)
        gps_time = moment - GPS_ORIGIN
        return gps_time.total_seconds() + seconds
    except (ValueError, IndexError, OverflowError):
        raise InputError(f"{where}: not a time of an SP3 file") from None


def precise_ephemerides(files: Sequence[PreciseFile], names: Sequence[str], reference: float) -> PreciseEphemerides:
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
    all_times = np.concatenate([file.t for file in files])
    t, first_of_equal = np.unique(all_times, return_index=True)  # consecutive files may share a node
    steps = np.diff(t)
    if np.ptp(steps) > 1e-6:
        raise InputError("the files are not consecutive with equal steps")
    place = (reference - t[0]) / steps[0]
    if not _MARGIN - 1 <= place <= t.size - _MARGIN:
        raise InputError(f"the lift-off needs {_MARGIN} epochs before it and behind it; it is at epoch {place:.1f}")
    node = int(place)
    nearby_nodes = slice(max(0, node - NODES), node + 2 * NODES)
    nodes = first_of_equal[nearby_nodes]
    complete_names = []
    positions = []
    clocks = []
    for name in names:
        file_positions = []
        file_clocks = []
        for file in files:
            n_node = file.t.size
            file_positions.append(file.r_e.get(name, np.full((n_node, 3), np.nan)))
            file_clocks.append(file.clock.get(name, np.full(n_node, np.nan)))
        position = np.concatenate(file_positions)[nodes]
        clock = np.concatenate(file_clocks)[nodes]
        if np.isfinite(position).all() and np.isfinite(clock).all():
            complete_names.append(name)
            positions.append(position)
            clocks.append(clock)
    if not complete_names:
        raise InputError("no satellite has position and clock at every epoch near the lift-off")
    return PreciseEphemerides(
        names=tuple(complete_names),
        systems=tuple(name[0] for name in complete_names),
        t=t[nearby_nodes] - reference,
        r_e=np.stack(positions, axis=1),
        clocks=np.stack(clocks, axis=1),
    )
