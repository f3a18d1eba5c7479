"""Coefficients of the Allan variance: exact covariance, published deviations, intervals that cover the true values."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics.imu_stream import stream_at_rest
from lvnav_trade.imu import allan
from lvnav_trade.imu.allan_fit import NAMES, fit, ladder
from tests.building import case

SQUARES = np.array([1e-3, 1.0, 0.3, 0.05])
# Flicker noise of a card is a sum of processes, held over a step of 0.1 s: not flicker below some seconds. 2.5 times as
# large beside this white noise it moves the white noise by 1.4 %, and 0.83 of its intervals cover it.
CARD = (
    "base.imu.rate=10 Hz", "base.imu.process_rate=10 Hz", "base.filter.strapdown.ratio=1",
    "base.imu.gyro.random_walk=0.1 deg/sqrt(h)", "base.imu.gyro.quantisation=2 arcsec",
    "base.imu.gyro.bias_instability=2 deg/h", "base.imu.gyro.rate_random_walk=0 deg/h/sqrt(h)",
    "base.imu.gyro.instability_fit={processes: 6, shortest: 1 s, longest: 3000 s}",
    "base.imu.accel.random_walk=0.2 m/s/sqrt(h)", "base.imu.accel.quantisation=1 mm/s",
    "base.imu.accel.bias_instability=0 mg", "base.imu.accel.rate_random_walk=5 mg/sqrt(h)",
)  # fmt: skip


def test_the_overlapping_deviations_are_those_that_nist_prints():
    """NIST SP 1065, section 12.4: 1000 numbers of its generator, overlapping Allan deviation over 1, 10, 100."""
    numbers, seed = [], 1234567890
    for _ in range(1000):
        numbers.append(seed / 2147483647.0)
        seed = 16807 * seed % 2147483647
    found = allan.overlapping(np.array(numbers), 1.0, [1, 10, 100])
    np.testing.assert_allclose(found, [2.922319e-01, 9.159953e-02, 3.241343e-02], rtol=5e-7)


def test_the_overlapping_deviations_are_those_of_allantools():
    allantools = pytest.importorskip("allantools")
    rates, factors = np.random.default_rng(1).standard_normal(5000), [1, 2, 5, 13, 40, 200, 500]
    times, theirs, _, _ = allantools.oadev(rates, rate=10.0, data_type="freq", taus=[0.1 * m for m in factors])
    np.testing.assert_allclose(times, 0.1 * np.array(factors))
    np.testing.assert_allclose(allan.overlapping(rates, 0.1, factors), theirs, rtol=1e-12)


def test_averaging_times_are_six_a_decade_up_to_a_ninth_of_the_stream():
    factors = ladder(90_000, 0.01)
    assert (factors[0], factors[-1]) == (1, 10_000)
    assert len(factors) <= 25
    assert np.all(np.diff(np.log10(factors[6:])) < 0.2)
    part = ladder(90_000, 0.01, 1.0, 10.0)
    assert (part[0], part[-1], len(part)) == (100, 1000, 7)
    assert ladder(10, 1.0) == [1]
    assert ladder(1000, 1.0, 500.0) == []


def test_what_a_stream_cannot_show_is_bounded():
    rng = np.random.default_rng(4)
    found = fit(rng.standard_normal(20_000), 0.1, ladder(20_000, 0.1)).coefficients
    assert found["random_walk"].low <= math.sqrt(0.1) <= found["random_walk"].high
    for name in ("quantisation", "bias_instability", "rate_random_walk"):
        assert not found[name].is_significant
        assert found[name].value == found[name].low == 0.0 < found[name].high


def test_errors_that_no_process_of_the_fit_has_make_the_intervals_wider():
    rng, n = np.random.default_rng(4), 20_000
    rates = rng.standard_normal(n) + 2.0 * np.sin(0.7 * np.arange(n))
    assert fit(rates, 0.1, ladder(n, 0.1)).spread > 3.0


@pytest.mark.slow
def test_intervals_cover_the_card_in_90_to_98_5_percent_of_200_streams_of_the_kernels():
    prepared_case = case(*CARD)
    imu, n, dt = prepared_case.scenario.imu, 20_000, 0.1
    factors = ladder(n, dt, longest=300.0)
    true = {first: [getattr(card, name) for name in NAMES] for first, card in ((0, imu.gyro), (3, imu.accel))}
    hits = dict[tuple[int, str], list[bool]]()
    for seed in range(67):
        means = stream_at_rest(prepared_case, 0, imu, n, seed)
        for first, axis in product((0, 3), range(3)):
            found = fit(means[:, first + axis], dt, factors).coefficients
            for name, value in zip(NAMES, true[first], strict=True):
                if value > 0.0:
                    one = found[name]
                    hits.setdefault((first, name), []).append(one.is_significant and one.low <= value <= one.high)
    shares = {key: float(np.mean(some[:200])) for key, some in hits.items()}
    assert {key: share for key, share in shares.items() if not 0.90 <= share <= 0.985} == {}
    assert len(shares) == 6
