"""A flight written as a file of the user's own, and flown again."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.reading.flights import read_card
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.trajectory.export import COLUMNS, difference, export_trajectory
from lvnav_trade.trajectory.files.columns import TableTrajectory
from lvnav_trade.trajectory.flight import build
from tests.trajectory.flight_cases import CONFIGS


def again(name, folder, rate=10.0):
    card = read_card(str(CONFIGS / f"trajectories/{name}.yaml"), folder)
    found = export_trajectory(card, str(folder / "rows.csv"), "again", rate)
    (folder / "rows.csv").write_text(found.text)
    return found, build(TableTrajectory.model_validate(found.card))


@pytest.mark.parametrize("name", ["two_stage_leo", "churchill_sso", "example_table", "falcon9_formosat5"])
def test_an_export_that_is_flown_is_the_flight(name, tmp_path, record_property):
    found, flight = again(name, tmp_path)
    apart = difference(found.flight, flight)
    record_property(f"export of {name}: specific force, m/s^2", f"{apart['specific_force_m_s2']:.1e}")
    assert apart["position_m"] < 1e-5
    assert apart["velocity_m_s"] < 1e-4
    assert apart["attitude_rad"] < 1e-7
    assert apart["specific_force_m_s2"] < 1e-3
    assert apart["body_rate_rad_s"] < 1e-5
    assert flight.start == found.flight.start
    assert flight.end == found.flight.end


def test_events_come_along_and_jumps_of_force_without_a_name_get_one(tmp_path):
    found, flight = again("churchill_sso", tmp_path)
    assert found.flight.events.items() <= flight.events.items()
    jumps = {phase.start for phase in found.flight.phases[1:]}
    assert all(min(abs(time - jump) for time in flight.events.values()) < 1e-6 for jump in jumps)
    assert flight.events["change_1"] == 12.75  # a step of the first stage's thrust


def test_coarser_rows_differ_by_more(tmp_path):
    fine, coarse = (difference(found.flight, flown) for found, flown in (
        again("two_stage_leo", tmp_path), again("two_stage_leo", tmp_path, 2.0)
    ))  # fmt: skip
    assert coarse["velocity_m_s"] > 10.0 * fine["velocity_m_s"]


def test_oscillations_stay_in_the_card_and_out_of_the_rows(tmp_path):
    card = read_card(str(CONFIGS / "trajectories/shefex2_class.yaml"), tmp_path)
    found = export_trajectory(card, str(tmp_path / "rows.csv"), "again", 10.0)
    assert len(found.card["oscillation"]) == len(card.oscillation) > 0
    assert not any(phase.oscillations for phase in found.flight.phases)
    (tmp_path / "rows.csv").write_text(found.text)
    flown = build(TableTrajectory.model_validate(found.card))
    assert any(phase.oscillations for phase in flown.phases)


@pytest.mark.parametrize(("rate", "why"), [(0.0, "above zero"), (1e6, "at most 1000000 are read")])
def test_a_rate_that_cannot_be_is_refused(rate, why, tmp_path):
    card = read_card(str(CONFIGS / "trajectories/two_stage_leo.yaml"), tmp_path)
    with pytest.raises(InputError, match=why):
        export_trajectory(card, "rows.csv", "again", rate)


def test_the_columns_are_those_of_the_shipped_example():
    text = (CONFIGS / "trajectories/example_table.csv").read_text()
    assert ",".join(COLUMNS) in text.splitlines()
