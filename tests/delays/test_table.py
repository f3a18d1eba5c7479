"""The table of traced rays against the rays themselves; how much work both take."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.delays.cards import BeanThayerProfile, ExponentialProfile, RayTracedTroposphere, StandardProfile
from lvnav_trade.delays.table import TOP, interpolated, profile, table
from lvnav_trade.kernels.media.refractivity import EARTH_RADIUS, ray

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
    error = worst(interpolated(model, height, elevation, height), rays)
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
    error = worst(interpolated(model, height, elevation, lowest), rays)
    record_property(f"table of {air.kind}, downwards, beyond 1e-4 of the delay, mm", 1e3 * error)
    assert rays.max() > 100.0
    assert error < 3e-4


def test_both_parts_meet_at_the_horizon_and_end_where_the_air_does():
    model, height = RayTracedTroposphere(), np.linspace(0.0, 100e3, 201)
    above = interpolated(model, height, np.zeros(201), height)
    below = interpolated(model, height, np.full(201, -1e-12), height)
    assert above == pytest.approx(below, rel=1e-7)
    ends = np.array([TOP + 1.0, 400e3])
    assert interpolated(model, ends, np.zeros(2), ends).tolist() == [0.0, 0.0]
    assert interpolated(model, np.array([TOP - 1.0]), np.zeros(1), np.array([TOP - 1.0]))[0] < 1e-5


def test_below_what_is_tabulated_the_value_at_its_end_holds():
    model = RayTracedTroposphere()
    deep, bottom = (interpolated(model, np.array([h]), np.array([0.5]), np.array([h]))[0] for h in (-9e3, -1e3))
    assert deep == bottom
    far, farther = (interpolated(model, np.array([h]), np.array([-0.9]), np.array([30e3]))[0] for h in (4e6, 9e6))
    assert far == farther > 1.0


def test_satellites_farther_away_have_a_table_of_their_own():
    gps, galileo = RayTracedTroposphere(), RayTracedTroposphere(satellite_radius="29600 km")
    place = (np.array([350e3]), np.array([-0.318]), np.array([12e3]))
    assert table(gps) is not table(galileo)
    assert interpolated(galileo, *place) == pytest.approx(interpolated(gps, *place), rel=0.02)
    assert interpolated(galileo, *place) != interpolated(gps, *place)


def test_six_thousand_rays_make_it_and_none_are_traced_to_read_it(monkeypatch):
    traced = []

    def counted(air, height, elevation, far):
        found = ray(air, height, elevation, far)
        traced.append(found.delay.size)
        return found

    monkeypatch.setattr("lvnav_trade.delays.table.ray", counted)
    model = RayTracedTroposphere(profile=StandardProfile(wet=33.0))
    table(model)
    assert 0 < sum(traced) < 8000
    traced.clear()
    height, elevation = np.broadcast_arrays(np.linspace(0.0, 110e3, 600)[:, None], np.linspace(-0.15, 1.5, 80))
    read = interpolated(model, height, elevation, np.where(elevation < 0.0, 40e3, height))
    assert read.max() > 50.0
    assert traced == []
