"""Rows of designs: the numbers of a full analysis, from passes of their own and from shared ones."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lvnav_trade.campaign.search.point import evaluate_requirements, frozen_filter
from lvnav_trade.campaign.space.evaluate_designs import EvaluationRequest, evaluate, metrics_of
from lvnav_trade.campaign.space.numbered_designs import DesignSpace
from lvnav_trade.campaign.space.passes import HISTORY, shared_axes
from lvnav_trade.covariance.history import covariance
from lvnav_trade.simulation.preparation.prepare import prepare


def question(campaign, shared=()) -> EvaluationRequest:
    return EvaluationRequest(tuple(one.model_dump(mode="json") for one in campaign.requirements), HISTORY, shared)


def test_a_row_has_the_numbers_that_a_search_finds(campaign) -> None:
    designs = DesignSpace(campaign)
    rows = evaluate(question(campaign), designs.batch(range(4)))
    assert rows.passes == 4
    assert not any(rows.texts["reason"])
    for number in range(4):
        case = designs.case(number)
        found = evaluate_requirements(campaign, case.scenario)["fast"]
        assert rows.texts["case"][number] == case.id
        assert rows.number_columns["fast_quantile_m_per_s"][number] == pytest.approx(found.estimate, rel=1e-9)
        assert rows.number_columns["fast_probability_ratio"][number] == pytest.approx(found.probability, rel=1e-9)
        assert rows.number_columns["error_ratio"][number] == pytest.approx(found.ratio, rel=1e-9)
        verdict = "met" if found.probability >= 0.9973 else "violated"
        assert json.loads(rows.texts["verdicts"][number]) == {"fast": verdict}
        assert rows.texts["verdict"][number] == verdict
        assert rows.number_columns["cost"][number] > 0.0


def test_designs_that_differ_in_true_sigmas_share_passes_and_have_the_same_rows(campaign) -> None:
    base = campaign.base.model_copy(update={"filter": frozen_filter(campaign.base)})
    axes = campaign.axes[:2]
    alone = campaign.model_copy(update={"base": base, "axes": axes})
    designs = DesignSpace(alone)
    shared = shared_axes(designs, HISTORY)
    assert shared == (0, 1)
    together = evaluate(question(alone, shared), designs.batch(range(40)))
    assert together.passes == 4  # smallest, each at its largest, one that is tried
    single = evaluate(question(alone), designs.batch(range(6)))
    assert single.passes == 6
    for name, values in single.number_columns.items():
        np.testing.assert_allclose(together.number_columns[name][:6], values, rtol=1e-11, atol=0.0)
    assert together.texts["verdict"][:6] == single.texts["verdict"]


def test_a_filter_that_follows_the_truth_shares_nothing(campaign) -> None:
    assert shared_axes(DesignSpace(campaign), HISTORY) == ()


def test_what_cannot_be_prepared_has_a_reason_and_no_digest(campaign, monkeypatch) -> None:
    from lvnav_trade.campaign.space import evaluate_designs as module

    def none(*_: object) -> None:
        raise ValueError("matrix 3 is not positive")

    monkeypatch.setattr(module, "prepare", none)
    rows = evaluate(question(campaign), DesignSpace(campaign).batch(range(3)))
    assert set(rows.texts["case"]) == {""}
    assert set(rows.texts["reason"]) == {"ValueError: matrix … is not positive"}
    assert set(rows.texts["verdict"]) == {""}


def asked(**fields: object) -> dict[str, object]:
    return {"metric": "velocity_error_3d", "probability": 0.9973, "below": "0.6 m/s"} | fields


def row_of(campaign, requirements, every_event=False):
    prepared_case = prepare(campaign.base, HISTORY)
    return metrics_of(
        EvaluationRequest(tuple(requirements), HISTORY, (), every_event), prepared_case, covariance(prepared_case)
    )


def test_the_reasons_of_all_requirements_are_kept(campaign) -> None:
    worst = asked(name="worst", during="liftoff to injection", at=None, below="100 m/s")
    lost = asked(name="lost", at="arrival")
    row = row_of(campaign, [worst, lost, asked(name="fast", at="injection")])
    assert json.loads(row["verdicts"])["worst"] == json.loads(row["verdicts"])["lost"] == "not applicable"
    assert row["reason"] == (
        "worst: the worst of a phase: linear covariance bounds its probability from above only; "
        "lost: linear covariance does not hold this error there"
    )
    assert row_of(campaign, [asked(name="fast", at="injection")])["reason"] == ""


def test_rows_of_events_have_the_errors_of_the_whole_analysis_at_each(campaign) -> None:
    requirement = campaign.requirements[0].model_dump(mode="json")
    row, alone = (row_of(campaign, [requirement], every) for every in (True, False))
    assert alone == {name: row[name] for name in alone}
    prepared_case = prepare(campaign.base, HISTORY)
    history, events = covariance(prepared_case), prepared_case.trajectory.events
    assert len(events) > 4
    velocity = [k for k, one in enumerate(prepared_case.outputs) if one.quantity == "velocity"]
    for name, t in events.items():
        at = int(np.argmin(np.abs(history.t - t)))
        true = np.trace(history.true_cov[at][np.ix_(velocity, velocity)]) + np.sum(history.mean[at, velocity] ** 2)
        assert row[f"velocity_at_{name}_m_per_s"] == pytest.approx(np.sqrt(true), rel=1e-12)
    assert row["velocity_at_injection_m_per_s"] == row["velocity_m_per_s"]
    assert row["fast_quantile_at_injection_m_per_s"] == row["fast_quantile_m_per_s"]
    assert row["fast_quantile_at_liftoff_m_per_s"] < row["fast_quantile_m_per_s"]
