"""The sections on the vehicle itself: tables where there are any, nothing where there are none."""

from __future__ import annotations

from lvnav_trade.report.blocks import Picture, Table
from lvnav_trade.report.vehicle import control, control_tables, motion, motion_summary, motion_table
from lvnav_trade.store import load
from tests import synthetic
from tests.vehicle_tables import tables


def test_both_sections_have_tables_and_figures():
    for blocks, n_picture in ((motion(tables()), 4), (control(tables()), 5)):
        assert sum(isinstance(block, Picture) for block in blocks) == n_picture
        assert any(isinstance(block, Table) for block in blocks)


def test_reductions_stand_with_their_intervals():
    shown = next(block for block in control_tables(tables()) if isinstance(block, Table))
    row = next(r for r in shown.rows if r[1] == "flight" and r[2] == "pitch")
    assert row[7] == "70.0"


def test_readings_stand_side_by_side_before_every_phase_of_the_flight():
    side_by_side, by_phase = (block for block in motion_table(tables()) if isinstance(block, Table))
    assert side_by_side.rows[0][2:6] == ("88.0", "57.0", "88.6", "88.6")
    assert len(by_phase.rows) == 24


def test_what_the_filtered_rate_is_worth_stands_beside_the_true_rate():
    worth = [block for block in control_tables(tables()) if isinstance(block, Table)][1]
    assert worth.rows[0][8] == "90.0"


def test_in_short_phases_are_a_range_and_verdicts_are_counted():
    assert motion_summary(tables()) == []  # under control
    navigated = tables()
    navigated.__dict__["nozzle"] = navigated.nozzle.iloc[:0]
    short = [block for block in motion_summary(navigated) if isinstance(block, Table)][1]
    assert len(short.rows) == 2 * 6
    assert short.rows[0][1:4] == ("rate roll", "91.4 to 91.4", "88.6 to 88.6")
    assert short.rows[0][-1].endswith("in 2 of 2")


def test_in_brief_burns_are_shown_of_the_cards_own_rate_gain():
    whole, brief = (next(b for b in control_tables(tables(), brief) if isinstance(b, Table)) for brief in (False, True))
    assert len(whole.rows) == 2 * len(brief.rows) == 8


def test_results_without_a_vehicle_show_nothing(tmp_path):
    plain = load(synthetic.results(tmp_path, n_run=0))
    assert motion_table(plain) == control_tables(plain) == motion(plain) == control(plain) == []
