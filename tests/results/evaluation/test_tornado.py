"""The error between the ends of each axis, on designs whose effects are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.design_space import possible
from lvnav_trade.results.evaluation.tornado import _Regression, limit_of
from tests import many_designs

BIAS, HEADING, FILTER = "axis_bias_repeatability_rad_per_s", "axis_heading_rad", "axis_filter"


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory):
    return many_designs.tables(tmp_path_factory.mktemp("space"), 2000)


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory):
    return many_designs.grid(tmp_path_factory.mktemp("grid"))


def ratio_of(swings, axis: str) -> tuple[float, float, float]:
    """Return error at the last end over that at the first, and the bounds of the last one over its error."""
    rows = swings[swings.axis == axis]
    first, last = rows.iloc[0], rows.iloc[-1]
    return last.error_si / first.error_si, last.low_si / last.error_si, last.high_si / last.error_si


def test_the_error_grows_between_the_ends_of_an_axis_as_the_designs_were_made(tables) -> None:
    """Error 0.2 b^0.5, b over three decades, twice that if loose: factors 1000^0.5, 2, and 1 of the heading."""
    swings = METRICS["swings"](tables)
    assert ratio_of(swings, BIAS)[0] == pytest.approx(math.sqrt(1000.0), rel=0.02)
    rows = swings[swings.axis == FILTER].set_index("level")
    assert rows.error_si["loose"] / rows.error_si["tight"] == pytest.approx(2.0, rel=1e-3)
    heading = swings[swings.axis == HEADING]
    assert (heading.error_si / heading.mean_si).to_numpy() == pytest.approx(1.0, abs=3e-3)
    assert (heading.low_si <= heading.error_si).all()
    assert set(swings.error_unit) == {"m/s"}
    log = np.log(possible(tables).fast_quantile_m_per_s)
    assert swings.mean_si.to_numpy() == pytest.approx(math.exp(log.mean()))


def test_ends_of_a_grid_are_those_of_the_additive_model(grid) -> None:
    swings = METRICS["swings"](grid)
    frame = grid.designs
    for axis, power in ((BIAS, 0.5), (HEADING, 0.1)):
        expected = (frame[axis].max() / frame[axis].min()) ** power
        assert ratio_of(swings, axis)[0] == pytest.approx(expected, rel=1e-6)


def test_intervals_of_the_ends_hold_the_truth_in_95_of_100_samples(tmp_path) -> None:
    """The spread grows along the axis, so that an interval for equal spreads would be wrong."""
    rng, inside = np.random.default_rng(5), 0
    for _ in range(600):
        x = rng.uniform(-1.0, 1.0, 150)
        y = 0.7 * x + rng.standard_normal(150) * (0.1 + 0.5 * (x + 1.0) ** 2)
        away, half = _Regression((x - x.mean())[:, None], y).linear_combination(np.array([1.0]))
        inside += abs(away - 0.7) <= half
    assert 550 <= inside <= 588


def test_too_few_designs_for_a_regression_have_no_ends(tmp_path) -> None:
    assert METRICS["swings"](many_designs.tables(tmp_path, 14)).empty


def test_limits_are_in_si_where_there_are_any(tables) -> None:
    assert math.isnan(limit_of(tables, "velocity error"))
    assert limit_of(tables, "fast") == many_designs.LIMIT
