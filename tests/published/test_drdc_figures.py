"""Figures of the study of a vehicle model: readings, cases apart, worth of the filtered rate, phases of the flight."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.quantities.shared_cards import EnvelopeCard
from lvnav_trade.report.figures.raster import figure_bytes, matplotlib_figure
from tests.scripts import module
from tests.vehicle_tables import DURING, LESS, RAW, SIGMA, tables

figures = module("drdc", "drdc_figures")
CASE = "aaaaaaaaaaaa"
PAIR = [{"rate_gain": "1"}, {"rate_gain": "2"}]
ARGUMENTS = {"ignition": (CASE,), "worth": (), "interpretations": (), "apart": (PAIR,)}


@pytest.mark.parametrize("name", ARGUMENTS)
def test_axes_are_labelled_and_the_figure_can_be_saved(name):
    made = getattr(figures, name)(tables(), *ARGUMENTS[name])
    for axes in matplotlib_figure(made).axes:
        assert axes.get_xlabel() or not axes.get_subplotspec().is_last_row()
    assert len(figure_bytes(made, "png")) > 5000


def test_readings_stand_beside_what_is_stated():
    axes = matplotlib_figure(figures.interpretations(tables())).axes[0]
    assert [line.get_ydata()[0] for line in axes.get_lines()] == [88.0, 57.0]
    assert axes.containers[0][0].get_height() == pytest.approx(100.0 * (1.0 - SIGMA / RAW))


def test_cases_apart_are_drawn_in_percent_of_the_second():
    lines = {
        line.get_label(): line.get_ydata()
        for line in matplotlib_figure(figures.apart(tables(), PAIR)).axes[0].get_lines()
    }
    np.testing.assert_allclose(lines["position, 3D"], 50.0)  # half of the other case's
    np.testing.assert_allclose(lines["attitude, 3D"], 0.0)


def test_cases_apart_may_show_an_axis_of_a_quantity():
    axes = matplotlib_figure(figures.apart(tables(), PAIR, {"attitude": "roll"})).axes[0]
    lines = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
    assert "attitude, 3D" not in lines
    np.testing.assert_allclose(lines["attitude, roll"], 75.0)
    np.testing.assert_allclose(lines["position, 3D"], 50.0)


def test_what_feeds_the_controller_is_drawn_case_by_case():
    axes = matplotlib_figure(figures.worth(tables(), [{"rate_gain": "2"}])).axes[0]
    raw, filtered, true = (bars[0].get_height() for bars in axes.containers)
    assert filtered == pytest.approx((1.0 - LESS) * raw)
    assert true == pytest.approx(0.1 * raw)


def test_what_is_written_on_the_bars_has_room_in_both_panels():
    above = matplotlib_figure(figures.worth(tables())).axes[:2]
    highest = max(text.get_position()[1] for axes in above for text in axes.texts)
    assert above[0].get_ylim() == above[1].get_ylim()
    assert above[0].get_ylim()[1] == pytest.approx(1.15 * highest)


def test_every_case_that_is_held_against_raw_samples_stands_beside_what_is_stated_of_it():
    found = figures.interpretation_frame(tables())
    assert list(found.case) == ["1", "2"]
    assert list(found.stated_percent) == [88.0, 57.0]
    assert set(found.during) == {DURING}
    assert list(found.raw_percent) == pytest.approx([100.0 * (1.0 - SIGMA / RAW)] * 2)
    assert list(found.unbiased_percent) == pytest.approx([100.0 * (1.0 - SIGMA / RAW)] * 2)


def test_cases_are_named_by_what_sets_them_apart():
    found = tables()
    assert list(figures.short_names(found, list(found.labels)).values()) == ["1", "2"]
    assert list(figures.short_names(found, list(found.labels)[:1]).values()) == [next(iter(found.labels.values()))]


def test_a_campaign_that_holds_nothing_against_raw_samples_has_no_readings():
    found = tables()
    found.__dict__["campaign"] = {}
    assert figures.interpretation_frame(found).empty


def test_readings_stand_side_by_side_where_a_campaign_has_runs_and_no_vehicle_under_control():
    assert figures.interpretations_table(tables()) == []  # under control
    navigated = tables()
    navigated.__dict__["nozzle_travel"] = navigated.nozzle_travel.iloc[:0]
    _, side_by_side = figures.interpretations_table(navigated)
    assert side_by_side.rows[0][2:6] == ("88.0", "57.0", "88.6", "88.6")


FLIGHT = {
    "liftoff": 0.0, "kick": 3.0, "max_q": 45.0, "stage1_cutoff": 85.0, "stage1_separation": 87.0,
    "stage2_ignition": 90.0, "fairing_separation": 145.0, "stage2_cutoff": 165.0, "stage2_separation": 168.0,
    "stage3_ignition": 418.0, "stage3_cutoff": 507.5, "injection": 507.5,
}  # fmt: skip


def of_three_motors():
    found, times = tables(), list(FLIGHT.values())
    rows = {"case": CASE, "event": list(FLIGHT), "kind": "event", "t_s": times, "t_end_s": times, "satellites": ""}
    found.__dict__["events"] = pd.DataFrame(rows)
    return found


def test_phases_are_those_between_the_events_of_the_flight():
    frame = figures.phases_of(of_three_motors(), CASE)
    spans = {
        phase: list(zip(rows.t_s, rows.t_end_s, strict=True)) for phase, rows in frame.groupby("phase", sort=False)
    }
    assert spans["boost"] == [(0.0, 85.0), (90.0, 165.0), (418.0, 507.5)]
    assert spans["coast"] == [(85.0, 90.0), (165.0, 418.0)]
    assert spans["endoatmospheric"] == [(0.0, 145.0)]
    assert spans["exoatmospheric"] == [(145.0, 507.5)]
    # lift-off, three cut-offs, two separations, two ignitions, each as long as the filter's envelope has it
    card = EnvelopeCard()
    changes = [FLIGHT[name] for name in FLIGHT if name.startswith("stage") or name == "liftoff"]
    assert spans["change of phase"] == [(t - card.before_change, t + card.after_change) for t in changes]


def test_phases_are_drawn_row_by_row():
    axes = matplotlib_figure(figures.phases(of_three_motors(), CASE)).axes[0]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["motors", "atmosphere", "filter"]
    assert len(figure_bytes(figures.phases(of_three_motors(), CASE), "png")) > 5000
