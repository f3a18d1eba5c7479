"""Tropospheric and ionospheric delays on arrays of epochs and satellites; a cached table of ray-traced delays."""

from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline

from lvnav_trade.gnss import delay_cards
from lvnav_trade.kernels.earth import ECCENTRICITY_2, SEMI_MINOR
from lvnav_trade.kernels.media import ionosphere, refractivity, troposphere
from lvnav_trade.kernels.media.refractivity import EARTH_RADIUS, lowest_height, ray
from lvnav_trade.quantities.reads import result_cache
from lvnav_trade.quantities.records import Floats

BOTTOM, TOP = -1e3, 120e3  # m; below, the delay is that at the bottom; above, a rising ray has no delay
FARTHEST = 7000e3  # m from the lowest point of a descending line; beyond it (2,900 km of height) the delay is constant
_LEAST = 1e-7  # m; smaller delays are rounding, whose logarithm cannot be interpolated
_FLAT, _NEAR = 0.02, 150e3  # sine of elevation, and m: transition from uniform to logarithmic spacing of the table


class DelayGeometry(NamedTuple):
    """Time, position and lines of sight for the delay models.

    day_of_year : scalar or (n_epoch,). 1.0 at the start of the year.
    seconds_of_day : scalar or (n_epoch,) s. GPS time of day.
    latitude : (n_epoch,) rad. Geodetic latitude of the receiver.
    longitude : (n_epoch,) rad. Longitude of the receiver.
    height : (n_epoch,) m. Height of the receiver above the ellipsoid.
    azimuth : (n_epoch, n_sat) rad. Azimuth of the straight lines to the satellites.
    elevation : (n_epoch, n_sat) rad. Elevation of these lines.
    """

    day_of_year: float | Floats
    seconds_of_day: float | Floats
    latitude: Floats
    longitude: Floats
    height: Floats
    azimuth: Floats
    elevation: Floats


def troposphere_delay(model: delay_cards.TroposphereModel, geometry: DelayGeometry) -> Floats:
    """Return the tropospheric delay, (n_epoch, n_sat) m. It increases pseudoranges and carrier ranges alike.

    Only `ray_traced` and `any_elevation` are valid below zero elevation; other models use their lowest elevation there.

    Parameters
    ----------
    model : card of a troposphere model
    geometry : DelayGeometry
        Positions of the antenna and directions of the satellites at the epochs.
    """
    elevation = np.asarray(geometry.elevation, dtype=float)
    height = _column(geometry.height)
    latitude = _column(geometry.latitude)
    if isinstance(model, delay_cards.RayTracedTroposphere):
        lowest = lowest_height(latitude, height, geometry.azimuth, elevation)
        heights = np.broadcast_to(height, elevation.shape)
        return ray_traced_delay(model, heights, elevation, lowest)
    if isinstance(model, delay_cards.AnyElevationTroposphere):
        radius = SEMI_MINOR / (1.0 - ECCENTRICITY_2 * np.sin(latitude) ** 2)  # Gaussian mean curvature of the ellipsoid
        return troposphere.any_elevation(
            elevation,
            height,
            radius,
            model.gain,
            model.scale_height,
            model.offset,
            model.join,
            model.gain_law,
        )
    if isinstance(model, delay_cards.SpilkerTroposphere):
        mapped_elevation = np.maximum(elevation, model.lowest)
        return troposphere.spilker(mapped_elevation, height, model.zenith, model.scale_height, model.offset)
    if isinstance(model, delay_cards.StanagTroposphere):
        mapped_elevation = np.maximum(elevation, model.lowest)
        return troposphere.stanag(mapped_elevation, height, model.surface)
    if isinstance(model, delay_cards.SaastamoinenTroposphere | delay_cards.NiellTroposphere):
        return _weather_delay(model, geometry, elevation)
    return np.zeros(elevation.shape)


def _weather_delay(
    model: delay_cards.SaastamoinenTroposphere | delay_cards.NiellTroposphere,
    geometry: DelayGeometry,
    elevation: Floats,
) -> Floats:
    """Return the tropospheric delay (n_epoch, n_sat) in m from the weather on the ground: zenith delays and mapping."""
    height = _column(geometry.height)
    latitude = _column(geometry.latitude)
    mapped_elevation = np.maximum(elevation, model.lowest)
    pressure, temperature, vapour = troposphere.weather(height, model.pressure, model.temperature, model.humidity)
    dry, wet = troposphere.saastamoinen_zenith(pressure, temperature, vapour, latitude, height)
    if isinstance(model, delay_cards.SaastamoinenTroposphere):
        zenith = dry + wet
        return np.asarray(zenith / np.sin(mapped_elevation))
    day_of_year = _column(geometry.day_of_year)
    dry_mapping, wet_mapping = troposphere.niell(mapped_elevation, latitude, height, day_of_year)
    return np.asarray(dry * dry_mapping + wet * wet_mapping)


def ionosphere_delay(
    model: delay_cards.IonosphereModel, geometry: DelayGeometry, frequency: float = ionosphere.L1
) -> Floats:
    """Return the ionospheric group delay, (n_epoch, n_sat) m.

    It increases pseudoranges and decreases carrier ranges (and their rates): code is delayed, phase is advanced.

    Parameters
    ----------
    model : card of an ionosphere model
    geometry : DelayGeometry
        Positions of the antenna and directions of the satellites at the epochs.
    frequency : float
        Carrier frequency (Hz); the default is L1.
    """
    elevation = np.asarray(geometry.elevation, dtype=float)
    height = _column(geometry.height)
    # delay 40.3 TEC / f^2
    delay_per_content = ionosphere.DISPERSION / frequency**2
    if isinstance(model, delay_cards.KlobucharIonosphere):
        delay = ionosphere.klobuchar(
            model.alpha,
            model.beta,
            _column(geometry.seconds_of_day),
            _column(geometry.latitude),
            _column(geometry.longitude),
            geometry.azimuth,
            elevation,
        )
        frequency_ratio = ionosphere.L1 / frequency
        return np.asarray(delay * frequency_ratio**2)
    if isinstance(model, delay_cards.ContentIonosphere | delay_cards.KlobucharContentIonosphere):
        slant_factor = ionosphere.lear_slant if model.slant == "lear" else ionosphere.chapman_slant
        slant = slant_factor(elevation, height, model.peak, model.scale_height)
        content = _surface_content(model, geometry)
        return np.asarray(delay_per_content * content * slant)
    if isinstance(model, delay_cards.EpsteinIonosphere):
        slant = ionosphere.epstein_slant(elevation, height, model.peak, model.bottom, model.top)
        return np.asarray(delay_per_content * model.vertical * slant)
    return np.zeros(elevation.shape)


def _surface_content(
    model: delay_cards.ContentIonosphere | delay_cards.KlobucharContentIonosphere, geometry: DelayGeometry
) -> float | Floats:
    """Return the vertical electron content at the ground (1/m^2): a constant, or below the ionospheric point of each
    ray, (n_epoch, n_sat).
    """
    if isinstance(model, delay_cards.ContentIonosphere):
        return model.vertical
    height = _column(geometry.height)
    shell = ionosphere.median_height(height, model.peak, model.scale_height)
    latitude, longitude = ionosphere.pierce_point(
        _column(geometry.latitude),
        _column(geometry.longitude),
        height,
        geometry.azimuth,
        geometry.elevation,
        shell,
    )
    seconds = _column(geometry.seconds_of_day)
    return ionosphere.klobuchar_content(model.alpha, model.beta, seconds, latitude, longitude)


def _column(value: float | Floats) -> Floats:
    """Return a value by epoch as a column (n_epoch, 1), or (1, 1), that broadcasts over satellites."""
    return np.atleast_1d(np.asarray(value, dtype=float))[:, None]


def profile(card: delay_cards.RefractivityProfile) -> refractivity.SampledAtmosphere:
    """Return the refractivity profile of a card, sampled over height."""
    if card.kind == "standard":
        return refractivity.sample_atmosphere(
            lambda h: refractivity.standard_refractivity(h, card.wet, card.wet_scale_height)
        )
    if card.kind == "bean_thayer":
        return refractivity.sample_atmosphere(lambda h: refractivity.bean_thayer_refractivity(h, card.surface))
    return refractivity.sample_atmosphere(
        lambda h: refractivity.exponential_refractivity(h, card.surface, card.scale_height)
    )


def table(card: delay_cards.RayTracedTroposphere) -> tuple[RectBivariateSpline, RectBivariateSpline]:
    """Return the table of ray-traced delays of a model; computed once (half a second), then cached."""
    return _table(card, card)


@result_cache(8)
def _table(_: delay_cards.RayTracedTroposphere, card: delay_cards.RayTracedTroposphere) -> tuple[Any, Any]:
    """Return the table of a model: two splines of ln(delay).

    The first is for rising rays, over height and elevation; the second for descending rays, over lowest height and
    distance to the lowest point. Both have the same heights and the same rays at zero elevation, so that they agree
    there.
    """
    air = profile(card.profile)
    low_heights = np.arange(-1e3, 15e3, 500.0)
    middle_heights = np.arange(15e3, 30e3, 1e3)
    high_heights = np.linspace(30e3, TOP, 37)
    heights = np.concatenate([low_heights, middle_heights, high_heights])
    height_column = heights[:, None]
    # rising rays: uniform in asinh(sin(elevation) / _FLAT)
    scaled_elevation = np.linspace(0.0, np.arcsinh(1.0 / _FLAT), 40)
    elevation = np.arcsin(np.minimum(_FLAT * np.sinh(scaled_elevation), 1.0))
    rising_delay = ray(air, height_column, elevation, card.satellite_radius).delay
    # descending rays, from the lowest point on: uniform in asinh(distance / _NEAR)
    scaled_distance = np.linspace(0.0, np.arcsinh(FARTHEST / _NEAR), 46)
    distance = _NEAR * np.sinh(scaled_distance)
    lowest_radius = EARTH_RADIUS + height_column
    receiver_height = np.hypot(lowest_radius, distance) - EARTH_RADIUS
    dip = -np.arctan2(distance, lowest_radius)
    descending_delay = ray(air, receiver_height, dip, card.satellite_radius).delay
    log_rising = np.log(np.maximum(rising_delay, _LEAST))
    log_descending = np.log(np.maximum(descending_delay, _LEAST))
    rising_spline = RectBivariateSpline(heights, scaled_elevation, log_rising)
    descending_spline = RectBivariateSpline(heights, scaled_distance, log_descending)
    return rising_spline, descending_spline


def ray_traced_delay(
    card: delay_cards.RayTracedTroposphere, height: Floats, elevation: Floats, lowest: Floats
) -> Floats:
    """Return the ray-traced delay (...,) m from the table.

    Parameters
    ----------
    card : RayTracedTroposphere
    height : (...,) m
        Height of the receiver.
    elevation : (...,) rad
        Elevation of the straight line to the satellite.
    lowest : (...,) m
        Height of the lowest point of that line; that of the receiver for a rising line.

    Notes
    -----
    Interpolation errors are below 0.3 mm and 1e-4 of the delay (tested).
    """
    rising_spline, descending_spline = table(card)
    delay = np.zeros(elevation.shape)
    rises = (elevation >= 0.0) & (height < TOP)
    scaled_elevation = np.arcsinh(np.sin(elevation[rises]) / _FLAT)
    rising_heights = np.maximum(height[rises], BOTTOM)
    log_rising = rising_spline.ev(rising_heights, scaled_elevation)
    delay[rises] = np.exp(log_rising)
    descends = (elevation < 0.0) & (lowest < TOP)
    lowest_heights = np.maximum(lowest[descends], BOTTOM)
    drop = np.maximum(height[descends] - lowest_heights, 0.0)
    # Pythagoras: d^2 = (R + h)^2 - (R + l)^2
    radius_sum = 2.0 * EARTH_RADIUS + height[descends] + lowest_heights
    distance = np.sqrt(drop * radius_sum)
    scaled_distance = np.arcsinh(np.minimum(distance, FARTHEST) / _NEAR)
    log_descending = descending_spline.ev(lowest_heights, scaled_distance)
    delay[descends] = np.exp(log_descending)
    return delay
