"""Names of metrics and their units."""

import pytest

from lvnav_trade.campaign.definition.metric_names import known_metric, unit_of


@pytest.mark.parametrize(
    ("metric", "unit"),
    [("mode_entry_time", "s"), ("mode_entry_share", "-"), ("velocity_coverage", "-"), ("position_error_3d", "m"),
     ("nozzle_movement_pitch", "%"), ("reacquisition_time", "s"), ("apogee_error", "m")],
)  # fmt: skip
def test_a_metric_has_its_unit(metric, unit):
    assert known_metric(metric) == metric
    assert unit_of(metric) == unit


def test_what_is_no_metric_is_refused_with_what_may_be_meant():
    with pytest.raises(ValueError, match="did you mean 'mode_entry_time'"):
        known_metric("mode_entry_tim")
