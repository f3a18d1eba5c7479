"""Errors that measurements share: linear covariance carries each exactly, neglected, considered or estimated."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.gnss.constellation import CombinedConstellation
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import LOOSE, MATCHED, SITE_R, SITE_V, flight, loaded, prepare_hop, turning, with_fields

RUNS, ALPHA = 400, 1e-3

# By name: coupling, fields of the receiver, the source in the budget, the state that can stand for it.
CAUSES = {
    "multipath": ("tight", {"multipath": "4 m", "multipath_time": "10 s"}, "multipath", "range_bias"),
    "latency error": ("tight", {"latency_error": "5 ms"}, "latency error", "timing"),
    "latency jitter": ("tight", {"latency_sigma": "2 ms"}, "latency jitter", None),
    "lever arm": ("tight", {"lever_error": "3 m", "lever_b": ["1 m", "0.5 m", "-0.3 m"]}, "lever arm", None),
    "solution position": (
        "loose", {"solution.position_bias": "6 m", "solution.bias_time": "8 s"}, "solution position bias",
        "position_bias",
    ),
    "solution velocity": (
        "loose", {"solution.velocity_bias": "0.4 m/s", "solution.bias_time": "8 s"}, "solution velocity bias",
        "velocity_bias",
    ),
    "solution late": ("loose", {"latency_error": "5 ms"}, "latency error", "timing"),
    "troposphere": ("tight", {}, "troposphere scale", "troposphere_scale"),
    "ionosphere": ("tight", {}, "ionosphere scale", "ionosphere_scale"),
    "solution through air": ("loose", {}, "troposphere scale", "troposphere_scale"),
    "residuals": ("tight", {}, "satellite clock and ephemeris", "range_bias"),
    "system time": ("tight", {}, "system time offset", "time_offset"),
    "range rates": (
        "tight", {"range_rate_instability": "0.5 m/s", "range_rate_instability_time": "10 s"},
        "range-rate instability", "range_rate_offset",
    ),
}  # fmt: skip
RAYS, LAYER = {"kind": "ray_traced"}, {"kind": "content"}
# By name: other fields of the scenario, and what the filter corrects (the truth's mean, so that the scale remains).
WORLD = {
    "troposphere": ({"atmosphere": {"troposphere": RAYS, "troposphere_scale": "20 percent"}}, {"troposphere": RAYS}),
    "solution through air": (
        {"atmosphere": {"troposphere": RAYS, "troposphere_scale": "60 percent"}}, {"troposphere": RAYS},
    ),
    "ionosphere": (
        {"atmosphere": {"ionosphere": LAYER, "ionosphere_scale": "60 percent", "ionosphere_scale_time": "20 s"}},
        {"ionosphere": LAYER},
    ),
    "residuals": ({"constellation.range_error": "4 m", "constellation.range_error_time": "30 s"}, {}),
}  # fmt: skip
WAYS = [
    (name, way)
    for name, (_, _, _, state) in CAUSES.items()
    for way in (("neglect", "consider", "estimate") if state else ("neglect",))
]


@lru_cache(maxsize=64)
def prepare_case(name, way):
    coupling, fields, _, state = CAUSES[name]
    scenario = loaded(MATCHED, *([LOOSE] if coupling == "loose" else []))
    card = scenario.filter
    if way == "consider":
        card = with_fields(card, consider=[state])
    elif way == "estimate":
        card = with_fields(card, extra_states=[state])
    world, corrections = WORLD.get(name, ({}, {}))
    receiver, card = with_fields(scenario.receiver, **fields), with_fields(card, corrections=corrections)
    if name == "system time":
        scenario = scenario.model_copy(update={"constellation": two_systems()})
    return prepare_hop(
        with_fields(scenario.model_copy(update={"receiver": receiver, "filter": card}), **world), low_hop()
    )


@lru_cache(maxsize=1)
def two_systems():
    """GPS and Galileo, whose time is off."""
    cards = [
        loaded(f"base.constellation=constellations/{name}").constellation.model_dump(mode="json")
        for name in ("gps_24", "galileo_24")
    ]
    cards[1].update(time_offset="6 m", time_offset_time="40 s")
    return CombinedConstellation(parts=cards)


@lru_cache(maxsize=1)
def low_hop():
    """The short flight, 3 km above the ground, where there is air."""
    along = 30.0 * SITE_V / np.linalg.norm(SITE_V)
    down = SITE_R * (6.372e6 / np.linalg.norm(SITE_R))
    return flight([(20.0, lambda t: along), (10.0, lambda t: np.zeros(3))], turning, r=down)


@pytest.mark.parametrize(("name", "way"), WAYS)
def test_true_covariance_agrees_with_monte_carlo(name, way):
    prepared_case = prepare_case(name, way)
    history, block = covariance(prepared_case), run_block(prepared_case, 3, 0, RUNS)
    at = [int(np.argmin(np.abs(prepared_case.t_hist - t))) for t in (5.0, 12.0, 20.0, 30.0)]
    ratio = np.mean(block.err[:, at] ** 2, axis=0) / (history.true_sigma[at] ** 2 + history.mean[at] ** 2)
    tail = ALPHA / 2 / ratio.size
    low, high = chi2.ppf([tail, 1.0 - tail], RUNS) / RUNS
    assert np.all((ratio > low) & (ratio < high)), ratio.round(2)


@pytest.mark.parametrize(("name", "way"), WAYS)
def test_the_source_has_its_line_in_the_budget_and_forward_equals_backward(name, way):
    prepared_case, source = prepare_case(name, way), CAUSES[name][2]
    history = covariance(prepared_case)
    np.testing.assert_allclose(history.budget.sum(axis=1), history.true_sigma**2, rtol=1e-10)
    line = history.sources.index(source)
    assert history.budget[-1, line, 3:9].max() > 0.0
    back = adjoint(prepared_case, 30.0)
    np.testing.assert_allclose(
        back.contribution.sum(axis=2).T, history.budget[-1, :, :9], rtol=1e-9, atol=1e-12 * history.budget[-1].max()
    )


@pytest.mark.parametrize("name", [name for name, cause in CAUSES.items() if cause[3]])
def test_a_neglected_error_makes_the_filter_optimistic_and_a_state_for_it_consistent(name):
    neglected, considered, estimated = (
        covariance(prepare_case(name, way)) for way in ("neglect", "consider", "estimate")
    )
    worst = np.nanmax(neglected.expected_nees) / prepare_case(name, "neglect").layout.n_estimated
    assert worst > (1.02 if name in WORLD else 1.2)
    # what considering leaves is the matched filter's own covariance: expected NEES is the number of states
    for way, history in (("consider", considered), ("estimate", estimated)):
        count = prepare_case(name, way).layout.n_estimated
        np.testing.assert_allclose(history.expected_nees[1:], count, rtol=2e-2)
    assert np.linalg.norm(estimated.true_sigma[-1, 6:9]) < 1.001 * np.linalg.norm(neglected.true_sigma[-1, 6:9])


def test_an_error_that_no_card_names_leaves_no_family():
    assert prepare_hop(loaded(MATCHED)).families == ()


def test_lanes_and_one_run_at_a_time_fly_the_same_errors():
    prepared_case = prepare_case("multipath", "estimate")
    many, one = run_block(prepared_case, 3, 0, 9), run_block(prepared_case, 3, 8, 1, uses_lanes=False)
    np.testing.assert_array_equal(many.err[8], one.err[0])
