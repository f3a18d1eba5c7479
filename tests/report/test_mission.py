"""The sections on the mission say what the tables hold."""

from __future__ import annotations

import pandas as pd
import pytest

from lvnav_trade.report import build, mission
from lvnav_trade.store import load
from tests import mission as flights
from tests.metrics.mechanics.test_mission import falling
from tests.metrics.mission.test_impact import INSIDE, with_corridor


@pytest.fixture(scope="module")
def orbit_page(tmp_path_factory):
    folder = flights.results(tmp_path_factory.mktemp("page") / "orbit", n_run=40)
    return build(folder, ["orbit", "impact"])


def test_the_page_has_orbit_correction_and_their_tables_beside_it(orbit_page):
    text = orbit_page.read_text(encoding="utf-8")
    assert 'id="orbit"' in text
    assert "Delta-v of the correction" in text
    assert "No stored state of any case has a point of impact." in text
    for name in ("orbit", "correction", "impact", "corridor"):
        assert (orbit_page.parent / f"{name}.csv").exists()
    frame = pd.read_csv(orbit_page.parent / "orbit.csv")
    assert {"perigee height", "lowest height"} <= set(frame.quantity)
    assert (orbit_page.parent / "figures" / f"orbit-{flights.CASE}.png").exists()


def test_elements_have_seven_digits(orbit_page):
    tables = [block for block in mission.orbit(load(orbit_page.parent)) if block.kind == "table"]
    table = next(block for block in tables if block.caption.endswith("orbit at injection."))
    row = next(row for row in table.rows if row[0] == "semi-major axis")
    assert row[1:4] == ("km", "6900", row[3])
    assert len(row[3]) >= 7


def test_a_fall_has_points_of_impact_and_a_verdict_on_the_corridor(tmp_path):
    folder = flights.results(tmp_path / "fall", falling(), 40, campaign=with_corridor(INSIDE))
    text = build(folder, ["orbit", "impact"]).read_text(encoding="utf-8")
    assert "No case ends in an orbit that clears the ground." in text
    assert "The corridor." in text
    assert "point of impact at the events" in text


def test_a_circular_orbit_says_why_there_is_no_sigma(tmp_path):
    tables = load(flights.results(tmp_path, flights.CIRCULAR, n_run=0, factor=40.0))
    reported = [block for block in mission.orbit(tables) if getattr(block, "lead", "") == "Not applicable."]
    assert len(reported) >= 1
    assert reported[0].text.startswith("the orbit is circular to within 3 sigma")
