import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lvnav_trade.world.sky.glonass import EARTH_RATE_PZ90, GM_PZ90, acceleration, integrated
from lvnav_trade.world.sky.rinex import StateVector, read_navigation

MIXED = "gnss/rinex3/VILL00ESP_R_20181700000_01D_MN.rnx.gz"
R_E, V_E, A_E = (1577503.9, 11010770.5, 22963750.0), (-3095.803, 528.106, -39.038), (0.0, -9.3e-7, -2.8e-6)
STATE = StateVector("R01", 1.2e9, 2.8e-5, 1e-12, R_E, V_E, A_E, 0.0)


def test_the_integration_agrees_with_a_method_of_eighth_order_forwards_and_backwards():
    above = integrated([STATE], STATE.time)
    for end in (900.0, -900.0, 3600.0, -3600.0):
        exact = solve_ivp(
            lambda _, y: np.concatenate([y[3:], acceleration(y[:3], y[3:], np.array(A_E))]),
            (0.0, end), np.array([*R_E, *V_E]), method="DOP853", rtol=1e-13, atol=1e-6,
        ).y[:, -1]  # fmt: skip
        r_e, v_e = above.ecef(np.array([end]))
        np.testing.assert_allclose(r_e[0], exact[:3], rtol=0.0, atol=2e-4)
        np.testing.assert_allclose(v_e[0], exact[3:], rtol=0.0, atol=1e-7)


def test_without_flattening_moon_and_sun_energy_in_inertial_space_is_kept(monkeypatch):
    monkeypatch.setattr("lvnav_trade.world.sky.glonass.J2_PZ90", 0.0)
    above = integrated([STATE._replace(a_e=(0.0, 0.0, 0.0))], STATE.time)
    r_e, v_e = above.ecef(np.linspace(0.0, 40544.0, 50)[:, None])
    v_i = v_e + EARTH_RATE_PZ90 * np.stack([-r_e[..., 1], r_e[..., 0], 0.0 * r_e[..., 0]], axis=-1)
    energy = 0.5 * np.sum(v_i * v_i, axis=-1) - GM_PZ90 / np.linalg.norm(r_e, axis=-1)
    np.testing.assert_allclose(energy, np.full_like(energy, energy[0, 0]), rtol=1e-10)


def test_flattening_attracts_as_the_gradient_of_its_potential():
    def potential(r):
        from lvnav_trade.world.sky.glonass import EQUATOR_PZ90, J2_PZ90

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
            ahead = integrated([state], time).ecef(np.array([[900.0], [1800.0]]))[0][:, 0]
            back = integrated([after], time).ecef(np.array([900.0]))[0][0]
            whole.append(np.linalg.norm(ahead[1] - after.r_e))
            half.append(np.linalg.norm(ahead[0] - back))
    assert len(whole) == 386
    rms = [float(np.sqrt(np.mean(np.square(found)))) for found in (half, whole)]
    record_property("GLONASS integrated to half way and to the next state, RMS in m", np.round(rms, 2).tolist())
    assert rms == pytest.approx([1.16, 2.56], abs=0.01)
    assert max(half) < 4.2
    assert max(whole) < 7.0


def test_velocity_is_the_derivative_of_position_across_the_steps():
    above, step = integrated([STATE, STATE._replace(name="R02", time=1.2e9 + 7.0)], 1.2e9), 0.05
    t = np.array([-901.0, -30.0, -3.0, 0.0, 7.0, 29.99, 30.0, 33.3, 1000.0])[:, None]
    difference = (above.ecef(t + step)[0] - above.ecef(t - step)[0]) / (2.0 * step)
    np.testing.assert_allclose(above.ecef(t)[1], difference, rtol=0.0, atol=2e-6)


def test_at_the_broadcast_time_the_broadcast_state_stands_and_no_times_are_no_states():
    above = integrated([STATE], STATE.time - 500.0)
    r_e, v_e = above.ecef(np.array([[500.0]]))
    np.testing.assert_allclose(r_e[0, 0], R_E, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(v_e[0, 0], V_E, rtol=0.0, atol=1e-10)
    assert above.ecef(np.empty((0, 1)))[0].shape == (0, 1, 3)


def test_the_broadcast_clock_holds_relativity():
    above, t = integrated([STATE], STATE.time - 500.0), np.array([[500.0], [600.0]])
    np.testing.assert_allclose(above.clock(t)[:, 0], [2.8e-5, 2.8e-5 + 1e-10], rtol=1e-12)
    np.testing.assert_array_equal(above.relativity(t), np.zeros((2, 1)))
