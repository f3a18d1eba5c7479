"""A flight as KML, for viewers of the Earth: its path, its events, and ellipses of the position error along it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lvnav_trade.errors import InputError
from lvnav_trade.frames import ecef_from_geodetic, geodetic_from_ecef, rotation_e_n
from lvnav_trade.report.escape import xml_text
from lvnav_trade.store.read import Tables

Floats = NDArray[np.float64]

NAMESPACE = "http://www.opengis.net/kml/2.2"
SIGMAS = 3.0
_AXES = ("north", "east", "down")
_CORNERS = 36  # of an ellipse
_COLOURS = ("ff1f77ff", "ffb4771f", "ff2ca02c", "ff2827d6")  # alpha, blue, green, red; one case after the other


class Flight(NamedTuple):
    """What is drawn of a case: its name, the tables `reference` and `events` of it, and its ellipses."""

    name: str
    reference: pd.DataFrame
    events: pd.DataFrame
    ellipses: tuple[Ellipse, ...] = ()


class Ellipse(NamedTuple):
    """Covariance (3, 3) in m^2 of the position error, axes north, east, down, at a time (s)."""

    time: float
    covariance: Floats


def flights(tables: Tables, ellipses: bool, every: float) -> list[Flight]:
    """Return what is drawn of every case in a folder of results.

    ellipses: at the events whose covariance is stored in full, and every `every` seconds of the history, where only the
    sigma of each axis is. InputError where errors are not reported in frame ned.
    """
    if ellipses and not set(_AXES) <= set(tables.history.axis):
        raise InputError(f"{tables.folder}: ellipses need errors that are reported in frame ned")
    found = []
    for case, label in tables.labels.items():
        reference, events = tables.reference, tables.events
        drawn = _ellipses(tables, case, every) if ellipses else ()
        here = (reference[reference["case"] == case], events[events["case"] == case])
        found.append(Flight(label or "flight", here[0], here[1], drawn))
    return found


def _ellipses(tables: Tables, case: str, every: float) -> tuple[Ellipse, ...]:
    whole = tables.covariances
    whole = whole[(whole["case"] == case) & (whole.quantity == "position") & (whole.source == "")]
    axes = list(_AXES)
    found = {}
    sigma = tables.history
    sigma = sigma[(sigma["case"] == case) & (sigma.quantity == "position") & sigma.axis.isin(axes)]
    table = sigma.pivot_table(index="t_s", columns="axis", values="lincov_true_si")
    if len(table):
        times = table.index.to_numpy()
        wanted = np.arange(times[0], times[-1] + 0.5 * every, every)
        for time in times[np.unique(np.abs(times[:, None] - wanted).argmin(axis=0))]:
            found[float(time)] = np.diag(table.loc[time, axes].to_numpy(dtype=float) ** 2)
    for time, rows in whole.groupby("t_s"):
        square = rows.pivot_table(index="axis", columns="other_axis", values="true_si2")
        full = square.combine_first(square.T).reindex(index=axes, columns=axes).to_numpy(dtype=float)
        found[float(time)] = full
    return tuple(Ellipse(time, found[time]) for time in sorted(found))


def write_kml(file: Path, title: str, drawn: Sequence[Flight], magnify: float = 1.0) -> Path:
    """Write flights as KML 2.2 (see `kml`) and return the file."""
    try:
        file.write_bytes(kml(title, drawn, magnify))
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {error.strerror}") from None
    return file


def kml(title: str, drawn: Sequence[Flight], magnify: float = 1.0) -> bytes:
    """Return flights as KML 2.2.

    The altitude of every coordinate is the height above the ellipsoid, called absolute; viewers count it from their own
    sea level, which is within 110 m of it. Ellipses are 3-sigma, `magnify` times as large; what is drawn is the shadow
    of the ellipsoid on the local horizontal, what is written in its placemark the ellipsoid itself.
    """
    ET.register_namespace("", NAMESPACE)
    root = ET.Element(f"{{{NAMESPACE}}}kml")
    document = _add(root, "Document")
    _add(document, "name", title)
    for number, flight in enumerate(drawn):
        colour = _COLOURS[number % len(_COLOURS)]
        folder = _add(document, "Folder")
        _add(folder, "name", flight.name)
        _path(folder, flight, colour)
        for row in flight.events.itertuples(index=False):
            _event(folder, flight, row)
        for ellipse in flight.ellipses:
            _ellipse(folder, flight, ellipse, magnify, colour)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True))


def _add(parent: ET.Element, tag: str, text: str | None = None) -> ET.Element:
    child = ET.SubElement(parent, f"{{{NAMESPACE}}}{tag}")
    child.text = text if text is None else xml_text(text)
    return child


def _coordinates(longitude: Floats, latitude: Floats, height: Floats) -> str:
    """Return longitude, latitude (deg from rad) and height (m) as KML writes them, to a millimetre."""
    rows = zip(np.degrees(longitude), np.degrees(latitude), height, strict=True)
    return " ".join(f"{lon:.9f},{lat:.9f},{h:.3f}" for lon, lat, h in rows)


def _path(folder: ET.Element, flight: Flight, colour: str) -> None:
    place = _add(folder, "Placemark")
    _add(place, "name", flight.name)
    line = _add(_add(place, "Style"), "LineStyle")
    _add(line, "color", colour)
    _add(line, "width", "3")
    path = _add(place, "LineString")
    _add(path, "altitudeMode", "absolute")
    table = flight.reference
    columns = (table[name].to_numpy(dtype=float) for name in ("longitude_rad", "latitude_rad", "altitude_m"))
    _add(path, "coordinates", _coordinates(*columns))


def _at(flight: Flight, time: float) -> pd.Series[float]:
    """Return the row of the flight that is nearest to a time."""
    table = flight.reference
    return table.iloc[int(np.abs(table["t_s"].to_numpy(dtype=float) - time).argmin())]


def _event(folder: ET.Element, flight: Flight, row: object) -> None:
    """Mark an event or the start of a fault: time, height, speed over the ground."""
    time, name = float(row.t_s), str(row.event)  # type: ignore[attr-defined]
    here = _at(flight, time)
    place = _add(folder, "Placemark")
    _add(place, "name", name)
    _add(
        place,
        "description",
        f"{time:.3f} s, height {here.altitude_m * 1e-3:.3f} km, speed over the ground {here.ground_speed_m_per_s:.1f} "
        f"m/s",
    )
    point = _add(place, "Point")
    _add(point, "altitudeMode", "absolute")
    where = (np.array([here.longitude_rad]), np.array([here.latitude_rad]), np.array([here.altitude_m]))
    _add(point, "coordinates", _coordinates(*where))


def _ellipse(folder: ET.Element, flight: Flight, ellipse: Ellipse, magnify: float, colour: str) -> None:
    here = _at(flight, ellipse.time)
    sizes = SIGMAS * np.sqrt(np.maximum(np.linalg.eigvalsh(ellipse.covariance), 0.0))[::-1]
    along = SIGMAS * np.sqrt(np.diag(ellipse.covariance))
    place = _add(folder, "Placemark")
    _add(place, "name", f"3 sigma at {ellipse.time:.6g} s")
    _add(
        place,
        "description",
        f"3 sigma of position: north {along[0]:.3g} m, east {along[1]:.3g} m, down {along[2]:.3g} m; half axes of the "
        f"ellipsoid {', '.join(f'{size:.3g}' for size in sizes)} m; drawn {magnify:g} times as large",
    )
    style = _add(place, "Style")
    _add(_add(style, "LineStyle"), "color", colour)
    _add(_add(style, "PolyStyle"), "color", "40" + colour[2:])
    polygon = _add(place, "Polygon")
    _add(polygon, "altitudeMode", "absolute")
    ring = _add(_add(polygon, "outerBoundaryIs"), "LinearRing")
    _add(ring, "coordinates", _coordinates(*_shadow(here, ellipse.covariance, magnify)))


def _shadow(here: pd.Series[float], covariance: Floats, magnify: float) -> tuple[Floats, Floats, Floats]:
    """Return longitude, latitude (rad) and height (m) of the ellipsoid's outline from above, closed."""
    value, vector = np.linalg.eigh(covariance[:2, :2])
    angle = np.linspace(0.0, 2.0 * np.pi, _CORNERS + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    flat = magnify * SIGMAS * vector @ (np.sqrt(np.maximum(value, 0.0))[:, None] * circle)
    C_e_n = rotation_e_n(here.latitude_rad, here.longitude_rad)
    r_e = ecef_from_geodetic(here.latitude_rad, here.longitude_rad, here.altitude_m) + flat.T @ C_e_n[:2]
    latitude, longitude, height = geodetic_from_ecef(r_e)
    return longitude, latitude, height
