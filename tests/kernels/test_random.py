"""Keyed draws against known answers and the normal law; bounds are five standard deviations of the estimate."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import WIDTH, view
from lvnav_trade.kernels.random import cos_sin_turn, log_unit, normals, philox, seed_words, source_word

KEY = seed_words(20260801)
N = 400_000


@jit
def fill_normals(out, source, first_run, run_step, first_epoch, epoch_step, index, k0, k1):
    """Draw n groups of four, stepping the run, the epoch, or both."""
    for k in range(out.shape[0]):
        run, epoch = np.uint64(first_run + k * run_step), np.uint64(first_epoch + k * epoch_step)
        n0, n1, n2, n3 = normals(k0, k1, source, run, epoch, index)
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = n0, n1, n2, n3


@jit
def four_of_eight_runs(out, runs, source, epoch, index, k0, k1):
    o, r = view(out), view(runs)
    n0, n1, n2, n3 = normals(k0, k1, source, r[0], epoch, index)
    o[0], o[1], o[2], o[3] = n0, n1, n2, n3


@jit
def logarithms(out, x):
    for k in range(x.size):
        out[k] = log_unit(x[k])


@jit
def turns(out, words):
    for k in range(words.size):
        out[k, 0], out[k, 1] = cos_sin_turn(words[k])


def over_runs(n, source="a", epoch=7, index=0, first=0, key=KEY):
    out = np.empty((n, 4))
    fill_normals(out, source_word(source), first, 1, epoch, 0, np.uint64(index), *key)
    return out


def over_epochs(n, source="a", run=3, index=0):
    out = np.empty((n, 4))
    fill_normals(out, source_word(source), run, 0, 1, 1, np.uint64(index), *KEY)
    return out


ALL_ONES = 0xFFFFFFFF


@pytest.mark.parametrize(
    ("counter_and_key", "words"),
    [  # Salmon et al., Random123, known-answer tests of philox4x32-10
        ((0,) * 6, (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((ALL_ONES,) * 6, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    ],
)
def test_philox_gives_the_published_known_answers(counter_and_key, words):
    assert philox(*(np.uint64(word) for word in counter_and_key)) == words


def test_the_logarithm_is_good_to_2_ulp_where_the_draws_need_it():
    rng = np.random.default_rng(3)
    grid = (rng.integers(0, 2**32, 200_000) + 0.5) * 2.0**-32  # what a draw takes: (word + 0.5) / 2**32
    edges = np.array([2.0**-33, 2.0**-32, 0.5, np.sqrt(0.5), np.nextafter(np.sqrt(0.5), 0), 1.0 - 2.0**-33, 1.0])
    x = np.concatenate([grid, edges, 1.0 - np.arange(1, 2000) * 2.0**-33])
    out = np.empty_like(x)
    logarithms(out, x)
    exact = np.log(x.astype(np.longdouble))
    error = np.abs(out - exact).astype(float)
    # near one the logarithm is itself small: there the kernel promises 1e-16 absolute
    assert np.all(error <= np.maximum(2.0 * np.spacing(np.abs(exact).astype(float)), 1e-16))


def test_cosine_and_sine_of_a_turn_are_good_to_1e_15():
    rng = np.random.default_rng(4)
    eighths = (np.arange(0, 9) * 2**29)[:, None] + np.array([-1, 0, 1])
    words = np.concatenate([rng.integers(0, 2**32, 200_000), np.clip(eighths.ravel(), 0, 2**32 - 1)]).astype(np.uint64)
    out = np.empty((words.size, 2))
    turns(out, words)
    two_pi = 2.0 * np.longdouble("3.14159265358979323846264338327950288")
    angle = words.astype(np.longdouble) / np.longdouble(2**32) * two_pi
    assert np.max(np.abs(out[:, 0] - np.cos(angle))) < 1e-15
    assert np.max(np.abs(out[:, 1] - np.sin(angle))) < 1e-15


@pytest.mark.parametrize("draw", [over_runs, over_epochs])
def test_draws_have_the_moments_of_the_normal_law(draw):
    x = draw(N).ravel()
    n = x.size
    # variances of the sample moments of a standard normal: 1, 2, 15, 96 over n
    assert abs(np.mean(x)) < 5.0 / math.sqrt(n)
    assert abs(np.mean(x**2) - 1.0) < 5.0 * math.sqrt(2.0 / n)
    assert abs(np.mean(x**3)) < 5.0 * math.sqrt(15.0 / n)
    assert abs(np.mean(x**4) - 3.0) < 5.0 * math.sqrt(96.0 / n)


def test_draws_fill_two_hundred_equally_probable_bins_evenly():
    counts, _ = np.histogram(stats.norm.cdf(over_runs(N)), bins=200, range=(0.0, 1.0))
    expected = 4 * N / 200
    # chi-square with 199 degrees of freedom, one fixed seed: refused at 1e-6
    assert np.sum((counts - expected) ** 2 / expected) < stats.chi2.ppf(1.0 - 1e-6, 199)


def test_tails_follow_the_normal_law_out_to_five_sigma():
    n, block = 8_000_000, 50_000  # a block stays in the processor's cache
    limits = (1.0, 2.0, 3.0, 4.0, 5.0)
    counts, largest = np.zeros(len(limits)), 0.0
    for first in range(0, n, block):
        x = np.abs(over_runs(block, first=first))
        counts += [np.count_nonzero(x > limit) for limit in limits]
        largest = max(largest, x.max())
    for limit, count in zip(limits, counts, strict=True):
        expected = 4 * n * 2.0 * stats.norm.sf(limit)
        assert expected > 15.0  # enough for the count's own spread, its root, to mean something
        assert abs(count - expected) < 5.0 * math.sqrt(expected)
    # the smallest value of the uniform is 2**-33
    assert largest < math.sqrt(2.0 * 33.0 * math.log(2.0))


def test_the_four_draws_of_a_group_are_uncorrelated():
    x = over_runs(N)
    products = np.corrcoef(x.T) - np.eye(4)
    squares = np.corrcoef((x**2).T) - np.eye(4)
    assert np.max(np.abs(products)) < 5.0 / math.sqrt(N)
    assert np.max(np.abs(squares)) < 5.0 / math.sqrt(N)


@pytest.mark.parametrize(
    "other",
    [
        {"source": "b"},
        {"epoch": 8},
        {"index": 1},
        {"first": 1},
        {"first": N},
        {"key": seed_words(20260802)},
        {"key": seed_words(20260801 + 2**32)},
    ],
    ids=str,
)
def test_streams_of_another_source_epoch_satellite_run_or_seed_are_uncorrelated(other):
    x, y = over_runs(N), over_runs(N, **other)
    limit = 5.0 / math.sqrt(N)
    for i in range(4):
        for j in range(4):
            assert abs(np.mean(x[:, i] * y[:, j])) < limit
    assert abs(np.mean((x**2 - 1.0) * (y**2 - 1.0))) < 2.0 * limit


def test_a_run_is_white_over_its_epochs():
    x = over_epochs(N)[:, 0]
    for lag in (1, 2, 10, 200):
        assert abs(np.mean(x[lag:] * x[:-lag])) < 5.0 / math.sqrt(N - lag)


def test_a_draw_does_not_depend_on_what_was_drawn_before():
    late = over_runs(10, first=990)
    np.testing.assert_array_equal(over_runs(1000)[990:], late)
    np.testing.assert_array_equal(over_runs(10, first=990), late)


def test_drawing_leaves_the_global_generator_of_numpy_alone():
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    over_runs(100)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


def test_eight_runs_draw_what_each_draws_alone():
    runs = np.array([[0, 1, 2, 77, 1000, 2**31, 2**32 - 1, 5]], dtype=np.uint64)
    out = np.empty((4, WIDTH))
    four_of_eight_runs(out, runs, source_word("a"), np.uint64(9), np.uint64(2), *KEY)
    alone = np.array([normals(*KEY, source_word("a"), run, np.uint64(9), np.uint64(2)) for run in runs[0]])
    # the only difference allowed is that of a fused multiply-add in logarithm and series
    np.testing.assert_allclose(out.T, alone, rtol=0.0, atol=1e-14)


def test_names_of_sources_have_words_of_their_own():
    names = [f"G{n:02d}" for n in range(1, 64)] + ["receiver clock", "range noise", "gyro bias repeatability 0"]
    assert len({int(source_word(name)) for name in names}) == len(names)


def test_a_seed_of_64_bits_is_kept_whole():
    low, high = seed_words(2**63 + 12345)
    assert (int(high) << 32) + int(low) == 2**63 + 12345
