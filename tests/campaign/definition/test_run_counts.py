"""How many runs each case has."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.definition.run_counts import MonteCarlo


def test_selected_cases_have_all_runs_and_others_forty_or_as_many_as_is_said() -> None:
    card = MonteCarlo(runs=800, selected={"imu": "fog"})
    assert (card.runs_of({"imu": "fog"}), card.runs_of({"imu": "mems"})) == (800, 40)
    assert MonteCarlo(runs=800, selected={"imu": "fog"}, other_runs=0).runs_of({"imu": "mems"}) == 0
    assert MonteCarlo(runs=16, selected={"imu": "fog"}).runs_of({"imu": "mems"}) == 16


def test_of_many_designs_ten_have_runs_unless_another_number_is_said() -> None:
    assert MonteCarlo(runs=80).case_limit == 10
    assert MonteCarlo(runs=80, cases="front", most_cases=3).case_limit == 3


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"runs": 0}, "give at least 1"),
        ({"runs": 2_000_000}, "at most"),
        ({"runs": 80, "other_runs": 8}, "no cases are selected"),
        ({"runs": 100, "stop": "decided"}, "120 runs are a multiple of it"),
        ({"runs": 80, "most_cases": 0}, "greater than or equal to 1"),
    ],
)
def test_what_has_no_sense_is_refused(stated: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MonteCarlo.model_validate(stated)
