"""Delays of the models on arrays of epochs and satellites; those of traced rays from a table, computed once."""

from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline

from lvnav_trade.delays import cards
from lvnav_trade.kernels.earth import ECCENTRICITY_2, SEMI_MINOR
from lvnav_trade.kernels.media import ionosphere, refractivity, troposphere
from lvnav_trade.kernels.media.refractivity import EARTH_RADIUS, lowest_height, ray
from lvnav_trade.reads import remembered
from lvnav_trade.records import Floats

BOTTOM, TOP = -1e3, 120e3  # m: below, the value at the bottom holds; above, a ray that does not dip has no delay
FARTHEST = 7000e3  # m from a dipping line's lowest point; from there on (2,900 km of height) its delay hardly changes
_LEAST = 1e-7  # m; smaller delays are rounding, and have no logarithm worth interpolating
_FLAT, _NEAR = 0.02, 150e3  # sine of elevation, m: where the spacing goes over from uniform to logarithmic


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


def troposphere_delay(model: cards.TroposphereModel, geometry: Geometry) -> Floats:
    """Return the tropospheric delay (n_epoch, n_sat) in m: added to pseudoranges and carrier ranges alike.

    Only `ray_traced` and `any_elevation` know elevations below zero; the other models keep the value of their lowest.
    """
    elevation = np.asarray(geometry.elevation, dtype=float)
    height, latitude = _column(geometry.height), _column(geometry.latitude)
    if isinstance(model, cards.RayTracedTroposphere):
        lowest = lowest_height(latitude, height, geometry.azimuth, elevation)
        return interpolated(model, np.broadcast_to(height, elevation.shape), elevation, lowest)
    if isinstance(model, cards.AnyElevationTroposphere):
        settings = (model.gain, model.scale_height, model.offset, model.join, model.gain_law)
        radius = SEMI_MINOR / (1.0 - ECCENTRICITY_2 * np.sin(latitude) ** 2)  # Gaussian mean curvature of the ellipsoid
        return troposphere.any_elevation(elevation, height, radius, *settings)
    if isinstance(model, cards.SpilkerTroposphere):
        held = np.maximum(elevation, model.lowest)
        return troposphere.spilker(held, height, model.zenith, model.scale_height, model.offset)
    if isinstance(model, cards.StanagTroposphere):
        return troposphere.stanag(np.maximum(elevation, model.lowest), height, model.surface)
    if isinstance(model, cards.SaastamoinenTroposphere | cards.NiellTroposphere):
        held = np.maximum(elevation, model.lowest)
        air = troposphere.weather(height, model.pressure, model.temperature, model.humidity)
        dry, wet = troposphere.saastamoinen_zenith(*air, latitude, height)
        if isinstance(model, cards.SaastamoinenTroposphere):
            return np.asarray((dry + wet) / np.sin(held))
        dry_map, wet_map = troposphere.niell(held, latitude, height, _column(geometry.day_of_year))
        return np.asarray(dry * dry_map + wet * wet_map)
    return np.zeros(elevation.shape)


def ionosphere_delay(model: cards.IonosphereModel, geometry: Geometry, frequency: float = ionosphere.L1) -> Floats:
    """Return the ionospheric group delay (n_epoch, n_sat) in m at a frequency (Hz).

    It is added to pseudoranges and subtracted from carrier ranges (and their rates): code is late, phase is early.
    """
    elevation = np.asarray(geometry.elevation, dtype=float)
    if isinstance(model, cards.KlobucharIonosphere):
        place = (_column(geometry.latitude), _column(geometry.longitude), geometry.azimuth, elevation)
        delay = ionosphere.klobuchar(model.alpha, model.beta, _column(geometry.seconds_of_day), *place)
        return np.asarray(delay * (ionosphere.L1 / frequency) ** 2)
    if isinstance(model, cards.ContentIonosphere | cards.KlobucharContentIonosphere):
        slant = ionosphere.lear_slant if model.slant == "lear" else ionosphere.chapman_slant
        share = slant(elevation, _column(geometry.height), model.peak, model.scale_height)
        return np.asarray(ionosphere.DISPERSION / frequency**2 * _surface_content(model, geometry) * share)
    if isinstance(model, cards.EpsteinIonosphere):
        layer = (model.peak, model.bottom, model.top)
        share = ionosphere.epstein_slant(elevation, _column(geometry.height), *layer)
        return np.asarray(ionosphere.DISPERSION / frequency**2 * model.vertical * share)
    return np.zeros(elevation.shape)


def _surface_content(
    model: cards.ContentIonosphere | cards.KlobucharContentIonosphere, geometry: Geometry
) -> float | Floats:
    """Return the vertical electron content at the ground (1/m^2): one number, or one of each ray (n_epoch, n_sat) at
    the ground below its ionospheric point.
    """
    if isinstance(model, cards.ContentIonosphere):
        return model.vertical
    height = _column(geometry.height)
    median = ionosphere.median_height(height, model.peak, model.scale_height)
    place = (_column(geometry.latitude), _column(geometry.longitude), height)
    latitude, longitude = ionosphere.pierced(*place, geometry.azimuth, geometry.elevation, median)
    seconds = _column(geometry.seconds_of_day)
    return ionosphere.klobuchar_content(model.alpha, model.beta, seconds, latitude, longitude)


def _column(value: float | Floats) -> Floats:
    """Return a value per epoch as a column beside the satellites, (n_epoch, 1) or (1, 1)."""
    return np.atleast_1d(np.asarray(value, dtype=float))[:, None]


def profile(card: cards.RefractivityProfile) -> refractivity.Profile:
    """Return the sampled refractivity of a card."""
    if card.kind == "standard":
        return refractivity.sampled(lambda h: refractivity.standard_refractivity(h, card.wet, card.wet_scale_height))
    if card.kind == "bean_thayer":
        return refractivity.sampled(lambda h: refractivity.bean_thayer_refractivity(h, card.surface))
    return refractivity.sampled(lambda h: refractivity.exponential_refractivity(h, card.surface, card.scale_height))


def table(card: cards.RayTracedTroposphere) -> tuple[RectBivariateSpline, RectBivariateSpline]:
    """Return the table of a model; half a second once, then remembered."""
    return _table(card, card)


@remembered(8)
def _table(_: cards.RayTracedTroposphere, card: cards.RayTracedTroposphere) -> tuple[Any, Any]:
    """Return the table of a model.

    Splines of ln(delay): over height and elevation upwards, over lowest height and distance to it downwards. Both have
    the same heights along one axis and the same rays at elevation zero, so that they meet there.
    """
    air, far = profile(card.profile), card.satellite_radius
    heights = np.concatenate([np.arange(-1e3, 15e3, 500.0), np.arange(15e3, 30e3, 1e3), np.linspace(30e3, TOP, 37)])
    bend = np.linspace(0.0, np.arcsinh(1.0 / _FLAT), 40)
    upwards = ray(air, heights[:, None], np.arcsin(np.minimum(_FLAT * np.sinh(bend), 1.0)), far).delay
    reach = np.linspace(0.0, np.arcsinh(FARTHEST / _NEAR), 46)
    distance = _NEAR * np.sinh(reach)
    radius = np.hypot(EARTH_RADIUS + heights[:, None], distance)
    downwards = ray(air, radius - EARTH_RADIUS, -np.arctan2(distance, EARTH_RADIUS + heights[:, None]), far).delay
    return (
        RectBivariateSpline(heights, bend, np.log(np.maximum(upwards, _LEAST))),
        RectBivariateSpline(heights, reach, np.log(np.maximum(downwards, _LEAST))),
    )


def interpolated(card: cards.RayTracedTroposphere, height: Floats, elevation: Floats, lowest: Floats) -> Floats:
    """Return the delay (...,) m of traced rays.

    Parameters
    ----------
    height, elevation, lowest
        (...,) m and rad of the receiver and of the straight line to the satellite; height (m) of its lowest point,
        which is the receiver's where it does not point downwards.

    Notes
    -----
    Against the rays themselves: within 0.3 mm and 1e-4 of the delay; tested.
    """
    up, down = table(card)
    delay = np.zeros(elevation.shape)
    dips = (elevation < 0.0) & (lowest < TOP)
    rises = (elevation >= 0.0) & (height < TOP)
    delay[rises] = np.exp(up.ev(np.maximum(height[rises], BOTTOM), np.arcsinh(np.sin(elevation[rises]) / _FLAT)))
    low = np.maximum(lowest[dips], BOTTOM)
    distance = np.sqrt(np.maximum(height[dips] - low, 0.0) * (2.0 * EARTH_RADIUS + height[dips] + low))
    delay[dips] = np.exp(down.ev(low, np.arcsinh(np.minimum(distance, FARTHEST) / _NEAR)))
    return delay
