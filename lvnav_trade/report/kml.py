"""Trajectories as KML for viewers of the Earth: path, events, and position error ellipses."""

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
from lvnav_trade.results.statistics.probability import ellipse_points
from lvnav_trade.results.tables.contents import damaged_file_error
from lvnav_trade.results.tables.read import Tables

SIGMAS = 3.0
_AXES = ("north", "east", "down")
_CORNERS = 36  # points of an ellipse
_COLOURS = ("1f77ff", "b4771f", "2ca02c", "2827d6")  # KML writes blue, green, red; cases use them in turn


class KmlFlight(NamedTuple):
    """The flight of a case as it is drawn.

    name : Label of the case.
    reference : Its rows of the table `reference`.
    events : Its rows of the table `events`.
    ellipses : Covariance of the position error, (3, 3) in m^2, axes north, east, down, by time (s).
    """

    name: str
    reference: pd.DataFrame
    events: pd.DataFrame
    ellipses: Mapping[float, Floats] = MappingProxyType({})


def flights(tables: Tables, ellipses: bool, interval: float) -> list[KmlFlight]:
    """Return the flight of every case in a folder of results.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    ellipses : bool
        Whether to add error ellipses: at the events whose covariance is stored in full, and along the history, which
        stores the sigma of each axis only.
    interval : float
        Interval (s) of the ellipses along the history.

    Raises
    ------
    InputError
        Ellipses are requested, but the errors are not reported in frame ned; or a table lacks a case.
    """
    if ellipses and not set(_AXES) <= set(tables.history.axis):
        raise InputError(f"{tables.folder}: ellipses need errors that are reported in frame ned")
    case_flights = []
    for case, label in tables.labels.items():
        reference = tables.reference[tables.reference["case"] == case]
        if reference.empty:
            raise damaged_file_error(tables.folder / "reference.parquet", f"no rows of the case {label}")
        flight = KmlFlight(
            name=label or "flight",
            reference=reference,
            events=tables.events[tables.events["case"] == case],
            ellipses=_ellipses(tables, case, interval) if ellipses else {},
        )
        case_flights.append(flight)
    return case_flights


def _ellipses(tables: Tables, case: str, interval: float) -> dict[float, Floats]:
    """Return the covariances of the ellipses of a case, (3, 3) in m^2, north, east, down, by time (s).

    interval : interval (s) of the ellipses along the history
    """
    ellipses = _history_ellipses(tables, case, interval) | _event_ellipses(tables, case)
    return dict(sorted(ellipses.items()))


def _history_ellipses(tables: Tables, case: str, interval: float) -> dict[float, Floats]:
    """Return diagonal covariances along the history, at the stored times nearest to multiples of an interval.

    interval : interval (s), counted from the first stored time
    """
    axes = list(_AXES)
    rows = tables.history
    is_position = (rows["case"] == case) & (rows.quantity == "position")
    rows = rows[is_position & rows.axis.isin(axes)]
    sigma = rows.pivot_table(index="t_s", columns="axis", values="lincov_true_si")
    if sigma.empty:
        return {}
    times = sigma.index.to_numpy()
    instants = np.arange(times[0], times[-1] + 0.5 * interval, interval)
    distance = np.abs(times[:, None] - instants)
    nearest = distance.argmin(axis=0)
    covariances = {}
    for time in times[np.unique(nearest)]:
        sigmas = sigma.loc[time, axes].to_numpy(dtype=float)
        covariances[float(time)] = np.diag(sigmas**2)
    return covariances


def _event_ellipses(tables: Tables, case: str) -> dict[float, Floats]:
    """Return the covariances of the position error at the events, (3, 3) in m^2, north, east, down, by time (s).

    Events without a stored covariance are omitted.
    """
    axes = list(_AXES)
    rows = tables.covariances
    is_position = (rows["case"] == case) & (rows.quantity == "position")
    rows = rows[is_position & (rows.source == "")]
    covariances = {}
    for time, time_rows in rows.groupby("t_s"):
        triangle = time_rows.pivot_table(index="axis", columns="other_axis", values="true_si2")
        full = triangle.combine_first(triangle.T)
        full = full.reindex(index=axes, columns=axes)
        covariances[float(time)] = full.to_numpy(dtype=float)
    return covariances


def write_kml(file: Path, title: str, kml_flights: Sequence[KmlFlight], magnify: float = 1.0) -> Path:
    """Write trajectories as KML 2.2 and return the file.

    Parameters
    ----------
    file : Path
        File to be written.
    title, kml_flights, magnify
        As in `kml`.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    with writing(file, "cannot be written"):
        file.write_bytes(kml(title, kml_flights, magnify))
    return file


def kml(title: str, kml_flights: Sequence[KmlFlight], magnify: float = 1.0) -> bytes:
    """Return flights as KML 2.2.

    Parameters
    ----------
    title : str
        Name of the document.
    kml_flights : sequence of KmlFlight
        The flights.
    magnify : float
        Factor on the size of the 3-sigma ellipses.

    Notes
    -----
    Altitudes are heights above the ellipsoid, with altitude mode "absolute". Viewers count these from their own sea
    level, which differs by at most 110 m. An ellipse is the projection of the error ellipsoid on the local horizontal;
    its placemark gives the ellipsoid.
    """
    folders = []
    for flight, colour in zip(kml_flights, cycle(_COLOURS), strict=False):
        reference = flight.reference
        events = flight.events
        folders.append(
            {
                "name": flight.name,
                "colour": colour,
                "path": _coordinates(reference.longitude_rad, reference.latitude_rad, reference.altitude_m),
                "events": [_event(flight, name, float(t)) for name, t in zip(events.event, events.t_s, strict=True)],
                "ellipses": [_ellipse(flight, t, P, magnify) for t, P in flight.ellipses.items()],
            }
        )
    return render("flight.kml.j2", title=title, flights=folders).encode()


def _nearest_row(flight: KmlFlight, time: float) -> pd.Series[float]:
    """Return the row of the reference trajectory that is nearest to a time (s)."""
    distance = np.abs(flight.reference["t_s"].to_numpy(dtype=float) - time)
    return flight.reference.iloc[int(distance.argmin())]


def _coordinates(longitude: ArrayLike, latitude: ArrayLike, height: ArrayLike) -> str:
    """Return positions as KML coordinates with millimetre resolution.

    longitude, latitude : () or (n,) rad. Geodetic longitude and latitude.
    height : () or (n,) m. Height above the ellipsoid.
    """
    rows = np.broadcast(np.degrees(longitude), np.degrees(latitude), height)
    return " ".join(f"{lon:.9f},{lat:.9f},{h:.3f}" for lon, lat, h in rows)


def _event(flight: KmlFlight, name: str, time: float) -> tuple[str, str, str]:
    """Return name, description and coordinates of an event or of the start of a fault.

    The description gives time, height and ground speed.

    time : s since lift-off
    """
    row = _nearest_row(flight, time)
    height = row.altitude_m * 1e-3
    speed = row.ground_speed_m_per_s
    description = f"{time:.3f} s, height {height:.3f} km, speed over the ground {speed:.1f} m/s"
    return name, description, _coordinates(row.longitude_rad, row.latitude_rad, row.altitude_m)


def _ellipse(flight: KmlFlight, time: float, covariance: Floats, magnify: float) -> tuple[str, str, str]:
    """Return name, description and coordinates of a 3-sigma error ellipse.

    time : s since lift-off
    covariance : (3, 3) m^2. Covariance of the position error, axes north, east, down.
    magnify : factor on the size of the drawn ellipse
    """
    variances = np.diag(covariance)
    north, east, down = SIGMAS * np.sqrt(variances)
    eigenvalues = np.maximum(np.linalg.eigvalsh(covariance), 0.0)
    descending = eigenvalues[::-1]
    half_axes = SIGMAS * np.sqrt(descending)
    half_axes_text = ", ".join(f"{half_axis:.3g}" for half_axis in half_axes)
    description = (
        f"3 sigma of position: north {north:.3g} m, east {east:.3g} m, down {down:.3g} m; half axes of the ellipsoid "
        f"{half_axes_text} m; drawn {magnify:g} times as large"
    )
    row = _nearest_row(flight, time)
    position = (row.latitude_rad, row.longitude_rad)
    outline_n = ellipse_points(covariance[:2, :2], magnify * SIGMAS, _CORNERS + 1)  # north, east
    C_e_n = rotation_e_n(*position)
    outline_e = outline_n @ C_e_n[:2]
    centre_e = ecef_from_geodetic(*position, row.altitude_m)
    r_e = centre_e + outline_e
    latitude, longitude, height = geodetic_from_ecef(r_e)
    coordinates = _coordinates(longitude, latitude, height)
    return f"3 sigma at {time:.6g} s", description, coordinates
