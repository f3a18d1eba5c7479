"""Every section stands on the page."""

from __future__ import annotations

import re

import pandas as pd
import pytest

from lvnav_trade.metrics.requirements.improvements import ABOVE_ONLY
from lvnav_trade.report import SECTIONS, build
from lvnav_trade.report.evidence import expectation, fact
from tests import synthetic


def test_every_section_stands_on_the_page(text):
    absent = ("logic", "motion", "control")  # these filters have none, nor a model of the vehicle, nor its control
    for name in SECTIONS:
        assert (f'<section id="{name}">' in text) == (name not in absent), name


def test_a_logic_has_its_section_and_linear_covariance_is_not_held_against_it(tmp_path):
    folder = synthetic.results(tmp_path, n_run=8, size=8, logic=True)
    text = build(folder).read_text(encoding="utf-8")
    assert '<section id="logic">' in text
    assert "data loss persists" in text
    assert "logic of its own" in text
    assert (folder / "logic.csv").read_text(encoding="utf-8").count("imu=fine") == 5


def test_linear_covariance_alone_makes_a_report(tmp_path):
    text = build(synthetic.results(tmp_path, n_run=0)).read_text(encoding="utf-8")
    assert "linear covariance only" in text
    assert "nan" not in re.sub(r"base64,[^\"]+|<style>.*?</style>", "", text, flags=re.S).lower()


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
