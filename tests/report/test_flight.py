"""The sections on the mission say what the tables hold."""

from __future__ import annotations

import pandas as pd
import pytest

from lvnav_trade.report import build, flight
from lvnav_trade.report.blocks import Picture, Table
from lvnav_trade.report.flight import control, control_tables, motion, motion_summary, motion_table
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.tables.read import load
from tests import mission as flights
from tests import synthetic
from tests.results.mechanics.test_mission_errors import falling
from tests.results.mission.test_impact import INSIDE, with_corridor
from tests.vehicle_tables import tables


@pytest.fixture(scope="module")
def orbit_page(tmp_path_factory):
    folder = flights.results(tmp_path_factory.mktemp("page") / "orbit", n_run=40)
    return build(folder, ["orbit", "impact"])


def test_the_page_has_orbit_correction_and_their_tables_beside_it(orbit_page):
    text = orbit_page.read_text(encoding="utf-8")
    assert 'id="orbit"' in text
    assert "Delta-v of the correction" in text
    assert "No stored state of any case has a point of impact." in text
    for name, has_rows in (("orbit", True), ("orbit_correction", True), ("impact", False), ("corridor", False)):
        assert (orbit_page.parent / f"{name}.csv").exists() == has_rows
    frame = pd.read_csv(orbit_page.parent / "orbit.csv")
    assert {"perigee height", "lowest height"} <= set(frame.quantity)
    assert text.count('<div class="figure"') == 1


def test_elements_have_seven_digits(orbit_page):
    tables = [block for block in flight.orbit(load(orbit_page.parent)) if block.block_type == "table"]
    table = next(block for block in tables if block.caption.endswith("orbit at injection."))
    row = next(row for row in table.rows if row[0] == "semi-major axis")
    assert row[1:4] == ("km", "6900", row[3])
    assert len(row[3]) >= 7


def test_an_element_below_the_bound_is_zero_with_the_bound(tmp_path, monkeypatch):
    monkeypatch.setattr("lvnav_trade.results.mission.orbit.LEAST", 1e-3)  # J2 makes this circle's eccentricity 3e-4
    tables = load(flights.results(tmp_path, flights.CIRCULAR, n_run=0))
    frame = METRICS["orbit"](tables).drop_duplicates("quantity").set_index("quantity")
    assert frame.osculating["eccentricity"] == 0.0
    assert frame.osculating["semi-major axis"] > 6000.0
    shown = next(block for block in flight.orbit(tables) if block.block_type == "table")
    assert next(row for row in shown.rows if row[0] == "eccentricity")[2] == "0 (below 1e-07)"


def test_a_fall_has_points_of_impact_and_a_verdict_on_the_corridor(tmp_path):
    folder = flights.results(tmp_path / "fall", falling(), 40, campaign=with_corridor(INSIDE))
    text = build(folder, ["orbit", "impact"]).read_text(encoding="utf-8")
    assert "No case ends in an orbit that clears the ground." in text
    assert "The corridor." in text
    assert "point of impact at the events" in text


def test_a_circular_orbit_says_why_there_is_no_sigma(tmp_path):
    tables = load(flights.results(tmp_path, flights.CIRCULAR, n_run=0, factor=40.0))
    reported = [block for block in flight.orbit(tables) if getattr(block, "lead", "") == "Not applicable."]
    assert len(reported) >= 1
    assert reported[0].text.startswith("the orbit is circular to within 3 sigma")


def test_both_sections_have_tables_and_figures():
    for blocks, n_picture in ((motion(tables()), 4), (control(tables()), 5)):
        assert sum(isinstance(block, Picture) for block in blocks) == n_picture
        assert any(isinstance(block, Table) for block in blocks)


def test_reductions_stand_with_their_intervals():
    shown = next(block for block in control_tables(tables()) if isinstance(block, Table))
    row = next(r for r in shown.rows if r[1] == "flight" and r[2] == "pitch")
    assert row[7] == "70.0"


def test_every_phase_of_the_flight_is_a_row_of_each_error():
    (by_phase,) = (block for block in motion_table(tables()) if isinstance(block, Table))
    assert len(by_phase.rows) == 24


def test_what_the_filtered_rate_is_worth_stands_beside_the_true_rate():
    worth = [block for block in control_tables(tables()) if isinstance(block, Table)][1]
    assert worth.rows[0][8] == "90.0"


def test_in_short_phases_are_a_range_and_verdicts_are_counted():
    assert motion_summary(tables()) == []  # under control
    navigated = tables()
    navigated.__dict__["nozzle_travel"] = navigated.nozzle_travel.iloc[:0]
    (short,) = (block for block in motion_summary(navigated) if isinstance(block, Table))
    assert len(short.rows) == 2 * 6
    assert short.rows[0][1:4] == ("rate roll", "91.4 to 91.4", "88.6 to 88.6")
    assert short.rows[0][-1].endswith("in 2 of 2")


def test_in_brief_burns_are_shown_of_the_cards_own_rate_gain():
    whole, brief = (next(b for b in control_tables(tables(), brief) if isinstance(b, Table)) for brief in (False, True))
    assert len(whole.rows) == 2 * len(brief.rows) == 8


def test_results_without_a_vehicle_show_nothing(tmp_path):
    plain = load(synthetic.results(tmp_path, n_run=0))
    assert motion_table(plain) == control_tables(plain) == motion(plain) == control(plain) == []
