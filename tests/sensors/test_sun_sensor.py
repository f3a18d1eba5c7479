"""The sun sensor: its angles, where it sees the Sun, and what both engines make of it."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.kernels.attitude import from_rotation, multiply
from lvnav_trade.kernels.strapdown import N_NAV, Q
from lvnav_trade.quantities.frames import earth_angle, matrices, unit
from lvnav_trade.sensors.jacobian_row import H_ATT, N_ENTRY
from lvnav_trade.sensors.optics import sun_direction
from lvnav_trade.sensors.sensor import FlightView
from lvnav_trade.sensors.sun_sensor import SunSensorCard, SunSensorModel, fill, measure
from lvnav_trade.trajectory.flight import motion
from tests.both_engines.test_stellar import QUIET, SLOW
from tests.building import INERTIAL, LOOSE, MATCHED, flight, loaded, prepare_hop, turning, with_fields
from tests.simulation.preparation.test_sensors import agree

EPOCH, RADIUS = "2024-06-20T20:51:00Z", 6.4e6
SUN = sun_direction(EPOCH, np.zeros(1), np.zeros(1))[0]
DATA = {"kind": "sun_sensor", "name": "a", "source": "b", "sigma": "0.05 deg", "field_of_view": "60 deg"}


def card(**fields):
    return SunSensorCard.model_validate({**DATA, "boresight": (0.0, 0.0, 1.0), **fields})


def facing(off, turn):
    """The attitude of a body whose z axis is `off` (deg) from the Sun, turned by `turn` (deg) about that axis."""
    side = unit(np.cross(SUN, [0.3, 0.5, 0.9]))
    z = np.cos(np.radians(off)) * SUN + np.sin(np.radians(off)) * side
    x = unit(np.cross(np.cross(SUN, side), z))
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    C_b_i = np.stack([c * x + s * np.cross(z, x), c * np.cross(z, x) - s * x, z], axis=1)
    half = 0.5 * math.acos(np.clip((np.trace(C_b_i) - 1.0) / 2.0, -1.0, 1.0))
    axis = np.array([C_b_i[2, 1] - C_b_i[1, 2], C_b_i[0, 2] - C_b_i[2, 0], C_b_i[1, 0] - C_b_i[0, 1]])
    return np.concatenate([[math.cos(half)], math.sin(half) * unit(axis)])


def view(q_b_i, r_i=1.1 * RADIUS * SUN):
    """A flight of one epoch, over a sphere."""
    one = np.zeros(1)
    height = np.array([np.linalg.norm(r_i) - RADIUS])
    return FlightView(one, np.array([r_i]), np.zeros((1, 3)), np.array([q_b_i]), height, one, np.zeros((1, 3)), EPOCH)


def angles(q_b_i):
    """The angles of the Sun by plain geometry; a sensor along z has its x axis along -y of the body, its y along x."""
    x, y, z = matrices(np.array([q_b_i]))[0].T @ SUN
    return np.array([math.copysign(math.acos(z / math.hypot(side, z)), side) for side in (-y, x)])


def rows(true, estimate, errors=(0.0, 0.0), one=None):
    """Jacobian rows (2, n) and innovations (2,) of a filter whose attitude is an estimate."""
    one = card() if one is None else one
    observed, H, z, nav = np.zeros(4), np.full((3, N_ENTRY), np.nan), np.full(3, np.nan), np.zeros(N_NAV)
    measure(observed, one.truth(view(true))[0], *errors)
    nav[Q : Q + 4] = estimate
    fill(H, z, 1, observed, nav, one.matched_model().filter_parameters(view(true))[0])
    assert np.isnan(H[0]).all()
    return H[1:], z[1:]


PLACES = [(5.0, 20.0), (30.0, 200.0), (55.0, -70.0), (59.0, 95.0)]


@pytest.mark.parametrize(("off", "turn"), PLACES)
def test_the_innovation_is_the_difference_of_the_angles_and_the_error(off, turn):
    true = facing(off, turn)
    estimate = np.array(multiply(*from_rotation(0.02, -0.05, 0.03), *true))
    np.testing.assert_allclose(card().truth(view(true))[0], angles(true), atol=1e-12)
    np.testing.assert_allclose(rows(true, estimate)[1], angles(true) - angles(estimate), atol=1e-8)
    np.testing.assert_allclose(rows(true, true, (0.01, -0.02))[1], [0.01, -0.02], atol=1e-9)


@pytest.mark.parametrize(("off", "turn"), PLACES)
def test_the_rows_are_the_derivatives_of_the_angles(off, turn):
    true = facing(off, turn)
    H, _ = rows(true, true)
    for axis in range(3):
        step = 1e-5 * np.eye(3)[axis]
        high, low = (angles(np.array(multiply(*from_rotation(*(s * step)), *true))) for s in (1.0, -1.0))
        np.testing.assert_allclose((high - low) / 2e-5, H[:, H_ATT + axis], atol=1e-8)
    assert np.abs(H[:, H_ATT : H_ATT + 3]).max() > 0.5
    assert np.count_nonzero(np.delete(H, range(H_ATT, H_ATT + 3), axis=1)) == 0
    np.testing.assert_allclose(H[:, H_ATT : H_ATT + 3] @ SUN, 0.0, atol=1e-12)  # a turn about the Sun shows nothing


def test_it_is_mounted_along_its_boresight_and_sees_as_far_as_its_field():
    for boresight in ((0.0, 0.0, 1.0), (1.0, 1.0, -0.5)):
        one = card(boresight=boresight)
        along = unit(np.array(boresight))
        for off, expected in ((0.1, True), (59.9, True), (60.1, False), (120.0, False)):
            side = unit(np.cross(along, [0.2, 0.9, -0.4]))
            seen = math.cos(math.radians(off)) * along + math.sin(math.radians(off)) * side  # the Sun in body axes
            turn = np.cross(seen, SUN)
            half = 0.5 * math.atan2(np.linalg.norm(turn), seen @ SUN)
            at = view(np.concatenate([[math.cos(half)], math.sin(half) * unit(turn)]))
            assert one.is_available(at).tolist() == [expected]
            x, y = np.tan(one.truth(at)[0])
            assert off > 90.0 or math.hypot(x, y) == pytest.approx(math.tan(math.radians(off)), rel=1e-9)


def rim_is_seen(r_i):
    """Whether lines of sight to all points of the rim of the Sun (semidiameter 16') miss the sphere of the Earth."""
    east = unit(np.cross(SUN, [0.0, 0.0, 1.0]))
    a = np.linspace(0.0, 2.0 * np.pi, 400)[:, None]
    around = np.cos(a) * east + np.sin(a) * np.cross(SUN, east)
    lines = math.cos(math.radians(0.2666)) * SUN + math.sin(math.radians(0.2666)) * around
    nearest = np.maximum(-lines @ r_i, 0.0)[:, None] * lines + r_i
    return bool(np.all(np.linalg.norm(nearest, axis=1) > RADIUS))


def test_it_measures_where_every_line_to_the_rim_of_the_sun_misses_the_earth():
    side = unit(np.cross(SUN, [0.1, 0.2, 0.9]))
    edge = math.degrees(math.asin(RADIUS / (RADIUS + 4e5)))  # of the shadow of a Sun that is a point, 400 km up
    places = [0.0, 60.0, 100.0, *(180.0 - edge + np.array([-1.0, -0.28, -0.25, 0.0, 0.25, 0.28, 1.0])), 150.0, 180.0]
    found = []
    for off in np.radians(places):
        r_i = (RADIUS + 4e5) * (math.cos(off) * SUN + math.sin(off) * side)
        found.append(bool(card().is_available(view(facing(10.0, 0.0), r_i))[0]))
        assert found[-1] == rim_is_seen(r_i), math.degrees(off)
    assert found == [True] * 5 + [False] * 7


def test_noise_and_bias_are_of_each_angle():
    one = card(bias="0.1 deg", bias_time="100 s")
    (bias,) = one.correlated_errors()
    assert (bias.sigma, bias.time_constant, bias.labels) == (pytest.approx(math.radians(0.1)), 100.0, ("alpha", "beta"))
    np.testing.assert_array_equal(bias.partials(view(facing(1.0, 0.0)), 2)[0], np.eye(2))
    assert one.matched_model().time_constant("bias") == 100.0
    np.testing.assert_allclose(one.matched_model().variance(view(facing(1.0, 0.0))), math.radians(0.05) ** 2)
    assert math.isinf(card().correlated_errors()[0].time_constant)


@pytest.mark.parametrize(
    ("fields", "reported"),
    [
        ({"sigma": "0 deg"}, "sigma"),
        ({"field_of_view": "90 deg"}, "field_of_view"),
        ({"boresight": (0.0, 0.0, 0.0)}, "no direction"),
        ({"bias": "1 m"}, "bias"),
    ],
)
def test_what_makes_no_sense_is_refused(fields, reported):
    with pytest.raises(ValueError, match=reported):
        card(**fields)
    assert SunSensorModel.model_validate({"sigma": "1 deg"}).boresight == (1.0, 0.0, 0.0)


# ---------------------------------------------------------------------------------------------------- in both engines


@lru_cache(maxsize=1)
def still():
    """A coast of 20 s in which the body does not turn."""
    return flight([(20.0, lambda t: np.zeros(3))], lambda t: np.tile(turning(np.array([5.0])), (t.size, 1)))


def sunlit(*settings, measurements=("sun_direction",), sensor=None, **fields):
    base = loaded(MATCHED, *(settings or (INERTIAL,)))
    one = {**DATA, "boresight": (1.0, 0.0, -1.0), **(sensor or {})}
    return with_fields(base, **{"sensors": {"sun": one}, "filter.measurements": list(measurements), **SLOW, **fields})


@pytest.mark.parametrize("n", [1, 16])
def test_attitude_is_known_across_the_sun_and_not_about_it(n):
    start, sigma = math.radians(0.3), math.radians(0.05)
    prepared_case = prepare_hop(sunlit(**QUIET, **{"initial.tilt": "0.3 deg", "initial.heading": "0.3 deg"}), still())
    cov, t = covariance(prepared_case), prepared_case.t_epoch[n - 1]
    at = motion(prepared_case.trajectory, np.array([t]))
    theta = earth_angle(prepared_case.trajectory.theta0, np.array([t]))
    sun = sun_direction(prepared_case.trajectory.epoch, np.array([t]), theta)[0]
    body = matrices(at.q_b_i)[0].T @ sun

    def seen(turn):
        """The angles of the sensor after a small turn of the body, about its own axes."""
        x, y, z = axes @ (body - np.cross(turn, body))
        return np.array([math.atan2(x, z), math.atan2(y, z)])

    z = unit(np.array([1.0, 0.0, -1.0]))
    axes = np.array([unit(np.cross([0.0, 1.0, 0.0], z)), np.cross(z, unit(np.cross([0.0, 1.0, 0.0], z))), z])
    J = np.array([(seen(1e-5 * e) - seen(-1e-5 * e)) / 2e-5 for e in np.eye(3)]).T
    expected = np.linalg.inv(np.eye(3) / start**2 + n * J.T @ J / sigma**2)
    k = int(np.argmin(np.abs(cov.t - t)))
    np.testing.assert_allclose(cov.formal_cov[k, :3, :3], expected, atol=2e-4 * np.abs(expected).max())
    assert math.sqrt(body @ cov.formal_cov[k, :3, :3] @ body) == pytest.approx(start, rel=1e-3)
    across = unit(np.cross(body, [0.0, 0.0, 1.0]))
    assert math.sqrt(across @ cov.formal_cov[k, :3, :3] @ across) < 1.5 * sigma / math.sqrt(n)


@pytest.mark.parametrize("states", [(), ("sun_sensor_bias",)], ids=["neglected", "estimated"])
def test_both_engines_agree_whatever_the_filter_makes_of_the_bias(states):
    measurements = ("position", "velocity", "sun_direction")
    lasting = {"bias": "0.1 deg", "bias_time": "30 s"}
    coarse = {"initial.tilt": "0.3 deg", "initial.heading": "0.3 deg"}
    case = sunlit(LOOSE, measurements=measurements, sensor=lasting, **coarse, **{"filter.extra_states": states})
    prepared_case = prepare_hop(case)
    assert prepared_case.sensors.is_measuring.all()
    cov, _ = agree(prepared_case, [0, 1, 2, 3, 4, 5])
    budget = dict(zip(cov.sources, cov.budget[-1], strict=True))
    assert {"sun sensor bias", "sun sensor noise"} < set(budget)
    if states:
        np.testing.assert_allclose(cov.formal_sigma[-1, :3], cov.true_sigma[-1, :3], rtol=1e-3)
    else:
        assert np.any(cov.formal_sigma[-1, :3] < 0.7 * cov.true_sigma[-1, :3])
