import math

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.optimize import brentq

from lvnav_trade.gnss.loops import (
    LoopsCard,
    code_sigma,
    coherence_loss,
    frequency_sigma,
    keeps_lock,
    lag,
    oscillator_jitter,
    phase_sigma,
    rate_sigma,
)
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT

L1, CHIP, G = SPEED_OF_LIGHT / 1575.42e6, SPEED_OF_LIGHT / 1.023e6, 9.80665
STILL = np.zeros(1)


def loops(**changes):
    return LoopsCard(**changes)


def width(ratio):
    return f"{ratio * 1.023} MHz"


@pytest.mark.parametrize(
    ("cn0", "degrees"), [(25, 14.20), (28, 9.867), (30, 7.783), (35, 4.340), (40, 2.434), (45, 1.368)]
)
def test_the_phase_noise_is_the_books(cn0, degrees):
    # Kaplan and Hegarty, figure 5.22's expression, Bn = 18 Hz, T = 20 ms.
    assert math.degrees(phase_sigma(loops(), np.array(float(cn0)))) == pytest.approx(degrees, abs=0.006)


@pytest.mark.parametrize(("cn0", "metres"), [(30, 6.87), (35, 3.74), (40, 2.08), (45, 1.17)])
def test_the_code_noise_of_a_wide_front_end_is_the_books(cn0, metres):
    card = loops(code_bandwidth="1 Hz", spacing=1.0, front_end=width(10.0))
    assert code_sigma(card, np.array(float(cn0))) == pytest.approx(metres, abs=0.006)


@pytest.mark.parametrize(
    ("ratio", "bandwidth", "integration", "threshold", "printed"),
    [
        (1.0, "0.2 Hz", "5 ms", 14.6, 0.1),
        (1.0, "0.2 Hz", "10 ms", 13.2, 0.1),
        (1.0, "0.2 Hz", "20 ms", 11.8, 0.1),
        (1.0, "0.2 Hz", "1 s", 6.5, 0.1),
        (2.0, "0.2 Hz", "20 ms", 12.4, 0.1),
        (2.0, "2 Hz", "20 ms", 18.0, 0.5),
    ],
)
def test_the_code_loop_lets_go_where_the_book_says(ratio, bandwidth, integration, threshold, printed):
    # Figure 5.28, to the digits that are printed: 3 sigma = half the spacing of one chip; b = 1 is the narrow
    # expression, b = 2 the one between.
    card = loops(code_bandwidth=bandwidth, integration=integration, front_end=width(ratio))
    found = brentq(lambda cn0: float(code_sigma(card, np.array(cn0))) - CHIP / 6.0, 0.0, 40.0)
    assert found == pytest.approx(threshold, abs=printed)


def test_the_three_expressions_of_the_code_noise_meet_where_they_change():
    for spacing in (0.25, math.pi / 4.0):
        beside = (loops(front_end=width(4.0), spacing=spacing * by) for by in (0.9999, 1.0001))
        below, above = (code_sigma(card, np.array(60.0)) for card in beside)
        assert below == pytest.approx(above, rel=2e-3)


def test_a_frequency_loop_trails_by_the_books_worked_example():
    # Second order, 2 Hz: 10 g/s (98 m/s^3) gives 36 Hz, below the threshold of 50 Hz of T = 5 ms.
    card = loops(carrier="fll", carrier_order=2, carrier_bandwidth="2 Hz", integration="5 ms")
    assert card.natural_frequency**2 == pytest.approx(14.24, abs=0.005)
    assert lag(card, np.zeros(1), np.array([98.0]), L1)[0] == pytest.approx(36.0, abs=0.2)


def most_jerk(card, cn0):
    """Return the greatest jerk (g/s) under which the loops stay in lock."""

    def kept(jerk):
        trail = lag(card, STILL, np.array([jerk * G]), L1)
        return bool(keeps_lock(card, np.array([cn0]), trail, np.full(1, card.jitter), STILL)[0])

    return brentq(lambda jerk: 1.0 if kept(jerk) else -1.0, 0.0, 1e4, xtol=1e-3)


def test_a_frequency_loop_bears_the_jerk_of_the_books_figure():
    # "at 10 Hz and 35 dB-Hz, the FLL can tolerate up to 240 g/s" (figure 5.27, T = 5 ms)
    card = loops(carrier="fll", carrier_order=2, carrier_bandwidth="10 Hz", integration="5 ms")
    assert most_jerk(card, 35.0) == pytest.approx(240.0, rel=0.02)


def test_a_phase_loop_bears_the_jerk_of_the_books_figure():
    # "while the PLL can only tolerate up to 4 g/s" (figure 5.25, third order, T = 20 ms): read off a figure
    assert most_jerk(loops(carrier_bandwidth="10 Hz", jitter="1.3 deg"), 35.0) == pytest.approx(4.0, rel=0.1)


def test_the_lag_is_the_steady_error_of_the_loop_run_on_a_ramp():
    # A third-order phase loop (Kaplan and Hegarty, figure 5.18: a3 = 1.1, b3 = 2.4) stepped under constant jerk.
    card, jerk, step = loops(carrier_bandwidth="18 Hz"), 50.0, 1e-4
    w = card.natural_frequency
    phase, slope, curve = 0.0, 0.0, 0.0
    for k in range(30000):
        error = jerk * (k * step) ** 3 / 6.0 - phase  # m
        curve += w**3 * error * step
        slope += (curve + 1.1 * w**2 * error) * step
        phase += (slope + 2.4 * w * error) * step
    expected = float(lag(card, STILL, np.array([jerk]), L1)[0]) * L1 / (2.0 * math.pi)
    assert error == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(
    ("carrier", "order", "by"),
    [("pll", 2, "acceleration"), ("pll", 3, "jerk"), ("fll", 1, "acceleration"), ("fll", 2, "jerk")],
)
def test_a_loop_trails_behind_the_derivative_that_its_order_leaves(carrier, order, by):
    card = loops(carrier=carrier, carrier_order=order)
    moved = {"acceleration": STILL, "jerk": STILL} | {by: np.full(1, -30.0)}
    other = {"acceleration": np.full(1, 30.0), "jerk": np.full(1, 30.0)} | {by: STILL}
    assert lag(card, **moved, wavelength=L1)[0] > 0.0
    assert lag(card, **other, wavelength=L1)[0] == 0.0


def test_range_rate_is_a_difference_of_phase_or_the_frequency_itself():
    cn0 = np.array(40.0)
    # 2.434 deg of 190.29 mm is 1.287 mm; the difference of two over 0.1 s is 18.2 mm/s.
    assert rate_sigma(loops(), cn0, L1) == pytest.approx(0.0182, abs=1e-4)
    card = loops(carrier="fll", carrier_order=2, carrier_bandwidth="5 Hz", integration="10 ms")
    assert rate_sigma(card, cn0, L1) == pytest.approx(L1 * float(frequency_sigma(card, cn0)))


def test_shaking_grows_beyond_one_g():
    card = loops(jitter="2 deg", vibration="3 deg/g")
    found = np.degrees(oscillator_jitter(card, np.array([0.0, G, 2.0 * G])))
    np.testing.assert_allclose(found, [2.0, 2.0, math.hypot(2.0, 3.0)])


def test_coherence_is_lost_as_the_mean_of_the_phasors_says():
    phase = np.random.default_rng(5).normal(0.0, 0.8, 200_000)
    mean = abs(np.mean(np.exp(1j * phase))) ** 2
    assert coherence_loss(loops(), STILL, np.full(1, 0.8))[0] == pytest.approx(-10.0 * math.log10(mean), abs=0.03)
    card = loops(carrier="fll", carrier_order=1, carrier_bandwidth="5 Hz", integration="10 ms")
    turning = np.exp(2j * np.pi * 30.0 * np.linspace(0.0, 0.01, 10001))
    expected = -20.0 * math.log10(abs(np.mean(turning)))
    assert coherence_loss(card, np.full(1, 30.0), STILL)[0] == pytest.approx(expected, abs=0.01)
    assert coherence_loss(card, np.full(1, 1e6), STILL)[0] == 40.0


def test_a_code_loop_without_aid_lets_go_under_acceleration():
    for aided, kept in ((True, True), (False, False)):
        card = loops(code_aided=aided, code_bandwidth="0.1 Hz")
        assert bool(keeps_lock(card, np.full(1, 45.0), STILL, STILL, np.full(1, 20.0))[0]) is kept


def test_no_signal_is_never_held():
    assert not keeps_lock(loops(), np.array([-np.inf]), STILL, STILL, STILL)[0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"carrier": "pll", "carrier_order": 1}, "carrier_order of a pll is 2 or 3"),
        ({"carrier": "fll", "carrier_order": 3}, "carrier_order of a fll is 1 or 2"),
        ({"rate_interval": "1 ms"}, "shorter than the loop's own memory"),
    ],
)
def test_loops_that_make_no_sense_are_refused(changes, message):
    with pytest.raises(ValidationError, match=message):
        loops(**changes)
