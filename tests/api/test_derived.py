"""Cards and files made from a case: what is refused before anything is computed."""

from __future__ import annotations

import pytest

from lvnav_trade import api
from lvnav_trade.quantities.errors import InputError


@pytest.mark.parametrize("derive", [api.estimate_q, api.schedule_gains, api.export_trajectory])
def test_a_case_that_there_is_not_is_refused(derive, tmp_path):
    with pytest.raises(InputError, match="no case 'nothing'"):
        derive("smoke", tmp_path / "made.csv", case="nothing")
    assert not list(tmp_path.iterdir())


def test_a_card_has_no_cases(tmp_path):
    with pytest.raises(InputError, match="is a trajectory card"):
        api.export_trajectory("trajectories/two_stage_leo", tmp_path / "made.csv", case="base")


def test_a_campaign_is_written_around_a_flight(tmp_path):
    rows = "\n".join(f"{t},{6378137.0 + 5.0 * t * t},0,0" for t in range(40))
    flight = tmp_path / "flight.csv"
    flight.write_text(f"t_s,x_m,y_m,z_m\n{rows}\n")
    found = api.init(tmp_path / "mine", flight)
    assert found.campaign.is_file()
    assert found.card.is_file()
    assert {"time", "position"} <= {one.field for one in found.guesses}
    with pytest.raises(InputError):
        api.init(tmp_path / "mine", flight)
