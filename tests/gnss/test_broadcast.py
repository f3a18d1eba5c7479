"""Broadcast ephemerides and states against algorithms of their own and precise orbits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lvnav_trade.gnss.broadcast import EARTH_RATE_PZ90, GM_PZ90, acceleration, broadcast_ephemerides, integrated_states
from lvnav_trade.gnss.kepler import EARTH_RATE_GPS
from lvnav_trade.gnss.rinex import Ephemeris, StateVector, read_navigation
from lvnav_trade.gnss.satellites import nearest_records
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from tests.trajectory.products import gps_time, read_sp3

MIXED = "gnss/rinex3/VILL00ESP_R_20181700000_01D_MN.rnx.gz"
NOW = np.zeros(1)


def own(**changes):
    """Return an ephemeris with every term at work, of no real satellite."""
    name, numbers = changes.pop("name", "G07"), {
        "clock_bias": 1e-4, "clock_drift": 2e-11,
        "clock_drift_rate": 3e-19, "radius_sin": -60.0, "mean_motion_difference": 4.6e-9, "mean_anomaly": 1.0,
        "latitude_cos": -4e-6, "eccentricity": 0.02, "latitude_sin": 5e-6, "root_axis": 5153.6, "week_second": 352784.0,
        "inclination_cos": -2e-7, "node": -1.5, "inclination_sin": 1e-7, "inclination": 0.96, "radius_cos": 280.0,
        "perigee": 0.7, "node_rate": -8e-9, "inclination_rate": -4e-10,
        "group_delay": 0.0, "data_source": 0.0,
    }  # fmt: skip
    return Ephemeris(name, 1.2e9, 1.2e9 + 16.0, 0.0, numbers | changes)


@pytest.mark.parametrize(
    ("name", "moment", "age", "expected"),
    [
        ("G02", (1, 0), -3584.0, (-13666506.9427, -14242199.1285, -17991254.9747)),
        ("G30", (13, 15), -2684.0, (18365156.4859, -18624425.7772, -4860623.9445)),
        ("G17", (6, 30), 1800.0, (20068622.388, -11636164.7697, -12631810.9945)),
    ],
)
def test_published_worked_examples_are_met_to_a_tenth_of_a_millimetre(refdata, name, moment, age, expected):
    records = read_navigation(refdata / "gnss/rinex2/brdc1820.10n").ephemerides
    time = gps_time(2010, 7, 1, *moment)
    (record,) = (item for item in records if item.name == name and time - item.toe == age)
    r_e, _ = broadcast_ephemerides([record], time).ecef(NOW)
    np.testing.assert_allclose(r_e[0], expected, rtol=0.0, atol=1e-4)


def test_broadcast_against_precise_orbits_has_the_published_rms(refdata, record_property):
    # The two satellites that the file calls unhealthy (G01 has no precise clock either) are left out: 30 x 96.
    records = read_navigation(refdata / "gnss/rinex2/brdc1820.10n").ephemerides
    precise, timed = read_sp3(refdata / "gnss/sp3/igs15904.sp3")
    errors = []
    for time, here in precise.items():
        near = {
            name: item for name, item in nearest_records(records, time).items() if item.health == 0.0 and name in timed
        }
        r_e, v_e = broadcast_ephemerides(list(near.values()), time).ecef(NOW)
        v_i = v_e + EARTH_RATE_GPS * np.stack([-r_e[:, 1], r_e[:, 0], 0.0 * r_e[:, 0]], axis=-1)
        cross = np.cross(r_e, v_i)
        axes = np.stack([r_e, np.cross(cross, r_e), cross], axis=1)
        axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
        errors.append(np.einsum("sij,sj->si", axes, r_e - np.array([here[name] for name in near])))
    error = np.concatenate(errors)
    assert error.shape == (30 * 96, 3)
    size = np.linalg.norm(error, axis=1)
    found = np.array([np.sqrt(np.mean(size**2)), np.median(size), np.quantile(size, 0.95), size.max()])
    record_property("broadcast against precise orbits: RMS, median, 95 %, maximum in m", np.round(found, 3).tolist())
    assert found[:2] == pytest.approx([1.866, 1.642], abs=5e-4)
    assert found[2:] == pytest.approx([3.30, 5.71], abs=5e-3)
    # RMS radial, along and across the track; mean radial: the antenna lies that much off the centre of mass.
    np.testing.assert_allclose(np.sqrt(np.mean(error**2, axis=0)), [1.003, 1.484, 0.525], rtol=0.0, atol=5e-4)
    assert np.mean(error[:, 0]) == pytest.approx(-0.747, abs=5e-4)


@pytest.mark.parametrize(("letter", "rms", "most"), [("G", 0.96, 4.61), ("E", 0.11, 0.92)])
def test_successive_ephemerides_meet_half_way(refdata, record_property, letter, rms, most):
    records = [item for item in read_navigation(refdata / MIXED).ephemerides if item.name[0] == letter]
    by_time = {(item.name, item.toe): item for item in records if item.health == 0.0}
    gaps = []
    for (name, toe), item in by_time.items():
        after = [other for key, other in by_time.items() if key[0] == name and 0.0 < key[1] - toe <= 7200.0]
        if after:
            other = min(after, key=lambda item: item.toe)
            ours, theirs = (broadcast_ephemerides([one], 0.5 * (toe + other.toe)).ecef(NOW)[0] for one in (item, other))
            gaps.append(np.linalg.norm(ours - theirs))
    assert len(gaps) > 150
    record_property(
        f"{letter}: RMS gap half way to the next ephemeris in m", round(float(np.sqrt(np.mean(np.square(gaps)))), 3)
    )
    assert np.sqrt(np.mean(np.square(gaps))) == pytest.approx(rms, abs=0.01)
    assert max(gaps) == pytest.approx(most, abs=0.01)


def test_galileo_stands_on_its_circle_of_29600_km(refdata):
    near = nearest_records(read_navigation(refdata / MIXED).ephemerides, gps_time(2018, 6, 19, 12, 0, 0))
    galileo = [item for item in near.values() if item.name[0] == "E" and item.health == 0.0]
    r_e, _ = broadcast_ephemerides(galileo, gps_time(2018, 6, 19, 12, 0, 0)).ecef(NOW)
    # E14 and E18 fly the eccentric orbits that a failed injection of 2014 left them.
    round_ones = [k for k, item in enumerate(galileo) if item.name not in ("E14", "E18")]
    assert len(round_ones) >= 14
    np.testing.assert_allclose(np.linalg.norm(r_e[round_ones], axis=1), 29600.318e3, rtol=0.0, atol=30e3)
    for item in (galileo[k] for k in round_ones):
        assert math.degrees(item.elements["inclination"]) == pytest.approx(56.0, abs=2.0)


def test_velocity_is_the_derivative_of_position_with_every_term_at_work():
    above = broadcast_ephemerides([own(), own(name="E03", root_axis=5440.6, eccentricity=0.4)], 1.2e9)
    t, step = np.linspace(-7200.0, 40000.0, 23)[:, None], 0.25
    difference = (above.ecef(t + step)[0] - above.ecef(t - step)[0]) / (2.0 * step)
    np.testing.assert_allclose(above.ecef(t)[1], difference, rtol=0.0, atol=2e-5)


def test_the_reference_of_time_does_not_move_the_satellites():
    early, late = broadcast_ephemerides([own()], 1.2e9), broadcast_ephemerides([own()], 1.2e9 + 3600.0)
    np.testing.assert_allclose(early.ecef(NOW + 3600.0)[0], late.ecef(NOW)[0], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(early.clock(NOW + 3600.0), late.clock(NOW), rtol=0.0, atol=1e-18)
    np.testing.assert_allclose(early.relativity(NOW + 3600.0), late.relativity(NOW), rtol=0.0, atol=1e-18)


def test_the_clock_is_the_polynomial_from_its_own_reference_time():
    above = broadcast_ephemerides([own()], 1.2e9)
    expected = 1e-4 + 2e-11 * 1000.0 + 3e-19 * 1000.0**2
    assert SPEED_OF_LIGHT * (above.clock(NOW + 1000.0)[0] - expected) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("name", "root_axis"), [("G07", 5153.6), ("E03", 5440.6)])
def test_the_relativistic_term_is_minus_two_r_v_over_c_squared_to_a_millimetre(name, root_axis):
    # On a Kepler orbit 2 r.v / c^2 equals it; harmonic terms are off, and v is inertial.
    still = dict.fromkeys([
        "radius_sin", "radius_cos", "latitude_sin", "latitude_cos", "inclination_sin", "inclination_cos",
        "inclination_rate", "node_rate", "mean_motion_difference",
    ], 0.0)  # fmt: skip
    above = broadcast_ephemerides([own(name=name, root_axis=root_axis, **still)], 1.2e9)
    t = np.linspace(0.0, 43200.0, 13)[:, None]
    r_e, v_e = above.ecef(t)
    v_i = v_e + EARTH_RATE_GPS * np.stack([-r_e[..., 1], r_e[..., 0], 0.0 * r_e[..., 0]], axis=-1)
    term = SPEED_OF_LIGHT * above.relativity(t)
    assert np.max(np.abs(term)) > 10.0
    np.testing.assert_allclose(term, -2.0 * np.sum(r_e * v_i, axis=-1) / SPEED_OF_LIGHT, rtol=0.0, atol=1e-3)


def test_broadcast_clocks_agree_with_precise_ones_to_some_nanoseconds(refdata):
    records = read_navigation(refdata / "gnss/rinex2/brdc1820.10n").ephemerides
    time = gps_time(2010, 7, 1, 12, 0, 0)
    text = (refdata / "gnss/sp3/igs15904.sp3").read_text()
    block = text.split("*  2010  7  1 12  0  0.00000000")[1].split("\n*")[0]
    precise = {line[1:4]: 1e-6 * float(line[46:60]) for line in block.splitlines() if line.startswith("P")}
    near = {k: v for k, v in nearest_records(records, time).items() if v.health == 0.0 and precise.get(k, 1.0) < 0.5}
    above = broadcast_ephemerides(list(near.values()), time)
    ours, theirs = above.clock(NOW), np.array([precise[name] for name in near])
    difference = SPEED_OF_LIGHT * (ours - theirs)  # precise clocks leave the relativistic term out as well
    assert np.max(np.abs(SPEED_OF_LIGHT * theirs)) > 1e5
    np.testing.assert_allclose(difference - np.median(difference), 0.0, rtol=0.0, atol=3.0)


MIXED = "gnss/rinex3/VILL00ESP_R_20181700000_01D_MN.rnx.gz"
R_E, V_E, A_E = (1577503.9, 11010770.5, 22963750.0), (-3095.803, 528.106, -39.038), (0.0, -9.3e-7, -2.8e-6)
STATE = StateVector("R01", 1.2e9, 2.8e-5, 1e-12, R_E, V_E, A_E, 0.0)


def test_the_integration_agrees_with_a_method_of_eighth_order_forwards_and_backwards():
    above = integrated_states([STATE], STATE.time)
    for end in (900.0, -900.0, 3600.0, -3600.0):
        exact = solve_ivp(
            lambda _, y: np.concatenate([y[3:], acceleration(y[:3], y[3:], np.array(A_E))]),
            (0.0, end), np.array([*R_E, *V_E]), method="DOP853", rtol=1e-13, atol=1e-6,
        ).y[:, -1]  # fmt: skip
        r_e, v_e = above.ecef(np.array([end]))
        np.testing.assert_allclose(r_e[0], exact[:3], rtol=0.0, atol=2e-4)
        np.testing.assert_allclose(v_e[0], exact[3:], rtol=0.0, atol=1e-7)


def test_without_flattening_moon_and_sun_energy_in_inertial_space_is_kept(monkeypatch):
    monkeypatch.setattr("lvnav_trade.gnss.broadcast.J2_PZ90", 0.0)
    above = integrated_states([STATE._replace(a_e=(0.0, 0.0, 0.0))], STATE.time)
    r_e, v_e = above.ecef(np.linspace(0.0, 40544.0, 50)[:, None])
    v_i = v_e + EARTH_RATE_PZ90 * np.stack([-r_e[..., 1], r_e[..., 0], 0.0 * r_e[..., 0]], axis=-1)
    energy = 0.5 * np.sum(v_i * v_i, axis=-1) - GM_PZ90 / np.linalg.norm(r_e, axis=-1)
    np.testing.assert_allclose(energy, np.full_like(energy, energy[0, 0]), rtol=1e-10)


def test_flattening_attracts_as_the_gradient_of_its_potential():
    def potential(r):
        from lvnav_trade.gnss.broadcast import EQUATOR_PZ90, J2_PZ90

        size = np.linalg.norm(r)
        return GM_PZ90 / size * (1.0 - J2_PZ90 * (EQUATOR_PZ90 / size) ** 2 * (1.5 * (r[2] / size) ** 2 - 0.5))

    r, step = np.array(R_E), 200.0
    gradient = [(potential(r + d) - potential(r - d)) / (2.0 * step) for d in step * np.eye(3)]
    turning = EARTH_RATE_PZ90**2 * np.array([r[0], r[1], 0.0])
    np.testing.assert_allclose(acceleration(r, np.zeros(3), np.zeros(3)) - turning, gradient, rtol=0.0, atol=2e-9)


def test_broadcast_states_are_carried_to_the_next_ones_within_metres(refdata, record_property):
    states = [state for state in read_navigation(refdata / MIXED).states if state.health == 0.0]
    by_time = {(state.name, state.time): state for state in states}
    whole, half = [], []
    for (name, time), state in by_time.items():
        after = by_time.get((name, time + 1800.0))
        if after is not None:
            ahead = integrated_states([state], time).ecef(np.array([[900.0], [1800.0]]))[0][:, 0]
            back = integrated_states([after], time).ecef(np.array([900.0]))[0][0]
            whole.append(np.linalg.norm(ahead[1] - after.r_e))
            half.append(np.linalg.norm(ahead[0] - back))
    assert len(whole) == 386
    rms = [float(np.sqrt(np.mean(np.square(found)))) for found in (half, whole)]
    record_property("GLONASS integrated to half way and to the next state, RMS in m", np.round(rms, 2).tolist())
    assert rms == pytest.approx([1.16, 2.56], abs=0.01)
    assert max(half) < 4.2
    assert max(whole) < 7.0


def test_velocity_is_the_derivative_of_position_across_the_steps():
    above, step = integrated_states([STATE, STATE._replace(name="R02", time=1.2e9 + 7.0)], 1.2e9), 0.05
    t = np.array([-901.0, -30.0, -3.0, 0.0, 7.0, 29.99, 30.0, 33.3, 1000.0])[:, None]
    difference = (above.ecef(t + step)[0] - above.ecef(t - step)[0]) / (2.0 * step)
    np.testing.assert_allclose(above.ecef(t)[1], difference, rtol=0.0, atol=2e-6)


def test_at_the_broadcast_time_the_broadcast_state_stands_and_no_times_are_no_states():
    above = integrated_states([STATE], STATE.time - 500.0)
    r_e, v_e = above.ecef(np.array([[500.0]]))
    np.testing.assert_allclose(r_e[0, 0], R_E, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(v_e[0, 0], V_E, rtol=0.0, atol=1e-10)
    assert above.ecef(np.empty((0, 1)))[0].shape == (0, 1, 3)


def test_the_broadcast_clock_holds_relativity():
    above, t = integrated_states([STATE], STATE.time - 500.0), np.array([[500.0], [600.0]])
    np.testing.assert_allclose(above.clock(t)[:, 0], [2.8e-5, 2.8e-5 + 1e-10], rtol=1e-12)
    np.testing.assert_array_equal(above.relativity(t), np.zeros((2, 1)))
