"""Noise of the receiver over the flight, errors common to all range rates, two frequencies: in both engines."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.covariance.history import covariance
from lvnav_trade.covariance.selfcheck.measured import measurement_checks
from lvnav_trade.gnss.reception import dynamics_at
from lvnav_trade.quantities.shared_cards import noise_factor
from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import LOOSE, MATCHED, loaded, prepare_hop, with_fields
from tests.covariance.diagnostics.checked import failed

RUNS, ALPHA = 400, 1e-3
# the short flight has 20 s of thrust, 19 m/s^2, and then none
GROWN = [{"specific_force": ["0 m/s^2", "20 m/s^2"], "factor": [1.0, 4.0]}]
SHELL = {"ionosphere": {"kind": "content", "vertical": "60 TECU"}, "ionosphere_scale": "50 percent"}


@lru_cache(maxsize=16)
def prepare_case(coupling, *changed):
    scenario = loaded(MATCHED, *([LOOSE] if coupling == "loose" else []))
    return prepare_hop(with_fields(scenario, **dict(changes(*changed))))


def changes(*names):
    every = {
        "grown": ("receiver.noise_by", GROWN), "shell": ("atmosphere", SHELL),
        "two": ("receiver.frequencies", "L1_L2"), "multipath": ("receiver.multipath", "1 m"),
    }  # fmt: skip
    return [every[name] for name in names]


def own(prepared_case, **fields):
    """The scenario of a flight whose filter assumes of the receiver what is true, but for these fields."""
    _, model, _ = filter_models(prepared_case.scenario)
    units = {"pseudorange_sigma": " m", "position_sigma": " m", "range_rate_sigma": " m/s", "velocity_sigma": " m/s"}
    text = {name: f"{getattr(model, name)}{unit}" for name, unit in units.items()}
    text |= {name: getattr(model, name) for name in ("clock_h0", "clock_h_minus2")}
    return prepare_hop(with_fields(prepared_case.scenario, **{"filter.receiver": text | fields}))


@pytest.mark.parametrize("coupling", ["tight", "loose"])
def test_both_engines_have_the_noise_of_the_schedule(coupling):
    prepared_case = prepare_case(coupling, "grown")
    history, block = covariance(prepared_case), run_block(prepared_case, 5, 0, RUNS)
    at = [int(np.argmin(np.abs(prepared_case.t_hist - t))) for t in (5.0, 12.0, 20.0, 30.0)]
    ratio = np.mean(block.err[:, at] ** 2, axis=0) / (history.true_sigma[at] ** 2 + history.mean[at] ** 2)
    tail = ALPHA / 2 / ratio.size
    low, high = chi2.ppf([tail, 1.0 - tail], RUNS) / RUNS
    assert np.all((ratio > low) & (ratio < high)), ratio.round(2)
    # the noise matters: position under thrust is by far worse than with the constant noise
    plain = covariance(prepare_case(coupling))
    assert np.all(history.true_sigma[at[1], 6:9] > 1.5 * plain.true_sigma[at[1], 6:9])


@pytest.mark.parametrize("coupling", ["tight", "loose"])
def test_a_matched_filter_has_the_schedule_and_one_with_numbers_of_its_own_only_if_it_states_it(coupling):
    grown, plain = prepare_case(coupling, "grown"), prepare_case(coupling)
    factor = noise_factor(grown.scenario.receiver.noise_by, "position", dynamics_at(grown.trajectory, grown.sky.t))[
        :, None
    ]
    n = grown.channels.n_receiver
    for field, power in (("sigma", 1), ("variance", 2)):
        ratio = getattr(grown.signals, field)[:, :n] / getattr(plain.signals, field)[:, :n]
        np.testing.assert_allclose(ratio, np.broadcast_to(factor**power, ratio.shape), rtol=1e-12)
    np.testing.assert_allclose(own(grown).signals.variance, plain.signals.variance, rtol=1e-12)
    stated = own(plain, noise_by=GROWN)
    np.testing.assert_allclose(stated.signals.variance, grown.signals.variance, rtol=1e-12)
    np.testing.assert_array_equal(stated.signals.sigma, plain.signals.sigma)


@pytest.mark.parametrize("coupling", ["tight", "loose"])
def test_the_self_check_expects_the_noise_of_the_schedule(coupling):
    assert failed(measurement_checks(prepare_case(coupling, "grown"), 20261121)) == []


def test_a_conservative_schedule_of_the_filter_alone_covers_more_than_is_true():
    plain = prepare_case("tight")
    conservative = covariance(own(plain, noise_by=GROWN))
    assert np.all(conservative.formal_sigma[-1, 6:9] > 1.02 * conservative.true_sigma[-1, 6:9])
    matched = covariance(plain)
    np.testing.assert_allclose(matched.formal_sigma[-1, 6:9], matched.true_sigma[-1, 6:9], rtol=1e-2)


def test_two_frequencies_remove_the_ionosphere_and_amplify_noise_and_multipath():
    one, two, none = (
        prepare_case("tight", "shell", "multipath"),
        prepare_case("tight", "shell", "two", "multipath"),
        prepare_case("tight"),
    )
    assert np.abs(one.atmospheric_delays.ionosphere).max() > 1.0
    assert not np.any(two.atmospheric_delays.ionosphere)
    np.testing.assert_array_equal(two.signals.range, none.signals.range)
    ratio = two.signals.sigma / one.signals.sigma
    np.testing.assert_allclose(ratio, np.full(ratio.shape, 2.978), atol=5e-4)
    assert {family.source for family in two.families} == {"multipath"}
    sigma = {family.source: family.sigma for family in one.families}
    assert sigma.keys() == {"multipath", "ionosphere scale"}
    np.testing.assert_allclose(two.families[0].sigma / sigma["multipath"], 2.978, atol=5e-4)


def test_a_common_error_of_range_rates_leaves_position_alone_and_spoils_velocity_of_who_takes_it_for_the_clock():
    offset = {"receiver.range_rate_offset": "0.5 m/s"}
    scenario = loaded(MATCHED)
    neglected = covariance(prepare_hop(with_fields(scenario, **offset)))
    state = with_fields(scenario, **offset, **{"filter.extra_states": ["range_rate_offset"]})
    estimated = covariance(prepare_hop(state))
    line = neglected.sources.index("range-rate offset")
    share = neglected.budget[-1, line, 3:9].max()
    assert share > 0.0
    assert np.linalg.norm(estimated.true_sigma[-1, 3:6]) < np.linalg.norm(neglected.true_sigma[-1, 3:6])
    # a point solution gives it to its own drift: nothing is left of it in velocity
    text = {"kind": "bancroft", "range_sigma": "1.5 m", "rate_sigma": "0.1 m/s", "reported": True}
    loose = with_fields(loaded(MATCHED, LOOSE), **offset, **{"receiver.solution": text})
    solved = covariance(prepare_hop(loose))
    at = solved.sources.index("range-rate offset")
    *others, drift = np.moveaxis(solved.budget[:, at], 1, 0)
    assert np.max(others) < 1e-12 * share
    np.testing.assert_allclose(drift[1:], 0.5**2, rtol=1e-12)
