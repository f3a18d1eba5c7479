"""Every section stands on the page."""

from __future__ import annotations

import re
import sys

import pandas as pd
import pytest

from lvnav_trade.report import SECTIONS, build
from lvnav_trade.report.evidence import expectation, fact
from lvnav_trade.results.requirements.improvements import ABOVE_ONLY
from lvnav_trade.results.tables.read import load
from tests import synthetic


def test_every_section_stands_on_the_page(text):
    # these filters have no logic, no tests for faults and no model of the vehicle, which is not controlled, and the
    # campaign no scenario, no numeric axis, no Allan deviation, no protection level, no exclusion and no mark
    absent = (
        "logic",
        "integrity",
        "motion",
        "control",
        "models",
        "space",  # each case is stored whole
        "allan",
        "curves",
        "pareto",
        "protection",
        "exclusions",
        "assumptions",
        "configuration",
        "orbit",  # the flight ends on the way up
        "injection",  # and is not guided
    )
    for name in SECTIONS:
        assert (f' id="{name}">' in text) == (name not in absent), name


def test_a_logic_has_its_section_and_linear_covariance_is_not_held_against_it(tmp_path):
    folder = synthetic.results(tmp_path, n_run=8, size=8, logic=True)
    text = build(folder).read_text(encoding="utf-8")
    assert '<details id="logic">' in text
    assert "data loss persists" in text
    assert "logic of its own" in text
    assert (folder / "mode_transitions.csv").read_text(encoding="utf-8").count("imu=fine") == 5


def test_linear_covariance_alone_makes_a_report(tmp_path):
    text = build(synthetic.results(tmp_path, n_run=0)).read_text(encoding="utf-8")
    assert "linear covariance only" in text
    assert "nan" not in re.sub(r"<script.*?</script>|<style>.*?</style>", "", text, flags=re.S).lower()


@pytest.mark.parametrize(
    ("name", "value", "reported"),
    [
        ("perigee_m", 2.0e5, ("perigee (km)", "200")),
        ("record_speed_rms_m_s", 12.5, ("record speed rms (m/s)", "12.5")),
        ("ground_speed_at_end_m_per_s", 7.0, ("ground speed at end (m/s)", "7")),
        ("kick_after_record_s", 3.0, ("kick after record (s)", "3")),
        ("position_misfit_rms_m", 0.5, ("position misfit rms (m)", "0.5")),
        ("inclination_rad", 0.5 * 3.141592653589793, ("inclination (deg)", "90")),
        ("max_load_g", 4.2, ("max load (g)", "4.2")),
        ("compared_with", "a record", ("compared with", "a record")),
    ],
)
def test_afact_is_reported_in_the_unit_of_its_name(name, value, reported):
    assert fact(name, value) == reported


def test_what_linear_covariance_bounds_from_above_only_is_reported_as_such():
    frame = pd.DataFrame({"expected_probability": [0.5, 0.999], "reason": ["", ABOVE_ONLY]})
    assert list(expectation(frame)) == ["50.0", "at most 99.9"]
    assert list(expectation(frame[:1])) == [50.0]


NONE = {"troposphere_m": 0.0, "troposphere_left_m": 0.0, "ionosphere_m": 0.0, "ionosphere_left_m": 0.0}
pages = sys.modules[build.__module__]  # the package has a function of that name


@pytest.fixture
def few(monkeypatch):
    """Leave the sections on signals alone, for the time that the others take."""
    monkeypatch.setattr(pages, "SECTIONS", {name: pages.SECTIONS[name] for name in ("tracking", "delays")})


@pytest.mark.usefixtures("few")
def test_transitions_stand_beside_the_report_only_where_there_are_some(tmp_path):
    folder = synthetic.unsealed(synthetic.results(tmp_path, n_run=0))
    build(folder)
    assert len(pd.read_csv(folder / "transitions.csv")) == len(load(folder).transitions)
    load(folder).transitions.iloc[:0].to_parquet(folder / "transitions.parquet")
    text = build(folder).read_text(encoding="utf-8")
    assert not (folder / "transitions.csv").exists()
    assert 'id="tracking"' in text  # a fault takes satellites


@pytest.mark.usefixtures("few")
def test_a_section_that_is_asked_for_by_name_says_that_it_is_empty(tmp_path):
    folder = synthetic.unsealed(synthetic.results(tmp_path, n_run=0))
    load(folder).satellites.assign(**NONE, latency_s=0.0).to_parquet(folder / "satellites.parquet")
    assert 'id="delays"' not in build(folder).read_text(encoding="utf-8")
    assert "Nothing to show." in build(folder, ["delays"]).read_text(encoding="utf-8")
