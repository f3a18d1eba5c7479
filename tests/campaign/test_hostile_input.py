# ruff: noqa: E501 - a message stands in one line, as the user sees it
"""Input that is made to hang, to exhaust memory or to fail inside: refused in a few short lines before anything is built."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lvnav_trade import api
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.errors import InputError

ALIASES = "x0: &x0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"x{k}: &x{k} [{', '.join([f'*x{k - 1}'] * 9)}]\n" for k in range(1, 9)
)
FAULT = "{kind: satellite_outage, start: 100 s, duration: 30 s}"


def faults(text: str) -> tuple[str, str]:
    return "imu: imu/good", f"imu: imu/good\n  faults: {text}"


EDITS = {
    "a_tower_of_powers": ('"1 m"', '"1 m**9**9**9**9"', "has no unit that is known"),
    "a_quantity_of_a_megabyte": ('"1 m"', f'"{"9" * 1_000_000} m"', "more than 100000 characters in a text"),
    "a_quantity_of_many_letters": ('"1 m"', f'"1 {"m" * 90_000}"', "90002 characters, at most 80"),
    "a_card_of_300_letters": ("imu/good", "i" * 300, "base.imu: no card 'iii"),
    "a_card_of_3000_folders": ("imu/good", "i/" * 3_000, "base.imu: no card 'i/i"),
    "a_card_with_a_zero_byte": ("imu/good", '"imu/\\0good"', r"'imu/\x00good' has the hidden character U+0000"),
    "a_card_that_is_a_device": ("imu/good", "/dev/zero", "no card '/dev/zero'"),
    "a_card_that_is_a_mapping": ("imu/good", "{card: {a: b}}", "a card is named by a word"),
    "a_kind_that_is_a_mapping": (
        "constellations/two",
        "{kind: {a: {b: c}}}",
        "kind a mapping is not one of nominal, almanac",
    ),
    "a_kind_that_is_a_list": (*faults("[{kind: [a], start: 100 s}]"), "kind a list is not one of satellite_outage"),
    "a_name_that_is_a_mapping": ("name: study", "name: {a: b}", "campaign.yaml:1:7: name: should be a valid string"),
    "a_quantity_that_is_a_list": ('"0.1 deg"', "[1, 2]", "expected a quantity in a unit of angle"),
    "too_many_faults": (
        *faults(f"[{', '.join([FAULT] * 101)}]"),
        "base.faults: list should have at most 100 items, not 101",
    ),
    "a_list_that_is_too_long": (*faults(f"[{', '.join(['x'] * 10_001)}]"), "more than 10000 items in a list"),
    "an_antenna_twice": (
        *faults("[{kind: antenna_failure, antennas: [2, 2], start: 1 s, duration: 1 s}]"),
        "base.faults.0.antennas: 2 is listed twice",
    ),
    "a_fault_twice": (
        *faults("[{kind: clock_jump, size: 1 m, start: 1 s}, {kind: clock_jump, size: 1 m, start: 1 s}]"),
        "faults.1: is the same as faults.0",
    ),
    "a_satellite_twice": (
        *faults("[{kind: wild_samples, satellites: [A1, A1], sigma: 1 m, start: 1 s, duration: 1 s}]"),
        "base.faults.0.satellites: 'A1' is listed twice",
    ),
}
LINES = {
    "an_alias_of_aliases": (ALIASES, "with its aliases more than 60000 words, lists and mappings"),
    "many_aliases": (f"x: &x 1\ny: [{', '.join(['*x'] * 1_001)}]\n", "more than 1000 aliases"),
    "many_brackets": (f"x: {'[' * 5_000}{']' * 5_000}\n", "more than 30 lists and mappings within each other"),
    "many_braces": (f"x: {'{a: ' * 5_000}{'}' * 5_000}\n", "more than 30 lists and mappings within each other"),
    "brackets_that_never_close": (f"x: {'[' * 100_000}\n", "more than 30 lists and mappings within each other"),
    "too_large_a_file": ("#" * 2**20 + "\n", "bytes; at most 1048576 are read"),
    "a_key_that_moves_the_cursor": ('"\\e[2Jkey\\u202e": 1\n', r"campaign.yaml:10:1: \x1b[2Jkey\u202e: unknown key"),
    "a_description_that_turns_round": ('description: "ready \\u202etxt"\n', r"description: 'ready \u202etxt' has the hidden character U+202E; remove it"),
    "a_name_with_a_mark_that_nobody_sees": ('requirements: [{name: "\\ufeffa", metric: velocity_error_3d}]\n', r"requirements.0.name: '\ufeffa' has the hidden character U+FEFF"),
    "a_requirement_that_clears_the_screen": ('requirements: [{name: "a\\e[2J", metric: velocity_error_3d}]\n', r"requirements.0.name: 'a\x1b[2J' has the hidden character U+001B"),
    "a_tag_that_makes_objects": ("description: !!python/object:os.system x\n", "has no meaning here"),
    "a_history_of_more_times_than_memory_holds": ("keep: {history: 5e-9 s}\n", "keep.history: 5e-09 s is too fine; give 1 ms or more"),
    "a_history_coarser_than_a_day": ("keep: {history: 5e9 s}\n", "keep.history: should be less than or equal to 86400"),
    "a_tag_that_lies": ("description: !!bool maybe\ndesign: !!bool zip\nkeep: {history: !!float no}\n", "history: 'no' is not a quantity"),
    "runs_that_are_true": ("monte_carlo: {runs: true}\n", "monte_carlo.runs: should be a number, not true"),
    "runs_without_end": ("monte_carlo: {runs: 1000000000000000000}\n", "1000000000000000000 runs; give 1000000 at most"),
    "runs_that_are_a_power": ("monte_carlo: {runs: 10**18}\n", "should be a valid integer, not '10**18'"),
    "an_axis_that_is_a_mapping": ("axes: [{path: {a: b}, values: [1]}]\n", "axes.0.path: should be a valid string"),
    "an_axis_that_is_a_list": ("axes: [[1, 2]]\n", "axes.0: should be a mapping"),
    "a_card_where_a_list_belongs": ("axes: [{path: faults, cards: [imu/good]}]\n", "base.faults: should be a list"),
    "a_word_in_a_list": ("axes: [{path: trajectory.vehicle.stages.0, values: [x]}]\n", "base.trajectory.vehicle.stages.0: no card 'x'"),
    "a_number_in_a_list": ("axes: [{path: trajectory.vehicle.mach.0, values: [x]}]\n", "should be a valid number, not 'x'"),
    "an_item_that_is_not_there": ("axes: [{path: trajectory.vehicle.stages.7, values: [1]}]\n", "'trajectory.vehicle.stages.7' is not a field of the base"),
    "an_item_in_other_digits": ("axes: [{path: trajectory.vehicle.stages.\u00b2, values: [1]}]\n", "is not a field of the base"),
    "a_path_of_9000_steps": (f"axes: [{{path: {'filter.' * 9_000}gate, values: [4]}}]\n", "is not a field of the base"),
    "a_set_that_is_a_mapping": ("requirements: [{card: {a: b}}]\n", "should be a requirement, or the name of a set of them"),
    "a_bound_of_another_dimension": ("requirements: [{name: a, metric: velocity_error_3d, probability: 0.9, below: 1 kg}]\n", "'1 kg' has the wrong unit"),
}  # fmt: skip


def refused(name: str = "campaign.yaml", sets: tuple[str, ...] = ()) -> str:
    with pytest.raises(InputError) as caught:
        load(name, sets)
    reported = str(caught.value)
    assert all(line.isprintable() for line in reported.splitlines())
    assert "Node(" not in reported
    assert max(map(len, reported.splitlines())) < 1_500
    assert len(reported.splitlines()) <= 101
    return reported


@pytest.mark.parametrize("what", EDITS)
def test_what_is_written_in_place_of_something_is_refused(study, what: str) -> None:
    old, new, message = EDITS[what]
    study.edit("campaign.yaml", old, new)
    assert message in refused()


@pytest.mark.parametrize("what", LINES)
def test_what_is_written_beside_it_is_refused(study, what: str) -> None:
    lines, message = LINES[what]
    study.path.write_text(study.path.read_text() + lines, encoding="utf-8")
    assert message in refused()


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("im\x1b[2Ju=3", r"--set: im\x1b[2Ju: unknown path"),
        (f"imu={'i' * 400}", "--set: base.imu: no card 'iii"),
        (f"imu={'[' * 5_000}", "more than 30 lists and mappings within each other"),
        ("faults.\u00b2.keep=1", "is not an item of a list of 0"),
    ],
)
def test_what_is_set_is_refused(study, assignment: str, message: str) -> None:
    assert message in refused(sets=(assignment,))


def test_a_pipe_a_device_and_a_name_that_is_too_long_are_no_campaigns(study) -> None:
    os.mkfifo("pipe.yaml")
    assert refused("pipe.yaml") == "pipe.yaml: is not a regular file"
    assert refused("/dev/zero") == "/dev/zero: is not a regular file"
    assert "File name too long" in refused("c" * 300)
    assert refused("c\0") == r"c\x00: no such file"


def test_a_pipe_is_no_card_and_no_file_of_data(study) -> None:
    os.mkfifo("configs/imu/pipe.yaml")
    os.mkfifo("rows.csv")
    study.edit("campaign.yaml", "imu/good", "imu/pipe")
    study.edit("campaign.yaml", "constellations/two", "{kind: almanac, almanac: rows.csv}")
    reported = refused()
    assert "base.imu: no card 'imu/pipe'" in reported
    assert "base.constellation.almanac: no such file: 'rows.csv'" in reported


def test_thousands_of_mistakes_are_reported_in_a_hundred_lines(study) -> None:
    study.edit("campaign.yaml", *faults(f"[{', '.join(['x'] * 200)}]"))
    assert refused().splitlines()[-1].startswith("and ")
    satellites = ", ".join(f"G{k}" for k in range(150))
    study.append("")
    study.edit("configs/vehicles/small.yaml", '"300 kg"', '"150 kg"')
    study.edit(
        "campaign.yaml",
        *faults(f"[{{kind: wild_samples, satellites: [{satellites}], sigma: 1 m, start: 1 s, duration: 1 s}}]"),
    )
    with pytest.raises(InputError) as caught:
        api.check("campaign.yaml")
    assert [len(caught.value.records), caught.value.records[-1].message] == [101, "and 50 more"]


def test_a_rule_of_a_field_is_reported_at_the_field_where_a_kind_has_the_name_of_another_field(study) -> None:
    study.edit("configs/trajectories/climb.yaml", "2026-08-01", "9999-99-99")
    assert refused().startswith(
        "configs/trajectories/climb.yaml:4:8: base.trajectory.epoch: '9999-99-99T12:00:00Z' is not an ISO 8601 time"
    )


def test_a_card_that_changes_is_read_again(study) -> None:
    assert load("campaign.yaml").base.imu.rate == 200.0
    card = Path("configs/imu/good.yaml")
    card.write_text(card.read_text().replace("200 Hz", "1000 Hz"))
    assert load("campaign.yaml").base.imu.rate == 1000.0
