"""Delays on arrays: shapes, continuity, one model against another, the published residual along an ascent;
the table of traced rays against the rays themselves, and how much work both take.
"""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.gnss.delay_cards import (
    AnyElevationTroposphere,
    BeanThayerProfile,
    ContentIonosphere,
    ExponentialProfile,
    KlobucharContentIonosphere,
    KlobucharIonosphere,
    NiellTroposphere,
    NoIonosphere,
    NoTroposphere,
    RayTracedTroposphere,
    SaastamoinenTroposphere,
    SpilkerTroposphere,
    StanagTroposphere,
    StandardProfile,
)
from lvnav_trade.gnss.delay_models import (
    TOP,
    DelayGeometry,
    ionosphere_delay,
    profile,
    ray_traced_delay,
    table,
    troposphere_delay,
)
from lvnav_trade.kernels.media.ionosphere import L1
from lvnav_trade.kernels.media.refractivity import EARTH_RADIUS, ray

TROPOSPHERES = [
    RayTracedTroposphere(),
    AnyElevationTroposphere(),
    SpilkerTroposphere(),
    StanagTroposphere(),
    SaastamoinenTroposphere(),
    NiellTroposphere(),
]
KLOBUCHAR = KlobucharIonosphere(alpha=(2e-8, -8e-9, -5e-8, 1e-7), beta=(2e5, 2e5, -1e5, -1e6))
BY_KLOBUCHAR = KlobucharContentIonosphere(alpha=KLOBUCHAR.alpha, beta=KLOBUCHAR.beta)
IONOSPHERES = [KLOBUCHAR, BY_KLOBUCHAR, ContentIonosphere(), ContentIonosphere(slant="integrated")]


def seen(height, degrees, azimuth=0.5, latitude=-0.674):
    """Geometry of every pair of a height (m) and an elevation (deg)."""
    height = np.atleast_1d(np.asarray(height, dtype=float))
    elevation = np.broadcast_to(np.radians(degrees), (height.size, np.size(degrees)))
    place = np.full(height.size, latitude), np.full(height.size, -1.08)
    return DelayGeometry(213.0, 54000.0, *place, height, np.full(elevation.shape, azimuth), elevation)


@pytest.mark.parametrize("model", TROPOSPHERES, ids=lambda m: m.kind)
def test_each_troposphere_has_the_shape_of_the_sky_and_is_finite_anywhere(model):
    delay = troposphere_delay(model, seen([-400.0, 0.0, 9e3, 60e3, 350e3, 2e6], [-40.0, -10.0, 0.0, 3.0, 90.0]))
    assert delay.shape == (6, 5)
    assert np.all(np.isfinite(delay))
    assert np.all(delay[:3, 2:] > 0.4)
    assert np.all(np.abs(delay[4:, 2:]) < 1e-12)  # above the air, looking up


@pytest.mark.parametrize("model", TROPOSPHERES, ids=lambda m: m.kind)
def test_each_troposphere_is_smooth_on_the_way_up(model):
    height = np.arange(0.0, 80e3, 50.0)
    delay = troposphere_delay(model, seen(height, [10.0, 45.0, 90.0]))
    assert np.all(np.diff(delay, axis=0) < 1e-6)
    assert np.abs(np.diff(delay, 2, axis=0)).max() < 1e-3  # m; a step at 10 km would be metres


@pytest.mark.parametrize("model", TROPOSPHERES, ids=lambda m: m.kind)
def test_all_models_agree_where_all_hold(model):
    geometry = seen([0.0, 1e3], [90.0, 45.0, 20.0, 15.0])
    rays = troposphere_delay(RayTracedTroposphere(), geometry)
    assert troposphere_delay(model, geometry) == pytest.approx(rays, rel=0.05)


def test_niell_is_nearest_to_the_rays_at_five_degrees():
    geometry = seen(0.0, [5.0])
    rays = troposphere_delay(RayTracedTroposphere(), geometry)
    errors = {model.kind: abs(float((troposphere_delay(model, geometry) - rays)[0, 0])) for model in TROPOSPHERES[1:]}
    assert min(errors, key=errors.get) == "niell"
    assert errors["niell"] < 0.5 < 2.0 < errors["saastamoinen"]  # the sine alone is metres off


def test_models_without_negative_elevations_keep_their_lowest_value():
    for model in TROPOSPHERES[2:]:
        delay = troposphere_delay(model, seen(20e3, [-5.0, 0.0, np.degrees(model.lowest)]))
        assert delay[0, 0] == delay[0, 1] == pytest.approx(delay[0, 2], rel=1e-12)


def test_no_troposphere_and_no_ionosphere_are_zero():
    geometry = seen([0.0, 1e5], [5.0, 50.0, 90.0])
    assert troposphere_delay(NoTroposphere(), geometry).tolist() == np.zeros((2, 3)).tolist()
    assert ionosphere_delay(NoIonosphere(), geometry).tolist() == np.zeros((2, 3)).tolist()


@pytest.mark.parametrize("model", IONOSPHERES, ids=lambda m: getattr(m, "slant", m.kind))
def test_each_ionosphere_is_finite_and_falls_with_the_square_of_frequency(model):
    geometry = seen([0.0, 60e3, 350e3, 1.2e6], [-20.0, -5.0, 0.0, 30.0, 90.0])
    delay = ionosphere_delay(model, geometry)
    assert delay.shape == (4, 5)
    assert np.all(np.isfinite(delay))
    assert np.all(delay > 0.0)
    other = ionosphere_delay(model, geometry, 1227.6e6)  # L2
    assert other == pytest.approx(delay * (77.0 / 60.0) ** 2, rel=1e-9)


def test_twenty_units_of_content_are_three_metres_and_a_quarter_overhead():
    delay = ionosphere_delay(ContentIonosphere(), seen([0.0, 420e3, 1000e3], [90.0]))
    assert delay[0, 0] == pytest.approx(40.3 * 20e16 / L1**2, rel=2e-4)
    assert delay[1:, 0] / delay[0, 0] == pytest.approx([0.632, 0.003], abs=5e-4)


def test_an_epoch_may_have_its_own_time_of_day():
    geometry = seen([0.0, 0.0], [40.0])
    times = ionosphere_delay(KLOBUCHAR, geometry._replace(seconds_of_day=np.array([3600.0, 68400.0])))
    one = ionosphere_delay(KLOBUCHAR, geometry._replace(seconds_of_day=68400.0))
    assert times[1] == one[1]
    assert times[0] != one[0]


def mask(height, earth=6371e3, scale=7518.8):
    """Lowest elevation (rad) by height of Canepa and Servidia, section 6.3.1."""
    low = np.radians(10.0) * (10.0 * scale - height) / (10.0 * scale)
    high = -np.arccos(np.minimum((earth + 10.0 * scale) / (earth + height), 1.0))
    return np.where(height <= 10.0 * scale, low, high)


@pytest.mark.parametrize("air", [BeanThayerProfile(), RayTracedTroposphere().profile], ids=lambda card: card.kind)
def test_the_formula_of_any_elevation_is_within_a_metre_behind_its_mask(air, record_property):
    height = np.concatenate([np.arange(0.0, 20e3, 100.0), np.arange(20e3, 350e3, 2e3)])
    share = np.linspace(0.0, 1.0, 60) ** 2
    lowest = mask(height)[:, None]
    geometry = seen(height, 0.0)._replace(elevation=lowest + share * (np.pi / 2 - lowest), azimuth=np.zeros((1, 1)))
    truth = RayTracedTroposphere(profile=air)
    error = troposphere_delay(AnyElevationTroposphere(), geometry) - troposphere_delay(truth, geometry)
    record_property(f"compensation less {air.kind} rays behind the mask, m", (error.min(), error.max()))
    assert np.abs(error).max() < 1.0
    assert np.abs(error).max() > 0.2  # it is a simple model


def test_without_the_mask_the_compensation_is_tens_of_metres_off_at_the_horizon():
    geometry = seen(0.0, [0.0, 2.0, 5.0])
    error = troposphere_delay(AnyElevationTroposphere(), geometry) - troposphere_delay(RayTracedTroposphere(), geometry)
    assert -60.0 < error[0, 0] < -30.0
    assert abs(error[0, 2]) < 1.5


# --- traced rays

PROFILES = [StandardProfile(), BeanThayerProfile(), ExponentialProfile()]


def worst(ours, rays):
    """Return the largest error (m) beyond 1e-4 of the delay."""
    return float((np.abs(ours - rays) - 1e-4 * rays).max())


@pytest.mark.parametrize("air", PROFILES, ids=lambda card: card.kind)
def test_upwards_it_is_the_rays_within_a_fraction_of_a_millimetre(air, record_property):
    model, draw = RayTracedTroposphere(profile=air), np.random.default_rng(1)
    height = draw.uniform(0.0, 1.0, 4000) ** 2 * 110e3
    elevation = np.arcsin(draw.uniform(0.0, 1.0, 4000) ** 3)
    rays = ray(profile(air), height, elevation, model.satellite_radius).delay
    error = worst(ray_traced_delay(model, height, elevation, height), rays)
    record_property(f"table of {air.kind}, upwards, beyond 1e-4 of the delay, mm", 1e3 * error)
    assert rays.max() > 60.0
    assert error < 3e-4


@pytest.mark.parametrize("air", PROFILES, ids=lambda card: card.kind)
def test_downwards_it_is_the_rays_within_a_fraction_of_a_millimetre(air, record_property):
    model, draw = RayTracedTroposphere(profile=air), np.random.default_rng(2)
    lowest, distance = draw.uniform(0.0, 110e3, 4000), draw.uniform(0.0, 1.0, 4000) ** 2 * 6500e3
    height = np.hypot(EARTH_RADIUS + lowest, distance) - EARTH_RADIUS
    elevation = -np.arctan2(distance, EARTH_RADIUS + lowest)
    rays = ray(profile(air), height, elevation, model.satellite_radius).delay
    error = worst(ray_traced_delay(model, height, elevation, lowest), rays)
    record_property(f"table of {air.kind}, downwards, beyond 1e-4 of the delay, mm", 1e3 * error)
    assert rays.max() > 100.0
    assert error < 3e-4


def test_both_parts_meet_at_the_horizon_and_end_where_the_air_does():
    model, height = RayTracedTroposphere(), np.linspace(0.0, 100e3, 201)
    above = ray_traced_delay(model, height, np.zeros(201), height)
    below = ray_traced_delay(model, height, np.full(201, -1e-12), height)
    assert above == pytest.approx(below, rel=1e-7)
    ends = np.array([TOP + 1.0, 400e3])
    assert ray_traced_delay(model, ends, np.zeros(2), ends).tolist() == [0.0, 0.0]
    assert ray_traced_delay(model, np.array([TOP - 1.0]), np.zeros(1), np.array([TOP - 1.0]))[0] < 1e-5


def test_below_what_is_tabulated_the_value_at_its_end_holds():
    model = RayTracedTroposphere()
    deep, bottom = (ray_traced_delay(model, np.array([h]), np.array([0.5]), np.array([h]))[0] for h in (-9e3, -1e3))
    assert deep == bottom
    far, farther = (ray_traced_delay(model, np.array([h]), np.array([-0.9]), np.array([30e3]))[0] for h in (4e6, 9e6))
    assert far == farther > 1.0


def test_satellites_farther_away_have_a_table_of_their_own():
    gps, galileo = RayTracedTroposphere(), RayTracedTroposphere(satellite_radius="29600 km")
    place = (np.array([350e3]), np.array([-0.318]), np.array([12e3]))
    assert table(gps) is not table(galileo)
    assert ray_traced_delay(galileo, *place) == pytest.approx(ray_traced_delay(gps, *place), rel=0.02)
    assert ray_traced_delay(galileo, *place) != ray_traced_delay(gps, *place)


def test_six_thousand_rays_make_it_and_none_are_traced_to_read_it(monkeypatch):
    traced = []

    def counted(air, height, elevation, far):
        found = ray(air, height, elevation, far)
        traced.append(found.delay.size)
        return found

    monkeypatch.setattr("lvnav_trade.gnss.delay_models.ray", counted)
    model = RayTracedTroposphere(profile=StandardProfile(wet=33.0))
    table(model)
    assert 0 < sum(traced) < 8000
    traced.clear()
    height, elevation = np.broadcast_arrays(np.linspace(0.0, 110e3, 600)[:, None], np.linspace(-0.15, 1.5, 80))
    read = ray_traced_delay(model, height, elevation, np.where(elevation < 0.0, 40e3, height))
    assert read.max() > 50.0
    assert traced == []


def test_content_of_the_broadcast_model_is_its_delay_overhead_and_thins_with_height():
    """At the zenith of the ground its own delay, by the mapping of 90 deg; on the way up that of the layer's share."""
    ground, above = seen(0.0, [90.0]), seen([0.0, 300e3, 500e3], [90.0])
    factor = 2.037 / (1.0 + np.sqrt(1.076))  # of eq. 22 at the zenith
    vertical = ionosphere_delay(KLOBUCHAR, ground) / (1.0 + 16.0 * 0.03**3)
    # the broadcast model's pierce point of a ray straight up is a quarter of a degree away
    np.testing.assert_allclose(ionosphere_delay(BY_KLOBUCHAR, ground), factor * vertical, rtol=2e-3)
    share = ionosphere_delay(ContentIonosphere(), above) / ionosphere_delay(ContentIonosphere(), ground)
    np.testing.assert_allclose(
        ionosphere_delay(BY_KLOBUCHAR, above), share * ionosphere_delay(BY_KLOBUCHAR, ground), rtol=1e-12
    )


def test_content_of_the_broadcast_model_differs_from_east_to_west_by_the_time_of_day():
    """At 15 h GPS time and 62 W it is 11 h: more is there towards the east, where it is later."""
    east, west = (ionosphere_delay(BY_KLOBUCHAR, seen(0.0, [15.0], azimuth=a)) for a in (0.5 * np.pi, 1.5 * np.pi))
    assert east > 1.05 * west
