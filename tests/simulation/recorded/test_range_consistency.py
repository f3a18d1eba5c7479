"""Ranges held against solutions, whatever the receiver's clock does: satellites on circles, a receiver at rest."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.recorded.range_consistency import RecordedRanges, check_ranges

N_EPOCH, N_SAT, RADIUS, TURN = 40, 7, 2.656e7, 1.4585e-4


def case(late: float = 0.0):
    """A case whose satellites are late by so many seconds: what the comparison sees of it."""
    t = np.arange(N_EPOCH)[:, None] + np.zeros(N_SAT) + late
    node, phase = np.linspace(0.0, 2.0, N_SAT), np.linspace(-0.4, 0.5, N_SAT) + TURN * t
    c, s, tilt = np.cos(phase), np.sin(phase), np.sin(node)
    r = RADIUS * np.stack([c, s * np.cos(node), s * tilt], axis=2)
    v = RADIUS * TURN * np.stack([-s, c * np.cos(node), c * tilt], axis=2)
    signals = SimpleNamespace(
        position=np.tile([6.378e6, 0.0, 0.0], (N_EPOCH, 1)), velocity=np.zeros((N_EPOCH, 3)), n_used=np.full(N_EPOCH, 4)
    )
    return SimpleNamespace(
        sky=SimpleNamespace(r_i=r, v_i=v, names=[f"G{k:02d}" for k in range(N_SAT)]), signals=signals
    )


def measured(needed=(0, 1)) -> RecordedRanges:
    """What a receiver with a clock that jumps measures, with noise of 1 m and 0.05 m/s."""
    true, rng = case(), np.random.default_rng(1)
    line = true.sky.r_i - true.signals.position[:, None]
    distance = np.linalg.norm(line, axis=2)
    rate = np.sum(line * true.sky.v_i, axis=2) / distance
    clock = 1e6 * rng.standard_normal((N_EPOCH, 1, 1)) * [1.0, 1e-4]
    noise = rng.standard_normal((N_EPOCH, N_SAT, 2)) * [1.0, 0.05]
    observed = np.stack([distance, rate], axis=2) + clock + noise
    return RecordedRanges(observed, np.zeros_like(observed), np.ones((N_EPOCH, N_SAT), dtype=bool), list(needed))


def test_what_the_solutions_explain_is_used_whatever_the_clock():
    used, notes = check_ranges(case(), measured(), "ranges.csv")
    assert used.all()
    assert notes == ()


@pytest.mark.parametrize(("at", "off", "said"), [(0, 950.0, "by up to 9"), (1, -40.0, "by up to 4")])
def test_a_single_measurement_that_misses_is_left_out_by_its_satellite(at, off, said):
    log = measured()
    log.measured_ranges[5, 3, at] += off
    used, (note,) = check_ranges(case(), log, "ranges.csv")
    assert np.argwhere(~used).tolist() == [[5, 3]]
    assert said in note
    assert note.endswith("left out, by satellite: G03 (1)")


def test_epochs_without_a_solution_are_not_compared():
    log, other = measured(), case()
    log.measured_ranges[5, 3, 0] += 9e5
    other.signals.n_used[5] = 0
    assert check_ranges(other, log, "ranges.csv")[1] == ()


@pytest.mark.parametrize(
    ("factor", "hint"),
    [
        (-1.0, "its sign is reversed"),
        (-1.0 / 0.190294, "a Doppler shift in Hz"),
        (1e-3, "it fits in km/s"),
        (0.5, "are the epoch and the unit right"),
    ],
)
def test_rates_that_contradict_the_solutions_are_refused_with_a_reading_that_fits(factor, hint):
    log = measured()
    log = log._replace(measured_ranges=log.measured_ranges * [1.0, factor])
    with pytest.raises(InputError, match=f"ranges.csv: range_rate_m_s contradicts the solutions: .*{hint}"):
        check_ranges(case(), log, "ranges.csv")
    assert check_ranges(case(), log._replace(columns=[0]), "ranges.csv")[1] == ()  # a filter that takes no rates


@pytest.mark.parametrize(("late", "hint"), [(18.0, "18.0 s earlier"), (-18.0, "18.0 s later")])
def test_satellites_of_another_time_are_named_with_the_time(late, hint):
    with pytest.raises(InputError, match=f"pseudorange_m contradicts the solutions: .*the satellites fit {hint}"):
        check_ranges(case(late), measured(needed=[0]), "ranges.csv")


def test_more_wild_measurements_than_a_tenth_are_refused():
    log = measured()
    log.measured_ranges[::3, 2, 0] += 5000.0
    log.measured_ranges[::3, 5, 0] -= 5000.0
    log.measured_ranges[1::3, 1, 0] -= 5000.0
    with pytest.raises(InputError, match=r"ranges.csv: 41 of 280 ranges contradict the solutions, by up to 5\.\d+ km"):
        check_ranges(case(), log, "ranges.csv")
