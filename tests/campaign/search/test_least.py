"""The discrete question: the cheapest case that meets the requirements, its order, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.definition.searches import Solve
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.search import least as module
from lvnav_trade.campaign.search.least import least_total_case
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.report import search as page

AXES = [
    "monte_carlo=null", "axes=[{path: imu, cards: [imu/hg9900, imu/stim300, imu/adis16488, imu/ln200s]}]",
    "requirements=[{name: v, metric: velocity_error_3d, at: injection, probability: 0.95, below: 1 m/s}]",
]  # fmt: skip
RATIO = {"imu=hg9900": 0.2, "imu=stim300": 0.9, "imu=adis16488": 1.5, "imu=ln200s": 0.4}


def test_the_cheapest_case_that_meets_everything_is_chosen_and_the_smaller_one_is_beside_it(monkeypatch) -> None:
    monkeypatch.setattr(module, "_ratio", lambda campaign, case, asked: (RATIO[case.label], "v", ""))
    campaign = load("campaigns/smoke.yaml", AXES)
    found = least_total_case(campaign, Solve(least="cost")).answers
    assert list(found.case) == ["imu=adis16488", "imu=stim300", "imu=ln200s", "imu=hg9900"]
    assert list(found.case[found.chosen]) == ["imu=stim300"]
    assert list(found.cost) == [1800, 8000, 45000, 120000]
    assert least_total_case(campaign, Solve(least="mass")).answers.case[0] == "imu=adis16488"
    said = page.least_case_blocks(found, found[:0], "cost")[0]
    assert (said.lead, said.text[:11]) == ("Least cost that meets the requirements:", "imu=stim300")


def test_where_no_case_suffices_none_is_chosen(monkeypatch) -> None:
    monkeypatch.setattr(module, "_ratio", lambda *_: (np.nan, "", "v: not applicable"))
    found = least_total_case(load("campaigns/smoke.yaml", AXES), Solve(least="cost"))
    assert not found.answers.chosen.any()
    assert (
        page.least_case_blocks(found.answers, found.confirmed, found.total_column)[0].lead
        == "No case meets the requirements."
    )


def test_a_case_without_the_total_and_a_question_of_both_kinds_are_refused() -> None:
    axes = ["axes=[{path: imu, cards: [imu/navigation, imu/stim300]}]", *AXES[2:]]
    with pytest.raises(InputError, match=r"least: cost: no device of the case imu=navigation states it"):
        least_total_case(load("campaigns/smoke.yaml", axes), Solve(least="cost"))
    with pytest.raises(ValueError, match="either vary or least"):
        Solve()
    with pytest.raises(ValueError, match="margin"):
        Solve(least="cost", margin=0.2)
