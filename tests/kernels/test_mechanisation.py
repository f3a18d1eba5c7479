"""Windows in local axes and with products of all pairs: cut in two they are the same flight, the sums are integrals."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.filter.strapdown_algorithm import StrapdownCard, build_strapdown
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import N_SUM, SUM_C, SUM_F, SUM_TH, SUM_V

START = np.array([0.6, 0.0, 0.8, 0.0, 10.0, 465.0, 30.0, 6378137.0, 2e4, 1e3])
STEP = 0.005
FORMS = [("ned", "two_sample", 1), ("enu", "recursive", 2), ("inertial", "recursive", 2), ("earth", "polynomial", 2)]


def increments(n: int) -> np.ndarray:
    t = STEP * np.arange(n)[:, None]
    rate = np.hstack([0.5 + 0.0 * t, 0.1 * np.sin(9.0 * t), 0.2 * np.cos(9.0 * t)])
    return STEP * np.hstack([rate, 20.0 + 3.0 * np.sin(7.0 * t), 1.0 + 0.0 * t, -2.0 * np.cos(5.0 * t)])


@pytest.mark.parametrize(("frame", "algorithm", "ratio"), FORMS)
def test_a_window_cut_in_two_is_the_same_flight(frame: str, algorithm: str, ratio: int) -> None:
    how, taken = build_strapdown(StrapdownCard(algorithm=algorithm, ratio=ratio), "j4", frame, 0.3), increments(40)
    whole, parts = START.copy(), START.copy()
    of_whole, first, second = np.zeros((3, N_SUM))
    before = np.zeros(6)
    mechanise(whole, of_whole, before, taken, 40 // ratio, ratio * STEP, how, 5.0)
    before = np.zeros(6)
    mechanise(parts, first, before, taken[:16], 16 // ratio, ratio * STEP, how, 5.0)
    mechanise(parts, second, before, taken[16:], 24 // ratio, ratio * STEP, how, 5.0 + 16 * STEP)
    parts[:4] *= np.sign(parts[:4] @ whole[:4])  # a quaternion and its negative are one attitude
    np.testing.assert_allclose(parts, whole, rtol=1e-12, atol=1e-6)
    # the turn of the axes is taken at the middle of each window
    np.testing.assert_allclose(first + second, of_whole, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("frame", "algorithm", "ratio"), FORMS)
def test_the_sums_are_those_of_the_inertial_frame(frame: str, algorithm: str, ratio: int) -> None:
    found, plain, taken = np.zeros(N_SUM), np.zeros(N_SUM), increments(40)
    how = build_strapdown(StrapdownCard(algorithm=algorithm, ratio=ratio), "j4", frame, 0.3)
    mechanise(START.copy(), found, np.zeros(6), taken, 40 // ratio, ratio * STEP, how, 5.0)
    mechanise(START.copy(), plain, np.zeros(6), taken, 40, STEP, build_strapdown(StrapdownCard(), "j4"), 5.0)
    np.testing.assert_allclose(found[SUM_TH:], plain[SUM_TH:], rtol=1e-13)
    assert (SUM_TH, SUM_F) == (12, 15)
    np.testing.assert_allclose(found[SUM_C : SUM_C + 9], plain[SUM_C : SUM_C + 9], atol=2e-5)
    np.testing.assert_allclose(found[SUM_V : SUM_V + 3], plain[SUM_V : SUM_V + 3], atol=2e-3)
