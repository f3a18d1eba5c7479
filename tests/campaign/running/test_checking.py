"""What is looked for before anything is computed."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import work
from lvnav_trade.campaign.running.checking import check_effect, check_flight
from lvnav_trade.quantities.errors import InputError


def test_flights_that_cases_share_are_flown_once(study) -> None:
    found = load(study.path)
    flown = []

    def events(scenario):
        flown.append(scenario)
        return {"liftoff": 0.0, "stage1_cutoff": 150.0, "stage2_ignition": 200.0, "injection": 600.0}

    checked = check_flight(found, cases(found), work.ENGINE._replace(events=events, remarks=lambda _: ()), 1)
    assert set(checked.events) == {case.id for case in cases(found)}
    assert len(flown) == 1


def test_work_in_advance_is_done_after_the_trajectories_and_its_failure_is_ignored(study) -> None:
    campaign = load(study.path)
    calls = []

    def events(scenario):
        calls.append("trajectory")
        return {"liftoff": 0.0, "stage1_cutoff": 150.0, "stage2_ignition": 200.0, "injection": 600.0}

    def fail():
        calls.append("failure")
        raise RuntimeError("no compiler")

    engine = work.ENGINE._replace(events=events, remarks=lambda _: ())
    check_flight(campaign, cases(campaign), engine, 1, [fail, lambda: calls.append("compiled")])
    assert calls == ["trajectory", "failure", "compiled"]


def test_a_flight_that_cannot_be_is_one_mistake_for_all_its_cases(study) -> None:
    found = load(study.path)

    def events(scenario):
        raise InputError("it does not fly")

    with pytest.raises(InputError) as raised:
        check_flight(found, cases(found), work.ENGINE._replace(events=events), 1)
    assert len(raised.value.records) == 1


def test_a_setting_that_no_case_reads_is_a_mistake() -> None:
    found = load("smoke", ["filter.reference_satellite=highest"])
    with pytest.raises(InputError, match="clock: differenced has one"):
        check_effect(found, cases(found), work.ENGINE)
