import math

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.interpolate import make_interp_spline

from lvnav_trade.gnss.constellation import NominalConstellation, orbits
from lvnav_trade.gnss.fault_cards import SatelliteOutage
from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.gnss.visibility import (
    GRAZING_HEIGHT,
    antenna_motion,
    mask_angle,
    satellite_inertial,
    sky,
    transmission,
)
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.earth import OMEGA, SEMI_MAJOR
from lvnav_trade.quantities.frames import (
    earth_angle,
    ecef_from_eci,
    ecef_from_geodetic,
    eci_from_ecef,
    geodetic_from_ecef,
    gmst,
    matrices,
)
from lvnav_trade.quantities.line_of_sight import range_rate
from lvnav_trade.trajectory.flight import Phase, Trajectory, motion

EPOCH = "2026-08-01T12:00:00Z"
T = np.arange(-60.0, 601.0, 20.0)


@pytest.fixture(scope="module")
def gps_24(root):
    return NominalConstellation(**YAML(typ="safe").load(root / "configs/constellations/gps_24.yaml"))


@pytest.fixture(scope="module")
def flight():
    """Return a smooth ascent from 5.2 N, 52.8 W to 400 km in 600 s, rolling and pitching, after 60 s on the pad."""
    t = np.arange(-80.0, 630.0, 2.5)
    rise = (np.maximum(t, 0.0) / 600.0) ** 4
    theta0 = gmst(EPOCH)
    r_e = ecef_from_geodetic(np.radians(5.2 + 4.0 * rise), np.radians(-52.8 + 10.0 * rise), 400e3 * rise)
    half = 0.5 * (0.3 + 0.004 * t)
    q_b_i = np.stack([np.cos(half), 0.6 * np.sin(half), 0.8 * np.sin(half), 0.0 * t], axis=1)
    position = make_interp_spline(t, eci_from_ecef(r_e, earth_angle(theta0, t)), k=5)
    phase = Phase("flight", -70.0, 620.0, position, make_interp_spline(t, q_b_i, k=5))
    return Trajectory((phase,), {"lift_off": 0.0, "cutoff": 500.0}, theta0, EPOCH, {})


def receiver(**changes):
    numbers = {
        "name": "test", "source": "none", "pseudorange_sigma": "2 m", "range_rate_sigma": "0.1 m/s", "mask": "5 deg",
        "solution": {"kind": "direct", "position_sigma": "2 m", "velocity_sigma": "0.1 m/s"},
        "clock": {"h0": 0.0, "h_minus2": 0.0},
    }  # fmt: skip
    return ReceiverCard(**(numbers | changes))


def test_the_light_time_equation_holds_to_a_micrometre(gps_24, flight):
    orbit = orbits(gps_24, EPOCH)
    here, _ = antenna_motion(flight, receiver(), T)
    sent = transmission(orbit, flight.theta0, T, here)
    r_i, _ = satellite_inertial(orbit, flight.theta0, T[:, None] - sent.travel)
    distance = np.linalg.norm(r_i - here[:, None, :], axis=-1)
    assert np.max(np.abs(distance - SPEED_OF_LIGHT * sent.travel)) < 1e-6
    assert np.max(np.linalg.norm(r_i - sent.r_i, axis=-1)) < 1e-6


def test_the_range_equals_the_earth_fixed_formula_with_the_satellite_turned_by_the_travel(gps_24, flight):
    seen = sky(gps_24, receiver(), flight, T)
    here, _ = antenna_motion(flight, receiver(), T)
    here_e = ecef_from_eci(here, earth_angle(flight.theta0, T))[:, None, :]
    orbit, travel = orbits(gps_24, EPOCH), np.full((T.size, 24), 0.08)
    for _ in range(6):
        r_e, _ = orbit.ecef(T[:, None] - travel)
        turned = ecef_from_eci(r_e, OMEGA * travel)  # into the Earth's axes at reception
        travel = np.linalg.norm(turned - here_e, axis=-1) / SPEED_OF_LIGHT
    ours = np.linalg.norm(seen.r_i - here[:, None, :], axis=-1)
    np.testing.assert_allclose(ours, SPEED_OF_LIGHT * travel, rtol=0.0, atol=1e-6)
    # The textbook's first-order Sagnac term; of second order (w travel)^2 r_sat r / (2 range) is left, 0.2 mm at most.
    sagnac = OMEGA / SPEED_OF_LIGHT * (r_e[..., 0] * here_e[..., 1] - r_e[..., 1] * here_e[..., 0])
    textbook = np.linalg.norm(r_e - here_e, axis=-1) + sagnac
    assert 20.0 < np.max(np.abs(sagnac)) < 60.0
    np.testing.assert_allclose(ours, textbook, rtol=0.0, atol=2e-4)


def test_the_velocity_is_the_derivative_of_the_position_over_reception_time(gps_24, flight):
    early, now, late = (sky(gps_24, receiver(), flight, T + shift) for shift in (-0.25, 0.0, 0.25))
    difference = (late.r_i - early.r_i) / 0.5
    np.testing.assert_allclose(now.v_i, difference, rtol=0.0, atol=1e-4)
    # Against transmission time it would be off by up to v_sat range_rate / c, well above the tolerance.
    _, at_transmission = satellite_inertial(orbits(gps_24, EPOCH), flight.theta0, T[:, None] - 0.07)
    assert np.max(np.abs(at_transmission - difference)) > 0.05


@pytest.mark.parametrize("lever", [("0 m", "0 m", "0 m"), ("2 m", "-0.8 m", "0.5 m")])
def test_the_range_rate_is_the_derivative_of_the_range(gps_24, flight, lever):
    card, step = receiver(lever_b=lever), 0.02

    def distance(t):
        here, _ = antenna_motion(flight, card, t)
        return np.linalg.norm(sky(gps_24, card, flight, t).r_i - here[:, None, :], axis=-1)

    seen, (here, velocity) = sky(gps_24, card, flight, T), antenna_motion(flight, card, T)
    line = seen.r_i - here[:, None, :]
    unit = line / np.linalg.norm(line, axis=-1, keepdims=True)
    rate = np.sum(unit * (seen.v_i - velocity[:, None, :]), axis=-1)
    difference = (distance(T + step) - distance(T - step)) / (2 * step)
    np.testing.assert_allclose(rate, difference, rtol=0.0, atol=1e-4)
    sent = transmission(orbits(gps_24, EPOCH), flight.theta0, T, here)
    np.testing.assert_allclose(range_rate(unit, sent.v_i, velocity[:, None, :]), difference, rtol=0.0, atol=1e-4)


def test_the_antenna_stands_at_the_end_of_its_lever_arm(gps_24, flight):
    lever_b, at = np.array([2.0, -0.8, 0.5]), motion(flight, T)
    card = receiver(lever_b=("2 m", "-0.8 m", "0.5 m"))
    here, velocity = antenna_motion(flight, card, T)
    np.testing.assert_allclose(here - at.r_i, matrices(at.q_b_i) @ lever_b, rtol=0.0, atol=1e-8)
    step = 0.01
    difference = (antenna_motion(flight, card, T + step)[0] - antenna_motion(flight, card, T - step)[0]) / (2 * step)
    np.testing.assert_allclose(velocity, difference, rtol=0.0, atol=1e-4)
    assert np.max(np.linalg.norm(velocity - at.v_i, axis=-1)) > 1e-3


def lowest_heights(here, there):
    """Return the lowest ellipsoidal height along each straight ray, by sampling it densely; here, there (n, 3)."""
    share = np.linspace(0.0, 1.0, 4001)[:, None, None] ** 2  # denser near the antenna
    return geodetic_from_ecef(here + share * (there - here))[2].min(axis=0)


def test_no_tracked_ray_passes_through_the_earth_and_no_clear_one_is_refused(gps_24, flight):
    seen = sky(gps_24, receiver(mask="-90 deg", channels=64), flight, T)
    here, _ = antenna_motion(flight, receiver(), T)
    for epoch, theta in enumerate(earth_angle(flight.theta0, T)):
        height = geodetic_from_ecef(ecef_from_eci(here[epoch], theta))[2]
        lowest = lowest_heights(*(ecef_from_eci(r, theta) for r in np.broadcast_arrays(here[epoch], seen.r_i[epoch])))
        limit = min(GRAZING_HEIGHT, height)
        assert np.all(lowest[seen.is_tracked[epoch]] > limit - 100.0)
        # sphere of stretched axes: within 34 m of height
        assert np.all(lowest[~seen.is_tracked[epoch]] < limit + 100.0)


def test_more_satellites_are_tracked_as_the_vehicle_rises(gps_24, flight):
    count = sky(gps_24, receiver(mask="-25 deg", channels=64), flight, T).is_tracked.sum(axis=1)
    assert np.all(count[T >= 580.0] >= count[T <= 0.0].max() + 2)
    flat = sky(gps_24, receiver(mask="0 deg", channels=64), flight, T)
    assert np.array_equal(flat.is_tracked, flat.elevation >= 0.0)


def test_no_more_than_the_channels_are_tracked_and_those_the_highest(gps_24, flight):
    free, few = (sky(gps_24, receiver(channels=channels), flight, T) for channels in (64, 5))
    assert np.array_equal(free.is_tracked, free.elevation >= math.radians(5.0))
    assert np.all(few.is_tracked.sum(axis=1) == 5)
    for epoch in range(T.size):
        left_out = free.is_tracked[epoch] & ~few.is_tracked[epoch]
        assert few.elevation[epoch][few.is_tracked[epoch]].min() > few.elevation[epoch][left_out].max()


def test_a_mask_that_sinks_is_the_papers_at_every_height():
    # Canepa and Servidia, section 6.3.1: 10 deg at sea level, 0 at ten scale heights, then the dip of that shell.
    card = receiver(mask="10 deg", mask_height="75.188 km")
    heights = np.array([0.0, 37.594e3, 75.188e3, 350e3])
    here = eci_from_ecef(ecef_from_geodetic(0.0 * heights, 0.3 + 0.0 * heights, heights), 1.2 + 0.0 * heights)
    dip = math.degrees(math.acos((SEMI_MAJOR + 75.188e3) / (SEMI_MAJOR + 350e3)))
    found = np.degrees(mask_angle(card, 1.2, np.zeros(4), here))[:, 0]
    np.testing.assert_allclose(found, [10.0, 5.0, 0.0, -dip], rtol=0.0, atol=1e-6)
    assert mask_angle(receiver(mask="10 deg"), 1.2, np.zeros(4), here) == math.radians(10.0)


def test_an_outage_keeps_the_highest_and_moves_nothing_else(gps_24, flight):
    fault = SatelliteOutage(start="cutoff + 20 s", duration="60 s", keep=3)
    whole, faulty = sky(gps_24, receiver(), flight, T), sky(gps_24, receiver(), flight, T, [fault])
    within = (T >= 520.0) & (T < 580.0)
    assert np.all(faulty.is_tracked[within].sum(axis=1) == 3)
    kept = np.argsort(-whole.elevation[T == 520.0][0])[:3]
    assert np.all(faulty.is_tracked[within][:, kept])
    assert np.array_equal(faulty.is_tracked[~within], whole.is_tracked[~within])
    for name in ("t", "r_i", "v_i", "azimuth", "elevation"):
        assert np.array_equal(getattr(whole, name), getattr(faulty, name))


def test_a_flight_without_epochs_has_an_empty_sky(gps_24, flight):
    seen = sky(gps_24, receiver(), flight, np.empty(0))
    assert seen.r_i.shape == (0, 24, 3)
    assert seen.is_tracked.shape == (0, 24)
