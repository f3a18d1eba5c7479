"""One case of a campaign alone: the same design, the same draws."""

from __future__ import annotations

from pathlib import Path

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.definition.published_cards import PublishedNumber
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.campaign.reading.written_cases import single_case
from lvnav_trade.campaign.running.replay import find


def test_a_case_alone_has_the_digest_that_it_has_among_the_others() -> None:
    demo = load("demo")
    for case in cases(demo):
        alone = single_case(demo, case)
        (only,) = cases(alone)
        assert (only.id, only.scenario) == (case.id, case.scenario)
        assert alone.requirements == demo.requirements
        assert case.id in alone.name


def test_a_case_alone_has_the_runs_that_the_campaign_gives_it() -> None:
    demo = load("demo")
    runs = {case.label: single_case(demo, case).monte_carlo.runs for case in cases(demo)}  # type: ignore[union-attr]
    assert runs["imu=tactical_mems, filter=tight_extended"] == 852
    assert runs["imu=tactical_fog, filter=tight"] == 40
    none = load("demo", ["monte_carlo.other_runs=0"])
    assert single_case(none, find(cases(none), "imu=tactical_fog, filter=tight")).monte_carlo is None


def test_its_resolved_campaign_reads_back_to_it(tmp_path: Path) -> None:
    demo = load("demo")
    case = cases(demo)[4]
    (tmp_path / "alone.yaml").write_text(resolved_text(single_case(demo, case)))
    (only,) = cases(load(tmp_path / "alone.yaml"))
    assert only.id == case.id


def test_published_numbers_of_other_cases_are_left_out() -> None:
    def published(**more: object) -> PublishedNumber:
        number = {"source": "s", "metric": "velocity_error_3d", "value": 1.0, "unit": "m/s"}
        return PublishedNumber.model_validate(number | more)

    demo = load("demo")
    stated = (
        published(case={"imu": "tactical_fog"}, item="fog"),
        published(case={"imu": "tactical_mems"}, item="mems"),
        published(item="all"),
        published(case={"imu": "tactical_fog"}, against={"imu": "tactical_mems"}, unit="%", item="better"),
        published(pool="filter", item="pooled"),
    )
    campaign = demo.model_copy(update={"references": stated})
    alone = single_case(campaign, cases(demo)[0])
    assert [one.item for one in alone.references] == ["fog", "all"]
    assert all(not one.case for one in alone.references)
