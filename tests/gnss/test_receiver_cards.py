"""Cards of receivers and their solutions."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from lvnav_trade.campaign.reading.expand import expand
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.card_lookup import Shelf, tool_folder
from lvnav_trade.filter.receivers.receiver import FilterSettings, ReportedCovariance, point_model, receiver_filter
from lvnav_trade.gnss.receiver_cards import (
    BancroftSolution,
    ComputedCovariance,
    ConstantCovariance,
    DirectSolution,
    FilteredSolution,
    ReceiverCard,
    SolutionCard,
)

READ = TypeAdapter(SolutionCard)
# Canepa and Servidia, section 6.2.4; what is not printed has its default.
PUBLISHED = {
    "kind": "filtered", "range_sigma": "2 m", "rate_sigma": "0.1 m/s", "jerk": "0.5 m/s^3", "jerk_gain": "0.01 1/s^2",
    "range_gain": "1 m*s^2", "rate_gain": "0.01 m", "clock_noise": "0.005 m/s^2",
    "reported_covariance": {"kind": "own", "factor": 10},
}  # fmt: skip
SECOND = {
    "kind": "filtered", "range_sigma": "4 m", "rate_sigma": "0.2 m/s", "jerk": "1 m/s^3",
    "clock_noise": "0.005 m/s^2",
    "reported_covariance": {"kind": "constant", "position_sigma": "2.2 m", "velocity_sigma": "0.11 m/s"},
}  # fmt: skip
THIRD = {
    **{k: v for k, v in PUBLISHED.items() if not k.startswith("jerk")}, "acceleration_noise": "2.23606797749979 m/s^2",
    "acceleration_gain": "0.2 dimensionless",
}  # fmt: skip
POINT = {"kind": "bancroft", "range_sigma": "2 m", "rate_sigma": "0.1 m/s"}


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize(
    ("card", "arguments"),
    [
        (PUBLISHED, {"range_sigma": 2.0, "rate_sigma": 0.1, "drive_sigma": 0.5, "clock_noise": 0.005,
                     "drive_gain": 0.01, "range_gain": 1.0, "rate_gain": 0.01}),
        (SECOND, {"range_sigma": 4.0, "rate_sigma": 0.2, "drive_sigma": 1.0, "clock_noise": 0.005}),
        (THIRD, {"range_sigma": 2.0, "rate_sigma": 0.1, "drive_sigma": 2.23606797749979, "clock_noise": 0.005,
                 "drive_gain": 0.2, "range_gain": 1.0, "rate_gain": 0.01, "acceleration": False}),
    ],
)  # fmt: skip
def test_the_published_variants_become_the_filters_numbers(card, arguments):
    read, reported = READ.validate_python(card), ReportedCovariance()
    assert isinstance(read, FilteredSolution)
    expected = receiver_filter(reported, 1.0, FilterSettings(start_acceleration=10.0, **arguments))
    assert same(receiver_filter(reported, 1.0, FilterSettings(**read.numbers())), expected)


def test_a_point_solution_becomes_the_solvers_numbers_and_starts_the_filter():
    reported = ReportedCovariance()
    read = READ.validate_python(POINT)
    assert same(point_model(reported, **read.numbers()), point_model(reported, 2.0, 0.1))
    assert READ.validate_python(PUBLISHED).fix == read
    chosen = READ.validate_python(PUBLISHED | {"point": POINT | {"refinements": 0, "least_quality": 3}}).fix
    assert (chosen.refinements, chosen.least_quality) == (0, 3)


def test_what_is_reported_is_chosen_by_kind():
    assert READ.validate_python(PUBLISHED).reported_covariance == ComputedCovariance(factor=10.0)
    assert READ.validate_python(SECOND).reported_covariance == ConstantCovariance(
        kind="constant", position_sigma="2.2 m", velocity_sigma="0.11 m/s"
    )
    assert READ.validate_python(POINT).reported_covariance == ComputedCovariance()


def test_a_simulated_solution_is_one_of_the_kinds():
    read = READ.validate_python({"kind": "direct", "position_sigma": "10 cm", "velocity_sigma": "1 cm/s"})
    assert isinstance(read, DirectSolution)
    assert (read.position_sigma, read.velocity_sigma) == (0.1, 0.01)


@pytest.mark.parametrize("card", [PUBLISHED, SECOND, THIRD, POINT])
def test_a_card_written_out_reads_back_to_the_same(card):
    read = READ.validate_python(card)
    assert READ.validate_json(READ.dump_json(read)) == read


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"jerk": None}, "state jerk"),
        ({"acceleration_noise": "1 m/s^2"}, "state jerk"),
        ({"acceleration_gain": "0.2 dimensionless"}, "jerk_gain goes with jerk"),
        ({"range_sigma": "0 m"}, "greater than 0"),
        ({"jerk": "0.5 m/s^2"}, "wrong unit"),
        ({"reported_covariance": {"kind": "constant"}}, "position_sigma"),
        ({"restart_after": 0}, "greater than or equal to 1"),
        ({"reported_covariance": {"kind": "own", "factor": 0}}, "greater than 0"),
    ],
)
def test_what_makes_no_filter_is_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        READ.validate_python(PUBLISHED | change)


def test_a_filter_without_acceleration_has_none_to_decay():
    with pytest.raises(ValidationError, match="no acceleration to decay"):
        READ.validate_python(THIRD | {"acceleration_time": "10 s"})


def test_a_point_solution_needs_to_assume_some_noise():
    with pytest.raises(ValidationError, match="greater than 0"):
        BancroftSolution(kind="bancroft", range_sigma="2 m", rate_sigma="0 m/s")


@pytest.mark.parametrize("card", [POINT, SECOND])
def test_the_old_key_of_the_reported_covariance_names_the_new_one(card):
    with pytest.raises(ValidationError, match="told: replaced by reported_covariance"):
        READ.validate_python({**card, "told": {"kind": "own"}})


NAMES = sorted(file.stem for file in (tool_folder("configs") / "receivers").glob("*.yaml"))
BARE = {
    "name": "test", "source": "none", "pseudorange_sigma": "2 m", "range_rate_sigma": "0.1 m/s",
    "solution": {"kind": "direct", "position_sigma": "2 m", "velocity_sigma": "0.1 m/s"},
    "clock": {"h0": 0.0, "h_minus2": 0.0},
}  # fmt: skip


def shipped_receiver(name):
    folder = tool_folder("configs")
    node, mistakes = expand(tree.read(folder / "receivers" / f"{name}.yaml"), ReceiverCard, Shelf((folder,)))
    assert mistakes == []
    return ReceiverCard.model_validate(tree.plain_data(node))


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_receiver_reads_and_reads_back(name):
    card = shipped_receiver(name)
    assert ReceiverCard.model_validate(card.model_dump(mode="json")) == card
    assert card.source


def test_the_four_patches_stand_across_the_axis_a_right_angle_apart():
    # Canepa and Servidia, section 6.1 and figure 9
    card = shipped_receiver("l1_four_patch")
    axes = np.array([antenna.boresight for antenna in card.antennas])
    np.testing.assert_array_equal(axes[:, 0], 0.0)
    np.testing.assert_array_equal(np.sum(axes * np.roll(axes, 1, axis=0), axis=1), 0.0)
    np.testing.assert_array_equal(axes, -np.roll(axes, 2, axis=0))
    assert card.mask == pytest.approx(np.radians(10.0))
    assert card.mask_height == pytest.approx(10.0 * 7518.8)


def test_without_antennas_the_one_lever_is_the_receivers():
    assert ReceiverCard(**BARE, lever_b=("1 m", "0 m", "2 m")).lever_arms == ((1.0, 0.0, 2.0),)
    antenna = {"name": "a", "lever_b": ["3 m", "0 m", "0 m"], "pattern": {"kind": "cosine", "peak": "5 dBi"}}
    card = ReceiverCard(**BARE, lever_b=("1 m", "0 m", "2 m"), antennas=[antenna, antenna | {"name": "b"}])
    assert card.lever_arms == ((3.0, 0.0, 0.0),) * 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"loops": {}}, "loops need a link"),
        ({"mask_height": "0 m"}, "greater than 0"),
        ({"latency_sigma": "-1 ms"}, "greater than or equal to 0"),
    ],
)
def test_a_receiver_that_makes_no_sense_is_refused(changes, message):
    with pytest.raises(ValidationError, match=message):
        ReceiverCard(**BARE, **changes)
