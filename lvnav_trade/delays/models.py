"""Delays of the models on arrays of epochs and satellites."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.delays.cards import (
    ConaeTroposphere,
    ContentIonosphere,
    IonosphereModel,
    KlobucharIonosphere,
    NiellTroposphere,
    RayTracedTroposphere,
    SaastamoinenTroposphere,
    SpilkerTroposphere,
    TroposphereModel,
)
from lvnav_trade.delays.table import interpolated
from lvnav_trade.kernels.earth import ECCENTRICITY_2, SEMI_MINOR
from lvnav_trade.kernels.media import ionosphere, troposphere
from lvnav_trade.kernels.media.ionosphere import DISPERSION, L1
from lvnav_trade.kernels.media.refractivity import lowest_height
from lvnav_trade.records import Floats


class Geometry(NamedTuple):
    """Where receivers stand and look.

    day_of_year (1.0 at the start of the year) and seconds_of_day (GPS), scalars or (n_epoch,); latitude, longitude
    (rad, geodetic) and height (m) of the receiver, (n_epoch,); azimuth and elevation (rad) of the straight lines to the
    satellites, (n_epoch, n_sat).
    """

    day_of_year: float | Floats
    seconds_of_day: float | Floats
    latitude: Floats
    longitude: Floats
    height: Floats
    azimuth: Floats
    elevation: Floats


def troposphere_delay(model: TroposphereModel, geometry: Geometry) -> Floats:
    """Return the tropospheric delay (n_epoch, n_sat) in m: added to pseudoranges and carrier ranges alike.

    Only `ray_traced` and `conae_000` know elevations below zero; the other models keep the value of their lowest.
    """
    elevation = np.asarray(geometry.elevation, dtype=float)
    height, latitude = _column(geometry.height), _column(geometry.latitude)
    if isinstance(model, RayTracedTroposphere):
        lowest = lowest_height(latitude, height, geometry.azimuth, elevation)
        return interpolated(model, np.broadcast_to(height, elevation.shape), elevation, lowest)
    if isinstance(model, ConaeTroposphere):
        settings = (model.gain, model.scale_height, model.offset, model.join, model.gain_law)
        return troposphere.conae(elevation, height, _local_radius(latitude), *settings)
    if isinstance(model, SpilkerTroposphere):
        held = np.maximum(elevation, model.lowest)
        return troposphere.spilker(held, height, model.zenith, model.scale_height, model.offset)
    if isinstance(model, SaastamoinenTroposphere | NiellTroposphere):
        held = np.maximum(elevation, model.lowest)
        air = troposphere.weather(height, model.pressure, model.temperature, model.humidity)
        dry, wet = troposphere.saastamoinen_zenith(*air, latitude, height)
        if isinstance(model, SaastamoinenTroposphere):
            return np.asarray((dry + wet) / np.sin(held))
        dry_map, wet_map = troposphere.niell(held, latitude, height, _column(geometry.day_of_year))
        return np.asarray(dry * dry_map + wet * wet_map)
    return np.zeros(elevation.shape)


def ionosphere_delay(model: IonosphereModel, geometry: Geometry, frequency: float = L1) -> Floats:
    """Return the ionospheric group delay (n_epoch, n_sat) in m at a frequency (Hz).

    It is added to pseudoranges and subtracted from carrier ranges (and their rates): code is late, phase is early.
    """
    elevation = np.asarray(geometry.elevation, dtype=float)
    if isinstance(model, KlobucharIonosphere):
        place = (_column(geometry.latitude), _column(geometry.longitude), geometry.azimuth, elevation)
        delay = ionosphere.klobuchar(model.alpha, model.beta, _column(geometry.seconds_of_day), *place)
        return np.asarray(delay * (L1 / frequency) ** 2)
    if isinstance(model, ContentIonosphere):
        slant = ionosphere.lear_slant if model.slant == "lear" else ionosphere.chapman_slant
        share = slant(elevation, _column(geometry.height), model.peak, model.scale_height)
        return np.asarray(DISPERSION / frequency**2 * model.vertical * share)
    return np.zeros(elevation.shape)


def _column(value: float | Floats) -> Floats:
    """Return a value per epoch as a column beside the satellites, (n_epoch, 1) or (1, 1)."""
    return np.atleast_1d(np.asarray(value, dtype=float))[:, None]


def _local_radius(latitude: Floats) -> Floats:
    """Return the radius (m) of the sphere that fits the ellipsoid best at a latitude: the Gaussian mean curvature."""
    return np.asarray(SEMI_MINOR / (1.0 - ECCENTRICITY_2 * np.sin(latitude) ** 2))
