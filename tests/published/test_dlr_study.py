"""The study of paper 001: its statements are all there with their bounds, and every campaign answers in small.

In small is linear covariance: of the first and the last case of each, and of every case where tests may take long.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lvnav_trade import api
from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.reading.study_card import load_study
from lvnav_trade.covariance.history import covariance
from lvnav_trade.simulation.preparation.prepare import prepare
from tests.scripts import publication

STUDY = publication("dlr")
FOLDER = Path(__file__).resolve().parents[2] / "campaigns" / "dlr"
KEPT = FOLDER.parents[1] / "reports" / "dlr" / "references.csv"
CAMPAIGNS = sorted(path.stem for path in FOLDER.glob("*.yaml") if path.stem != "study")
LONG = {
    "compensation_locus",
    "coupling",
    "ekf_ukf",
    "fdir",
    "fdir_alarms",
    "fdir_divergence",
    "fdir_sizes",
    "smoothed_solution",
    "smoothing_locus",
    "strapdown_drift",
    "strapdown_outage",
    "strapdown_rates",
    "troposphere_locus",
    "troposphere_residuals",
    "troposphere_stanag",
}
"""Each takes 7 to 16 s: kernels of its own, or dense histories. `make slow` flies them."""
BY_COVARIANCE = (
    "monte_carlo=null",
    "covariance={budget: false, adjoint: false, observability: false, nonlinearity: false, spot_check: 0}",
)
# Bounds by number of the statement, at_least and at_most of its rows, chosen before anything was flown; 1.139 is the
# 99 % bound of a NEES of 200 runs
BOUNDS = {
    1: {(1, None)}, 2: {(None, 0.5), (None, 1)}, 3: {(5, None)}, 4: {(None, 0.1)}, 5: {(None, 1.05), (1, None)},
    6: {(5, None), (3, None)}, 7: {(None, 1.3)}, 8: {(1.3, None), (1, None)}, 9: {(0.5, 2)}, 10: {(0.5, 2)},
    11: {(None, 1), (0.98, 1.1)}, 12: {(100, None), (None, 1)}, 13: {(3, None)},
    14: {(1.139, None), (0.3, None), (0.3, 1.139)},
    15: {(None, 1)}, 16: {(None, 1)}, 17: {(None, 1), (0.98, 1.02)}, 18: {(None, 1)}, 19: {(None, 0.6)},
    20: {(0.8, 1), (1, None)}, 21: {(1, 1.5), (1.5, None)}, 22: {(None, 1.1)}, 23: {(0.7, 1)}, 24: {(0.8, None)},
    25: {(None, 0.75), (0.1, None)}, 26: {(None, 1.3)}, 27: {(0.97, 1.03)}, 28: {(None, 0.7)}, 29: {(2, None)},
    30: {(0.98, 1.02), (1.02, None)},
    31: {(1.139, None), (0.3, None), (0.3, 1.139)},
    32: {(None, 1), (None, 1.5), (0.3, None), (0.3, 1.139)}, 33: {(0.98, 1.02), (1, None)},
    34: {(0.95, None), (None, 0.001)}, 35: {(0.95, None)}, 36: {(None, 3)}, 37: {(0.99, 1.01), (1.2, None)},
    38: {(None, 0.5)},
    39: {(None, 0.3)}, 40: {(None, 1), (2, None)}, 41: {(None, 1)}, 42: {(0.99, 1.01)},
    43: {(0.98, 1.02)}, 44: {(None, 1)},
    45: {(None, 1)}, 46: {(1.139, None), (None, 1), (1, None)}, 47: {(0.3, 1.139)}, 48: {(0.99, 1.01)},
    49: {(1.139, None), (0.3, 1.139)}, 50: {(0.3, 1.139)}, 51: {(1.139, None), (None, 1)},
    52: {(1.139, None), (0.3, 1.139), (1, None)}, 53: {(0.3, 1.139)}, 54: {(None, 1)}, 55: {(0.99, 1.01)},
    56: {(0.95, 1.05)},
}  # fmt: skip


def number(item: str) -> int:
    found = re.match(r"#(\d+) ", item)
    assert found, item
    return int(found[1])


def test_every_statement_is_tested_with_its_bounds_or_named_as_not_set_up() -> None:
    _, questions = load_study(FOLDER, None, STUDY.figures)
    assert {one.campaign.name for one in questions} == {path.stem for path in FOLDER.glob("*.yaml")} - {"study"}
    stated: dict[int, set[tuple[float | None, float | None]]] = {}
    for one in questions:
        for statement in STUDY.campaign_claims(one.campaign.name).statements:
            assert statement.id.startswith(f"dlr-{number(statement.item):02d}")
            stated.setdefault(number(statement.item), set()).add((statement.at_least, statement.at_most))
    for one in STUDY.study_statements.elsewhere:
        stated.setdefault(number(one.item), set()).add((one.at_least, one.at_most))
    assert not STUDY.study_statements.not_set_up
    assert set(stated) == set(range(1, 57))
    assert {key: bounds for key, bounds in stated.items() if not bounds <= BOUNDS[key]} == {}


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in CAMPAIGNS])
def test_the_first_and_the_last_case_of_a_campaign_have_a_covariance(name: str) -> None:
    every = cases(load(FOLDER / f"{name}.yaml"))
    for case in (every[0], every[-1]):
        prepared_case = prepare(case.scenario, 10.0)
        found = covariance(prepared_case)
        errors = [
            k
            for k, output in enumerate(prepared_case.outputs)
            if output.quantity in ("attitude", "velocity", "position")
        ]
        assert len(errors) == 9
        assert np.all(found.true_sigma[1:, errors] > 0.0)
        assert np.all(np.isfinite(found.true_sigma)), case.label
        assert np.all(np.isfinite(found.mean)), case.label


@pytest.mark.slow
@pytest.mark.parametrize("name", CAMPAIGNS)
def test_linear_covariance_gives_the_kept_figures_again(name: str, tmp_path: Path) -> None:
    """Formal and true of every statement; on another processor they are equal to rounding."""
    found = STUDY.table(api.run(FOLDER / f"{name}.yaml", BY_COVARIANCE, tmp_path, jobs=1, report=False))
    kept = {name: iter(rows) for name, rows in pd.read_csv(KEPT).groupby("id").true}  # of several cases in their order
    for row in found.itertuples():
        size = next(kept[row.id])
        if pd.notna(row.true):
            assert row.true == pytest.approx(size, rel=1e-3), row.id


def test_the_grade_of_the_unit_decides_what_it_did(tmp_path: Path) -> None:
    """Linear covariance alone: position is that of the fixes, velocity and attitude are those of the unit."""
    asked = (*BY_COVARIANCE, "keep.history=5 s")
    frame = STUDY.table(api.run(FOLDER / "imu_grades.yaml", asked, tmp_path, jobs=1, report=False))
    found = frame.set_index(["id", "case"])
    first = {id_: rows.iloc[0] for id_, rows in frame.groupby("id")}
    assert len(found) == 14  # two starts
    assert first["dlr-07"].verdict == first["dlr-08-attitude"].verdict == first["dlr-08-velocity"].verdict == "holds"
    assert first["dlr-06-fog"].true == pytest.approx(4.3, abs=0.2)  # below the bound of 5: the start decides
    assert "linear covariance alone" in first["dlr-09"].remark
