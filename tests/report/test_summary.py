"""The first section answers in words."""

from __future__ import annotations


def test_the_first_section_answers_in_words(text):
    first = text[text.index('id="summary"') : text.index('id="requirements"')]
    assert "<strong>Met by:</strong> imu=fine" in first
    assert "Violated by" in first
    assert "further good runs each would decide" in first
    assert "Largest source in the 3D error, by linear covariance: imu=coarse: gyro bias (75 % of the variance)" in first
    assert "2 of 160 runs failed" in first
