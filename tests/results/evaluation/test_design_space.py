"""What many designs show together, on designs whose effects are known."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.design_space import ALL, axis_label, display_unit, interval, overconfident, possible
from lvnav_trade.results.evaluation.designs import designs
from tests import many_designs

BIAS, HEADING, FILTER = "axis_bias_repeatability_rad_per_s", "axis_heading_rad", "axis_filter"


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory):
    return many_designs.tables(tmp_path_factory.mktemp("space"), 2000)


def test_designs_are_those_that_are_stored_with_levels_and_verdicts_as_columns(tables) -> None:
    found = designs(tables)
    assert len(found) == 2000
    assert {BIAS, HEADING, FILTER, "fast_verdict", "reason"} <= set(found.columns)
    assert set(found[FILTER]) == {"loose", "tight"}
    assert len(possible(tables)) == 1998


def test_the_parts_of_the_variance_are_those_that_the_designs_were_made_with(tables) -> None:
    """log v = 0.5 log b + log 2 or 0: variances 0.25 (ln 1000)^2 / 12 and (ln 2)^2 / 4, nothing by the heading."""
    found = METRICS["effects"](tables).set_index("axis")
    by_bias, by_filter = 0.25 * math.log(1000.0) ** 2 / 12.0, math.log(2.0) ** 2 / 4.0
    whole = by_bias + by_filter
    assert found.first_order[BIAS] == pytest.approx(by_bias / whole, abs=0.02)
    assert found.first_order[FILTER] == pytest.approx(by_filter / whole, abs=0.02)
    assert found.first_order[HEADING] < 0.01
    assert found.low[HEADING] < 0.0 < found.high[HEADING]
    assert 0.9 < found.low[BIAS] < found.rank_correlation[BIAS] < found.high[BIAS]
    assert np.isnan(found.rank_correlation[FILTER])


def test_indices_of_numeric_axes_are_those_of_a_product_in_closed_form(tmp_path) -> None:
    """Squared error b h^0.5 with log-uniform b, h: of a product with means 1 the first-order indices are Vb and Vh, the
    total ones Vb (1 + Vh) and Vh (1 + Vb), over Vb + Vh + Vb Vh.
    """
    found = many_designs.tables(tmp_path, 2000)
    frame = found.designs.copy()
    heading = np.degrees(frame.axis_heading_rad)
    bias = np.degrees(frame.axis_bias_repeatability_rad_per_s) * 3600.0
    frame["fast_quantile_m_per_s"] = np.sqrt(bias ** (1 / 3) * heading**0.5)
    levels = [json.loads(text) for text in frame["axes"]]
    frame["axes"] = [json.dumps({name: of[name] for name in ("bias_repeatability", "heading")}) for of in levels]
    effects = METRICS["effects"](found.with_frames(designs=frame)).set_index("axis")

    def spread(power: float, decades: float) -> float:
        a = 0.5 * power * decades * math.log(10.0)
        return (math.sinh(2.0 * a) / (2.0 * a)) / (math.sinh(a) / a) ** 2 - 1.0

    by_bias, by_heading = spread(1 / 3, 3.0), spread(0.5, 2.0)
    whole = by_bias + by_heading + by_bias * by_heading
    assert effects.sobol_first[BIAS] == pytest.approx(by_bias / whole, abs=0.01)
    assert effects.sobol_first[HEADING] == pytest.approx(by_heading / whole, abs=0.01)
    assert effects.sobol_total[BIAS] == pytest.approx(by_bias * (1.0 + by_heading) / whole, abs=0.01)
    assert effects.sobol_total[HEADING] == pytest.approx(by_heading * (1.0 + by_bias) / whole, abs=0.01)
    assert effects.predicted[BIAS] > 0.98


def test_designs_with_levels_have_no_such_indices(tables) -> None:
    assert METRICS["effects"](tables)[["sobol_first", "sobol_total", "predicted"]].isna().all(axis=None)


def test_intervals_of_rank_correlations_hold_the_true_one_in_95_of_100_samples() -> None:
    from lvnav_trade.results.evaluation.design_space import _interval

    rng, inside, truth = np.random.default_rng(3), 0, 6.0 / np.pi * np.arcsin(0.6 / 2.0)
    for _ in range(400):
        x, y = rng.standard_normal((2, 60))
        found = float(stats.spearmanr(x, 0.6 * x + 0.8 * y).statistic)
        low, high = _interval(found, 60)
        inside += low <= truth <= high
    assert 365 <= inside <= 396


def test_shares_of_a_part_count_its_designs(tables) -> None:
    found = METRICS["regions"](tables)
    frame = possible(tables)
    rows = found[(found.requirement == ALL) & (found.axis == FILTER)].set_index("level")
    for level in ("loose", "tight"):
        mine = frame[frame[FILTER] == level]
        assert (rows.designs[level], rows.met[level]) == (len(mine), (mine.verdict == "met").sum())
        low, high = interval(rows.met[level], rows.designs[level])
        assert (rows.share_low[level], rows.share_high[level]) == (low, high)
    parts = found[(found.requirement == "fast") & (found.axis == BIAS)]
    assert len(parts) == 5
    assert parts.designs.sum() == len(frame)
    assert list(parts.share) == sorted(parts.share, reverse=True)


def test_an_interval_is_exact_binomial() -> None:
    assert interval(0, 10) == (0.0, pytest.approx(1.0 - 0.025 ** (1 / 10)))
    found = stats.binomtest(30, 100).proportion_ci(0.95, "exact")
    assert interval(30, 100) == (pytest.approx(found.low), pytest.approx(found.high))


def test_axes_are_shown_in_the_unit_that_the_campaign_states(tables) -> None:
    unit, factor = display_unit(tables, BIAS)
    assert (unit, factor) == ("deg/h", pytest.approx(3600.0 * 180.0 / math.pi))
    assert display_unit(tables, FILTER) == ("", 1.0)
    assert display_unit(tables, "attitude_rad") == ("mrad", 1e3)
    assert display_unit(tables, "realism_quantile_sigma") == ("sigma", 1.0)
    assert axis_label("realism_quantile_sigma") == "realism quantile"
    assert axis_label(BIAS) == "bias repeatability"


def test_a_unit_is_that_of_the_axis_of_this_name_and_of_no_other_that_begins_with_it(tmp_path) -> None:
    """The campaign states `heading` in deg and `heading_rate` in deg/h: one name is the beginning of the other."""
    found = many_designs.tables(tmp_path, 40)
    frame = found.designs.rename(columns={BIAS: "axis_heading_rate_rad_per_s"})
    levels = [json.loads(text) for text in frame["axes"]]
    order = ("heading", "heading_rate", "filter")
    named = [{"heading_rate": of["bias_repeatability"], **of} for of in levels]
    frame["axes"] = [json.dumps({name: of[name] for name in order}) for of in named]
    axes = [many_designs.AXES[1], many_designs.AXES[0], many_designs.AXES[2]]
    changed = found.with_frames(designs=frame)
    changed.__dict__["campaign"] = {**found.campaign, "axes": axes}
    assert display_unit(changed, "axis_heading_rate_rad_per_s")[0] == "deg/h"
    assert display_unit(changed, HEADING)[0] == "deg"
    swapped = found.with_frames(
        designs=frame.assign(axes=[json.dumps(dict(reversed(json.loads(text).items()))) for text in frame["axes"]])
    )
    swapped.__dict__["campaign"] = {**found.campaign, "axes": axes[::-1]}
    assert display_unit(swapped, "axis_heading_rate_rad_per_s")[0] == "deg/h"
    assert display_unit(swapped, HEADING)[0] == "deg"


# --- grids ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory):
    """Return a full grid of seven biases, three headings, two filters: error 0.2 b^0.5 h^0.1, twice that if loose."""
    return many_designs.grid(tmp_path_factory.mktemp("grid"))


def test_a_grid_is_no_sample_and_has_no_intervals(grid) -> None:
    effects, regions, swings = (METRICS[name](grid) for name in ("effects", "regions", "swings"))
    assert effects[["low", "high"]].isna().all(axis=None)
    assert effects.rank_correlation.notna().sum() == 2
    assert regions[["share_low", "share_high"]].isna().all(axis=None)
    assert swings[["low_si", "high_si"]].isna().all(axis=None)


def test_the_levels_of_a_grid_are_its_parts(grid) -> None:
    regions = METRICS["regions"](grid)
    rows = regions[(regions.requirement == ALL) & (regions.axis == HEADING)]
    assert list(rows.low) == list(rows.high) == sorted(set(grid.designs.axis_heading_rad))
    assert list(rows.designs) == [14, 14, 14]
    of_bias = regions[(regions.requirement == ALL) & (regions.axis == BIAS)]
    assert of_bias.designs.sum() == 42  # seven levels in fewer parts: none is in two of them
    assert (of_bias.low.to_numpy()[1:] > of_bias.high.to_numpy()[:-1]).all()


def test_the_parts_of_the_variance_of_a_grid_are_exact(grid) -> None:
    """A sum of one term for each axis, on all combinations: the parts are the variances of the terms."""
    found = METRICS["effects"](grid).set_index("axis").first_order
    frame = grid.designs
    terms = {BIAS: 0.5 * np.log(frame[BIAS]), HEADING: 0.1 * np.log(frame[HEADING])}
    by = {name: np.var(term) for name, term in terms.items()} | {FILTER: math.log(2.0) ** 2 / 4.0}
    for axis, variance in by.items():
        assert found[axis] == pytest.approx(variance / sum(by.values()), rel=1e-12)


def test_without_requirements_the_errors_of_navigation_are_shown(tmp_path) -> None:
    found = many_designs.tables(tmp_path, 200)
    found.__dict__["campaign"] = {**found.campaign, "requirements": []}
    for name in ("effects", "swings"):
        assert set(METRICS[name](found).requirement) == {"attitude error", "velocity error", "position error"}


def test_overconfident_filters_are_counted(tables) -> None:
    frame = possible(tables)
    assert overconfident(frame) == (frame[FILTER] == "loose").sum()
    assert overconfident(frame[["case"]]) == 0


def test_results_without_many_designs_have_neither(tmp_path) -> None:
    from lvnav_trade.results.tables.read import load
    from tests import synthetic

    found = load(synthetic.results(tmp_path, n_run=8))
    for name in ("effects", "swings", "regions"):
        assert METRICS[name](found).empty


def test_many_designs_keep_their_short_names(tables) -> None:
    from lvnav_trade.results.statistics.display_units import case_names

    assert case_names(tables) == tables.labels
