"""The stated reading of an attitude is compared with the others by where the forces lie in the body."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.trajectory.files.first_rows import AttitudeInterpretation, interpretation_warning
from lvnav_trade.trajectory.flight import build
from lvnav_trade.trajectory.truth import WARNING
from tests.trajectory.tables import card, example_settings


def stated(**changes):
    settings = example_settings()
    return {**settings, "attitude": {**settings["attitude"], **changes}}


def test_an_attitude_against_axes_of_j2000_that_is_stated_against_those_of_date_is_warned_of() -> None:
    # 0.31 deg of precession and less across the trajectory; the true reading lies along the forces
    (line,) = [one.text for one in build(card(stated(frame="j2000"))).remarks if one.category == WARNING]
    assert line.startswith("forces above 1 g lie 0.")
    assert line.endswith("(median) as the attitude is stated, and 0.00 deg with frame: eci")
    assert [one for one in build(card(stated())).remarks if one.category == WARNING] == []


def test_a_reading_that_fits_ten_times_better_refuses_the_stated_one_unless_an_angle_is_meant() -> None:
    true, turned = card(stated()), card(stated(turns="frame_to_body"))
    found = [
        AttitudeInterpretation(turned.attitude, np.radians(3.4)),
        AttitudeInterpretation(true.attitude, np.radians(0.04)),
    ]
    fault = r"lie 3\.40 deg off the body's x axis \(median\) as the attitude is stated, and 0\.04 deg with turns: body"
    with pytest.raises(InputError, match=fault):
        interpretation_warning(turned, found)
    assert "3.40 deg" in interpretation_warning(
        card(stated(turns="frame_to_body"), largest_force_angle="20 deg"), found
    )
    assert interpretation_warning(true, [found[1], found[0]]) == ""
