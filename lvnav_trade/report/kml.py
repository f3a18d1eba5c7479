"""A flight as KML, for viewers of the Earth: its path, its events, and ellipses of the position error along it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.quantities.frames import ecef_from_geodetic, geodetic_from_ecef, rotation_e_n
from lvnav_trade.quantities.records import Floats
from lvnav_trade.report.escape import render
from lvnav_trade.results.statistics.probability import outline_of
from lvnav_trade.results.tables.contents import damaged
from lvnav_trade.results.tables.read import Tables

SIGMAS = 3.0
_AXES = ("north", "east", "down")
_CORNERS = 36  # of an ellipse
_COLOURS = ("1f77ff", "b4771f", "2ca02c", "2827d6")  # blue, green, red; one case after the other


class Flight(NamedTuple):
    """What is drawn of a case: its name, the tables `reference` and `events` of it, and the covariance (3, 3) in m^2 of
    the position error, axes north, east, down, at the time (s) of every ellipse.
    """

    name: str
    reference: pd.DataFrame
    events: pd.DataFrame
    ellipses: Mapping[float, Floats] = MappingProxyType({})


def flights(tables: Tables, ellipses: bool, every: float) -> list[Flight]:
    """Return what is drawn of every case in a folder of results.

    ellipses: at the events whose covariance is stored in full, and every `every` seconds of the history, where only the
    sigma of each axis is. InputError where errors are not reported in frame ned.
    """
    if ellipses and not set(_AXES) <= set(tables.history.axis):
        raise InputError(f"{tables.folder}: ellipses need errors that are reported in frame ned")
    found = []
    for case, label in tables.labels.items():
        reference, events = (table[table["case"] == case] for table in (tables.reference, tables.events))
        if reference.empty:
            raise damaged(tables.folder / "reference.parquet", f"no rows of the case {label}")
        found.append(Flight(label or "flight", reference, events, _ellipses(tables, case, every) if ellipses else {}))
    return found


def _ellipses(tables: Tables, case: str, every: float) -> dict[float, Floats]:
    axes, found = list(_AXES), dict[float, Floats]()
    history, whole = (
        frame[(frame["case"] == case) & (frame.quantity == "position")]
        for frame in (tables.history, tables.covariances)
    )
    sigma = history[history.axis.isin(axes)].pivot_table(index="t_s", columns="axis", values="lincov_true_si")
    if len(sigma):
        times = sigma.index.to_numpy()
        wanted = np.arange(times[0], times[-1] + 0.5 * every, every)
        for time in times[np.unique(np.abs(times[:, None] - wanted).argmin(axis=0))]:
            found[float(time)] = np.diag(sigma.loc[time, axes].to_numpy(dtype=float) ** 2)
    for time, rows in whole[whole.source == ""].groupby("t_s"):
        square = rows.pivot_table(index="axis", columns="other_axis", values="true_si2")
        full = square.combine_first(square.T).reindex(index=axes, columns=axes)
        found[float(time)] = full.to_numpy(dtype=float)
    return dict(sorted(found.items()))


def write_kml(file: Path, title: str, drawn: Sequence[Flight], magnify: float = 1.0) -> Path:
    """Write flights as KML 2.2 (see `kml`) and return the file."""
    with writing(file, "cannot be written"):
        file.write_bytes(kml(title, drawn, magnify))
    return file


def kml(title: str, drawn: Sequence[Flight], magnify: float = 1.0) -> bytes:
    """Return flights as KML 2.2.

    The altitude of every coordinate is the height above the ellipsoid, called absolute; viewers count it from their own
    sea level, which is within 110 m of it. Ellipses are 3-sigma, `magnify` times as large; what is drawn is the shadow
    of the ellipsoid on the local horizontal, what is written in its placemark the ellipsoid itself.
    """
    folders = [
        {
            "name": flight.name,
            "colour": colour,
            "path": _coordinates(*(flight.reference[name] for name in ("longitude_rad", "latitude_rad", "altitude_m"))),
            "events": [_event(flight, row.event, float(row.t_s)) for row in flight.events.itertuples(index=False)],
            "ellipses": [_ellipse(flight, *ellipse, magnify) for ellipse in flight.ellipses.items()],
        }
        for flight, colour in zip(drawn, cycle(_COLOURS), strict=False)
    ]
    return render("flight.kml.j2", title=title, flights=folders).encode()


def _coordinates(longitude: ArrayLike, latitude: ArrayLike, height: ArrayLike) -> str:
    """Return longitude, latitude (deg from rad) and height (m) as KML writes them, to a millimetre."""
    rows = np.broadcast(np.degrees(longitude), np.degrees(latitude), height)
    return " ".join(f"{lon:.9f},{lat:.9f},{h:.3f}" for lon, lat, h in rows)


def _at(flight: Flight, time: float) -> pd.Series[float]:
    return flight.reference.iloc[int(np.abs(flight.reference["t_s"].to_numpy(dtype=float) - time).argmin())]


def _event(flight: Flight, name: str, time: float) -> tuple[str, str, str]:
    """Return name, description and place of an event or the start of a fault: time, height, speed over the ground."""
    here = _at(flight, time)
    height, speed = here.altitude_m * 1e-3, here.ground_speed_m_per_s
    said = f"{time:.3f} s, height {height:.3f} km, speed over the ground {speed:.1f} m/s"
    return name, said, _coordinates(here.longitude_rad, here.latitude_rad, here.altitude_m)


def _ellipse(flight: Flight, time: float, covariance: Floats, magnify: float) -> tuple[str, str, str]:
    north, east, down = SIGMAS * np.sqrt(np.diag(covariance))
    sizes = SIGMAS * np.sqrt(np.maximum(np.linalg.eigvalsh(covariance), 0.0))[::-1]
    said = (
        f"3 sigma of position: north {north:.3g} m, east {east:.3g} m, down {down:.3g} m; half axes of the ellipsoid "
        f"{', '.join(f'{size:.3g}' for size in sizes)} m; drawn {magnify:g} times as large"
    )
    here = _at(flight, time)
    seen_from_above = outline_of(covariance[:2, :2], magnify * SIGMAS, _CORNERS + 1)
    off = seen_from_above @ rotation_e_n(here.latitude_rad, here.longitude_rad)[:2]
    r_e = ecef_from_geodetic(here.latitude_rad, here.longitude_rad, here.altitude_m) + off
    latitude, longitude, height = geodetic_from_ecef(r_e)
    return f"3 sigma at {time:.6g} s", said, _coordinates(longitude, latitude, height)
