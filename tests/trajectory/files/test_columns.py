"""The card of a user's own file says all that is needed, and says it once."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from lvnav_trade.trajectory.files.columns import TableTrajectory
from tests.trajectory.tables import card, example_settings


def test_the_shipped_example_is_a_card_and_reads_back_to_itself():
    example = card(example_settings())
    assert TableTrajectory.model_validate_json(example.model_dump_json()) == example


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"time": {"column": "t"}}, "time.unit"),
        ({"time": {"column": "t", "unit": "m"}}, "'1 m' has the wrong unit; expected time"),
        ({"position": {"frame": "ecef", "columns": ["x", "y", "z"]}}, "position.unit"),
        (
            {"position": {"frame": "tod", "columns": ["x", "y", "z"], "unit": "m"}},
            "'geodetic', 'ecef', 'eci' or 'j2000'",
        ),
        ({"position": {"frame": "ecef", "columns": ["x", "y"], "unit": "m"}}, "at least 3 items"),
        ({"position": {"frame": "ecef", "columns": ["x", "y", "z"], "unit": "deg"}}, "wrong unit; expected length"),
        ({"position": {"frame": "geodetic", "columns": ["x", "y", "z"], "unit": "m"}}, "wrong unit; expected angle"),
        ({"position": {"frame": "geodetic", "columns": ["x", "y", "z"], "unit": "deg"}}, "height_unit is missing"),
        (
            {"position": {"frame": "eci", "columns": ["x", "y", "z"], "unit": "m", "height_unit": "m"}},
            "height_unit means nothing in frame eci",
        ),
        ({"velocity": {"frame": "enu", "columns": ["x", "y", "z"], "unit": "m/s"}}, "'ecef', 'eci', 'j2000' or 'ned'"),
        ({"velocity": {"frame": "ned", "columns": ["x", "y", "z"], "unit": "m"}}, "expected speed"),
        ({"attitude": {"form": "euler", "frame": "ned", "columns": ["a", "b", "c"]}}, "unit is for Euler angles"),
        ({"attitude": {"form": "quaternion", "frame": "eci", "columns": ["a", "b", "c"]}}, "takes 4 columns, not 3"),
        (
            {"attitude": {"form": "quaternion", "frame": "eci", "columns": [*"abcd"], "turns": "body_to_frame"}},
            "needs it: first or last",
        ),
        ({"attitude": {"form": "matrix", "frame": "eci", "columns": [*"abcdefghi"]}}, "turns is for"),
        ({"events": {"end": "10 s"}}, "'end' cannot name an event: it is one already"),
        ({"events": {"a b": "10 s"}}, "'a b' cannot name an event"),
        ({"moving_reference": [["liftoff", "staging"]]}, "'staging', which is no event"),
        ({"velocity": None, "velocity_noise": "1 m/s"}, "velocity_noise has no effect: .* does not state columns"),
        ({"attitude": None, "attitude_noise": "1 mrad"}, "attitude_noise has no effect: the card does not state"),
        (
            {"attitude": None, "largest_force_angle": "9 deg"},
            "largest_force_angle has no effect: the card does not state",
        ),
        ({"moving_reference": [["liftoff", "end"]], "velocity": None}, "moving_reference needs a velocity"),
    ],
)
def test_a_card_that_leaves_something_open_is_refused(changes, fault):
    with pytest.raises(ValidationError, match=fault):
        card({**example_settings(), **changes})


@pytest.mark.parametrize("setting", [{"pointing": "velocity"}, {"roll": {"pad": "20 deg"}}])
def test_what_stands_for_an_attitude_is_refused_beside_one(setting: dict[str, object]) -> None:
    with pytest.raises(ValidationError, match="has no effect: the card states columns of attitude"):
        card({**example_settings(), **setting})
