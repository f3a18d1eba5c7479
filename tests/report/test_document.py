"""Head of the document, requirements with their sources, margin policy."""

from __future__ import annotations

import shutil

import pandas as pd
import pytest

from lvnav_trade.report.blocks import Table, Text
from lvnav_trade.report.build import html_page, make, markdown_page
from lvnav_trade.report.document import Line, head, margin_policy, stated_requirements, title_of
from lvnav_trade.report.summary import summary
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.registry import metric_of
from lvnav_trade.results.requirements.windows import windows
from lvnav_trade.results.tables.read import Tables, load

CARD = {"title": "Navigation of a launcher", "author": "A. Author", "issue": "2.1", "classification": "Internal"}


@pytest.fixture
def results(page) -> Tables:
    return load(page.parent)


def stating(tables: Tables, **fields: object) -> Tables:
    found = tables.with_frames()
    found.__dict__["campaign"] = {**tables.campaign, **fields}
    return found


def committed(tables: Tables, commit: str) -> Tables:
    found = tables.with_frames()
    found.__dict__["manifest"] = {**tables.manifest, "campaign": "synthetic", "finished": "2026-11-25T10:00:00Z",
                                  "tool": "0.1.0", "commit": commit}  # fmt: skip
    return found


def test_the_head_names_document_campaign_date_version_and_commit(results):
    found = committed(stating(results, document=CARD), "abc123")
    assert title_of(found) == "Navigation of a launcher"
    assert head(found) == (
        Line("classification", "Internal"), Line("issue", "2.1"), Line("author", "A. Author"),
        Line("date", "2026-11-25"), Line("campaign", "synthetic"), Line("lvnav-trade", "0.1.0"),
        Line("commit", "abc123"),
    )  # fmt: skip
    made = make(found, ["summary"])
    for text in (html_page(*made[:3], head=made.head), markdown_page(*made[:3], made.head)):
        for said in (*CARD.values(), "2026-11-25", "abc123"):
            assert said in text[: text.index("Answer")] or said in text.split("<main>")[0]


def test_results_of_a_changed_working_tree_are_marked_at_the_top(results):
    found = committed(results, "abc123 with changes")
    assert head(found)[-1] == Line(
        "commit", "abc123 with changes: the results cannot be computed again from a commit", True
    )
    made = make(found, ["summary"])
    assert '<span class="violated">commit: abc123 with changes' in html_page(*made[:3], head=made.head)
    assert "- commit: **abc123 with changes" in markdown_page(*made[:3], made.head)
    assert title_of(found) == "synthetic"


def test_requirements_are_listed_with_identifier_source_and_interpretation(results):
    stated = [
        {"name": "velocity", "metric": "velocity_error_3d", "at": "injection", "probability": 0.9973, "below": "1 m/s",
         "id": "NAV-1", "parent": "SYS-1", "source": "ICD 3.2", "verification": "analysis", "rationale": "3 sigma"},
        {"name": "roll", "metric": "attitude_error_roll", "during": "flight", "probability": 0.9, "below": "1 rad"},
    ]  # fmt: skip
    listed, convention = stated_requirements(stating(results, requirements=stated))
    assert isinstance(listed, Table)
    rows = [dict(zip(listed.head, row, strict=True)) for row in listed.rows]
    assert rows[0] == {
        "id": "NAV-1", "requirement": "velocity", "parent": "SYS-1", "source": "ICD 3.2", "verification": "analysis",
        "bound": "velocity error 3d below 1 m/s", "place": "at injection", "fraction of runs": "99.73 %",
        "confidence": "90 %", "interpretation": "norm, ensemble", "rationale": "3 sigma",
    }  # fmt: skip
    assert (rows[1]["interpretation"], rows[1]["place"]) == ("two-sided, mixed", "during flight")
    assert isinstance(convention, Text)
    assert "ECSS-E-ST-60-10C" in convention.text
    assert "NASA/TP-2010-216447" in convention.text
    plain = stated_requirements(stating(results, requirements=stated[1:]))[0]
    assert not {"id", "parent", "source"} & set(plain.head)


@pytest.mark.parametrize(("metric", "sides"), [
    ("velocity_error_3d", "norm"), ("velocity_error_north", "two-sided"), ("velocity_along_track_error", "two-sided"),
    ("inclination_error", "two-sided"), ("eccentricity_vector_error", "norm"), ("correction_delta_v", "norm"),
    ("impact_error", "norm"), ("impact_error_down", "two-sided"), ("normalised_velocity_error", "norm"),
    ("satellites_tracked", "one-sided"),
])  # fmt: skip
def test_a_bound_is_said_to_be_on_a_length_or_on_a_signed_error(metric, sides):
    assert metric_of(metric).bound_type == sides


def test_bounds_are_listed_in_the_unit_of_the_verdicts(results):
    stated = [
        {"name": "tilt", "metric": "attitude_error_roll", "at": "injection", "probability": 0.9, "below": f"{1e-3} rad"}
    ]
    known = stating(results, requirements=stated)
    (listed, _), (verdict, *_) = stated_requirements(known), METRICS["requirements"](known).itertuples()
    assert verdict.unit == "mrad"
    assert listed.rows[0][listed.head.index("bound")] == "attitude error roll below 1 mrad"


def test_margins_are_compared_with_the_policy_of_the_phase(results):
    policy = {"phase": "PDR", "required": {"PDR": "0.2 dimensionless", "CDR": "0.1 dimensionless"}}
    frame = pd.DataFrame({"case": ["a", "b", "b", "c"], "margin_ratio": [0.25, 0.3, 0.12, float("nan")]})
    (said,) = margin_policy(stating(results, margin_policy=policy), frame)
    assert (said.lead, said.text) == (
        "Margin policy.", "PDR requires a margin of 20 %. 1 of 3 designs has it at injection. Designs without it: b "
        "(+12 %); c (no margin)."
    )  # fmt: skip
    assert margin_policy(results, frame) == []
    found = summary(stating(results, margin_policy=policy))
    assert any(getattr(block, "lead", "") == "Margin policy." for block in found)


@pytest.mark.parametrize(("worst", "by", "said"), [
    ([0.9, 1.1, 0.5], ["LinCov", "LinCov", "LinCov"],
     " Around injection, both designs with this margin have less, by linear covariance: a (+10 % in v, 3.0 s "
     "after injection); b (-10 % in v, 3.0 s after injection)."),
    ([0.9, 0.7, 0.5], ["runs", "LinCov", "LinCov"],
     " Around injection, 1 of the 2 designs with this margin has less, by the runs: a (+10 % in v, 3.0 s after "
     "injection)."),
    ([0.9, 1.1, 0.5], ["runs", "LinCov", "LinCov"],
     " Around injection, both designs with this margin have less: a (+10 % in v, 3.0 s after injection), "
     "by the runs; b (-10 % in v, 3.0 s after injection), by linear covariance."),
    ([0.75, 0.7, 3.0], ["LinCov", "LinCov", "LinCov"], "")])  # fmt: skip
def test_designs_that_keep_the_policy_at_an_event_and_not_around_it_are_named(results, worst, by, said):
    """The third design does not keep it at the event, and is not named again."""
    policy = {"phase": "PDR", "required": {"PDR": "0.2 dimensionless"}}
    found = stating(results, margin_policy=policy)
    rows = pd.DataFrame({"requirement": "v", "case": ["a", "b", "c"], "event": "injection", "t_s": 90.0,
                         "worst": worst, "worst_s": 93.0, "limit": 1.0, "by": by})  # fmt: skip
    milder = rows.assign(requirement="w", worst=0.1)
    found.cache[windows.__module__, "windows"] = pd.concat([milder, rows], ignore_index=True)
    margins = pd.DataFrame({"case": ["a", "b", "c"], "margin_ratio": [0.25, 0.3, 0.1]})
    (block,) = margin_policy(found, margins)
    assert block.text == (
        f"PDR requires a margin of 20 %. 2 of 3 designs have it at injection. Design without it: c (+10 %).{said}"
    )


def test_the_sentence_on_agreement_says_what_is_compared(results):
    """What agrees stands beside the verb, and what is not compared after it."""
    said = " ".join(block.text for block in summary(results) if isinstance(block, Text))
    agree = "agree in the RMS errors of attitude, velocity and position by axis at every event, in both cases (1 %"
    assert agree in said
    assert "per case). Quantiles, orbit and impact point are not compared." in said


def test_the_verdict_tables_are_there_without_a_report(page, tmp_path):
    from lvnav_trade.report import verdict_tables

    folder = shutil.copytree(page.parent, tmp_path / "bare")
    verdict_tables(folder)
    assert not (folder / "report.html").exists()
    shown = pd.read_csv(folder / "requirements.csv")
    assert list(shown.verdict) == list(METRICS["requirements"](load(folder)).verdict)
    for name in ("expected_verdicts", "windows", "filter_verdicts"):
        assert (folder / f"{name}.csv").exists()
