# ruff: noqa: E501 - a message stands in one line, as the user sees it
"""Every mistake in a campaign or a card is one line that says where and what."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.load import load
from lvnav_trade.errors import InputError

# What goes wrong, the file, the text and what it becomes, the message: one line per mistake.
BAD: dict[str, tuple[str, str, str, str]] = {
    "a_misspelt_key_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\ndesing: grid",
        "campaign.yaml:3:1: desing: unknown key (did you mean 'design'?)",
    ),
    "a_missing_key_is_named": ("campaign.yaml", "seed: 7\n", "", "campaign.yaml:1:1: seed: is missing"),
    "a_key_that_stands_twice_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\nseed: 8",
        "campaign.yaml:3:1: seed: the key 'seed' stands twice (first on line 2)",
    ),
    "a_negative_seed_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: -7",
        "campaign.yaml:2:7: seed: should be greater than or equal to 0, not -7",
    ),
    "a_seed_that_is_a_word_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: no",
        "campaign.yaml:2:7: seed: should be a valid integer, not 'no'",
    ),
    "a_name_that_cannot_be_a_folder_is_refused": (
        "campaign.yaml",
        "name: study",
        "name: ../study",
        "campaign.yaml:1:7: name: '../study' cannot name a folder; use letters, digits, '-', '_' and '.'",
    ),
    "an_unknown_card_is_refused": (
        "campaign.yaml",
        "imu/good",
        "imu/goood",
        "campaign.yaml:5:8: base.imu: no card 'imu/goood' (did you mean 'imu/good'?)",
    ),
    "a_number_in_place_of_a_card_is_refused": (
        "campaign.yaml",
        "imu/good",
        "3",
        "campaign.yaml:5:8: base.imu: should be a mapping or the name of a card",
    ),
    "a_field_left_empty_is_refused": (
        "campaign.yaml",
        "imu: imu/good",
        "imu:",
        "campaign.yaml:5:3: base.imu: should be a mapping or the name of a card",
    ),
    "an_unknown_key_in_an_override_is_refused": (
        "campaign.yaml",
        "imu: imu/good",
        "imu: {card: imu/good, gyro: {random_wlak: 1 deg/sqrt(h)}}",
        "campaign.yaml:5:32: base.imu.gyro.random_wlak: unknown key (did you mean 'random_walk'?)",
    ),
    "a_misspelt_unit_is_refused": (
        "campaign.yaml",
        "imu: imu/good",
        "imu: {card: imu/good, gyro: {random_walk: 1 deg/srt(h)}}",
        "campaign.yaml:5:45: base.imu.gyro.random_walk: '1 deg/srt(h)' has no unit that is known ('deg/srt(h)'); expected angle random walk (deg/sqrt(h), deg/h/sqrt(Hz)) (did you mean 'deg/sqrt(h)'?)",
    ),
    "a_card_without_unit_is_refused": (
        "configs/imu/good.yaml",
        '"1 deg/h"',
        "1",
        "configs/imu/good.yaml:4:61: base.imu.gyro.bias_repeatability: 1 has no unit; write it as a quantity in a unit of angular rate (deg/h, deg/s, rad/s)",
    ),
    "a_wrong_unit_in_a_card_is_refused": (
        "configs/imu/good.yaml",
        '"1 deg/h"',
        "1 deg",
        "configs/imu/good.yaml:4:61: base.imu.gyro.bias_repeatability: '1 deg' has the wrong unit; expected angular rate (deg/h, deg/s, rad/s)",
    ),
    "an_infinite_quantity_is_refused": (
        "configs/imu/good.yaml",
        '"1 deg/h"',
        "inf deg/h",
        "configs/imu/good.yaml:4:61: base.imu.gyro.bias_repeatability: 'inf deg/h' is not a finite quantity",
    ),
    "a_missing_key_in_a_card_is_named_in_the_card": (
        "configs/imu/good.yaml",
        "source: test\n",
        "",
        "configs/imu/good.yaml:1:1: base.imu.source: is missing",
    ),
    "an_unknown_filter_kind_is_refused": (
        "configs/filters/near.yaml",
        "kind: tight",
        "kind: tigth",
        "configs/filters/near.yaml:3:7: base.filter.kind: 'tigth' is not one of inertial, loose, tight (did you mean 'tight'?)",
    ),
    "a_bare_word_where_matched_is_meant_is_refused": (
        "configs/filters/near.yaml",
        "kind: tight",
        "kind: tight\nimu: matchd",
        "configs/filters/near.yaml:4:6: base.filter.imu: no card 'matchd' (did you mean 'matched'?)",
    ),
    "a_gate_of_zero_is_refused": (
        "configs/filters/near.yaml",
        "kind: tight",
        "kind: tight\ngate: 0",
        "configs/filters/near.yaml:4:7: base.filter.gate: should be greater than 0, not 0",
    ),
    "a_wrong_case_of_a_word_is_refused": (
        "configs/filters/near.yaml",
        "kind: tight",
        "kind: tight\ngravity: J2",
        "configs/filters/near.yaml:4:10: base.filter.gravity: 'J2' is not one of point, j2, j4 (did you mean 'j2'?)",
    ),
    "a_mistake_in_a_card_of_a_card_stands_in_its_file": (
        "configs/vehicles/small.yaml",
        '"30 t"',
        '"30 tt"',
        "configs/vehicles/small.yaml:4:29: base.trajectory.vehicle.stages.0.propellant: '30 tt' has no unit that is known ('tt'); expected mass (kg, t) (did you mean 't'?)",
    ),
    "a_rule_of_a_card_is_told_in_its_file": (
        "configs/vehicles/small.yaml",
        "mach: [0, 10]",
        "mach: [0, 5, 10]",
        "configs/vehicles/small.yaml:1:1: base.trajectory.vehicle: 3 Mach numbers but 2 drag coefficients",
    ),
    "a_card_of_a_card_that_is_unknown_is_refused": (
        "configs/trajectories/climb.yaml",
        "vehicles/small",
        "vehicles/smal",
        "configs/trajectories/climb.yaml:5:10: base.trajectory.vehicle: no card 'vehicles/smal' (did you mean 'vehicles/small'?)",
    ),
    "a_card_that_names_itself_is_refused": (
        "configs/imu/good.yaml",
        "name: good",
        "card: imu/good\nname: good",
        "configs/imu/good.yaml:1:7: base.imu: the card 'imu/good' leads back to itself",
    ),
    "an_unknown_kind_of_constellation_is_refused": (
        "campaign.yaml",
        "constellations/two",
        "{kind: nominall}",
        "campaign.yaml:6:18: base.constellation: kind 'nominall' is not one of nominal, almanac (did you mean 'nominal'?)",
    ),
    "a_constellation_of_no_kind_is_refused": (
        "campaign.yaml",
        "constellations/two",
        "{almanack: my.alm}",
        "campaign.yaml:6:18: base.constellation: needs a kind: nominal, almanac (did you mean 'almanac'?)",
    ),
    "a_file_that_is_not_there_is_refused": (
        "campaign.yaml",
        "constellations/two",
        "{almanac: my.alm}",
        "campaign.yaml:6:28: base.constellation.almanac: no such file: 'my.alm'",
    ),
    "an_unknown_frame_is_refused": (
        "campaign.yaml",
        "  imu: imu/good",
        "  imu: imu/good\n  frame: nde",
        "campaign.yaml:6:10: base.frame: 'nde' is not one of ned, ecef, inertial, orbital (did you mean 'ned'?)",
    ),
    "zero_runs_are_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\nmonte_carlo: {runs: 0}",
        "campaign.yaml:3:21: monte_carlo.runs: 0 runs; give at least 1, or leave monte_carlo out for linear covariance alone",
    ),
    "half_a_run_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\nmonte_carlo: {runs: 1.5}",
        "campaign.yaml:3:21: monte_carlo.runs: should be a valid integer, got a number with a fractional part, not 1.5",
    ),
    "a_block_that_lanes_do_not_fill_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\nmonte_carlo: {runs: 9, block: 12}",
        "campaign.yaml:3:31: monte_carlo.block: should be a multiple of 8, not 12",
    ),
    "an_unknown_design_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\ndesign: gird",
        "campaign.yaml:3:9: design: 'gird' is not one of grid, zip, one_at_a_time (did you mean 'grid'?)",
    ),
    "an_axis_over_nothing_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\naxes: [{path: imu, cards: []}]",
        "campaign.yaml:3:8: axes.0: an axis needs at least one card or value",
    ),
    "an_axis_with_cards_and_values_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\naxes: [{path: imu, cards: [imu/good], values: [1]}]",
        "campaign.yaml:3:8: axes.0: an axis has either cards or values",
    ),
    "an_axis_over_an_unknown_field_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\naxes: [{path: imuu, cards: [imu/good]}]",
        "campaign.yaml:3:15: axes.0.path: 'imuu' is not a field of the base (did you mean 'imu'?)",
    ),
    "an_axis_over_an_unknown_nested_field_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\naxes: [{path: filter.gat, values: [5]}]",
        "campaign.yaml:3:15: axes.0.path: 'filter.gat' is not a field of the base (did you mean 'gate'?)",
    ),
    "an_axis_with_a_bad_value_is_refused_at_the_value": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\naxes: [{path: filter.gate, values: [5, -2]}]",
        "campaign.yaml:3:40: base.filter.gate: should be greater than 0, not -2",
    ),
    "an_axis_with_an_unknown_card_is_refused_at_the_card": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\naxes: [{path: imu, cards: [imu/good, imu/por]}]",
        "campaign.yaml:3:38: base.imu: no card 'imu/por' (did you mean 'imu/poor'?)",
    ),
    "labels_that_do_not_match_their_levels_are_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\naxes: [{path: imu, cards: [imu/good], labels: [a, b]}]",
        "campaign.yaml:3:8: axes.0: 2 labels for 1 levels",
    ),
    "axes_of_unequal_length_are_not_zipped": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\ndesign: zip\naxes: [{path: imu, cards: [imu/good]}, {path: filter.gate, values: [4, 5]}]",
        "campaign.yaml:4:7: axes: design zip needs axes of equal length, not [1, 2]",
    ),
    "a_covariance_rate_that_does_not_divide_the_imu_rate_is_refused": (
        "configs/filters/near.yaml",
        "kind: tight",
        "kind: tight\ncovariance_rate: 30 Hz",
        "configs/filters/near.yaml:4:18: base.filter.covariance_rate: 30 Hz does not divide the IMU rate of 200 Hz",
    ),
    "an_update_rate_that_does_not_divide_the_covariance_rate_is_refused": (
        "configs/filters/near.yaml",
        "kind: tight",
        "kind: tight\ncovariance_rate: 1 Hz\nupdate_rate: 0.7 Hz",
        "configs/filters/near.yaml:5:14: base.filter.update_rate: 0.7 Hz does not divide the covariance rate of 1 Hz\nconfigs/filters/near.yaml:5:14: base.filter.update_rate: 0.7 Hz does not divide the receiver rate of 1 Hz",
    ),
    "an_update_faster_than_the_receiver_is_refused": (
        "configs/filters/near.yaml",
        "kind: tight",
        "kind: tight\nupdate_rate: 2 Hz",
        "configs/filters/near.yaml:4:14: base.filter.update_rate: 2 Hz does not divide the receiver rate of 1 Hz",
    ),
    "a_rate_of_zero_is_refused": (
        "configs/imu/good.yaml",
        '"200 Hz"',
        "0",
        "configs/imu/good.yaml:3:7: base.imu.rate: should be greater than 0, not 0",
    ),
    "a_negative_sigma_is_refused": (
        "configs/imu/good.yaml",
        '"1 deg/h"',
        "-1 deg/h",
        "configs/imu/good.yaml:4:61: base.imu.gyro.bias_repeatability: should be greater than or equal to 0, not '-1 deg/h'",
    ),
    "a_negative_noise_is_refused": (
        "configs/imu/good.yaml",
        '"0.05 mg/sqrt(Hz)"',
        "-0.05 mg/sqrt(Hz)",
        "configs/imu/good.yaml:5:22: base.imu.accel.random_walk: should be greater than or equal to 0, not '-0.05 mg/sqrt(Hz)'",
    ),
    "a_negative_initial_error_is_refused": (
        "campaign.yaml",
        'tilt: "0.1 deg"',
        "tilt: -0.1 deg",
        "campaign.yaml:9:19: base.initial.tilt: should be greater than or equal to 0, not '-0.1 deg'",
    ),
    "a_negative_receiver_sigma_is_refused": (
        "configs/receivers/plain.yaml",
        'position_sigma: "3 m"',
        "position_sigma: -3 m",
        "configs/receivers/plain.yaml:5:28: base.receiver.solution.position_sigma: should be greater than or equal to 0, not '-3 m'",
    ),
    "a_belief_below_zero_is_refused": (
        "campaign.yaml",
        "filters/near",
        "{card: filters/near, initial: {tilt: 1 deg, heading: 1 deg, position: -1 m, velocity: 1 m/s, clock_bias: 1 m, clock_drift: 1 m/s}}",
        "campaign.yaml:8:81: base.filter.initial.position: should be greater than or equal to 0, not '-1 m'",
    ),
    "a_negative_rate_is_refused": (
        "configs/filters/near.yaml",
        "kind: tight",
        "kind: tight\nupdate_rate: -1 Hz",
        "configs/filters/near.yaml:4:14: base.filter.update_rate: should be greater than 0, not '-1 Hz'",
    ),
    "a_negative_bandwidth_is_refused": (
        "configs/imu/good.yaml",
        "gyro: {",
        "gyro: {bandwidth: -60 Hz, ",
        "configs/imu/good.yaml:4:19: base.imu.gyro.bandwidth: should be greater than 0, not '-60 Hz'",
    ),
    "a_time_constant_of_zero_is_refused": (
        "configs/imu/good.yaml",
        "accel: {",
        "accel: {instability_time: 0 s, ",
        "configs/imu/good.yaml:5:27: base.imu.accel.instability_time: should be greater than 0, not '0 s'",
    ),
    "a_negative_pause_is_refused": (
        "configs/vehicles/small.yaml",
        'specific_impulse: "330 s"',
        'specific_impulse: "330 s", ignition_delay: -5 s',
        "configs/vehicles/small.yaml:5:108: base.trajectory.vehicle.stages.1.ignition_delay: should be greater than or equal to 0, not '-5 s'",
    ),
    "a_negative_mass_is_refused": (
        "configs/vehicles/small.yaml",
        '"300 kg"',
        "-300 kg",
        "configs/vehicles/small.yaml:6:10: base.trajectory.vehicle.payload: should be greater than or equal to 0, not '-300 kg'",
    ),
    "a_stage_without_thrust_is_refused": (
        "configs/vehicles/small.yaml",
        '"600 kN"',
        "0 kN",
        "configs/vehicles/small.yaml:4:57: base.trajectory.vehicle.stages.0.thrust: should be greater than 0, not '0 kN'",
    ),
    "an_outage_of_negative_length_is_refused": (
        "campaign.yaml",
        "  imu: imu/good",
        "  imu: imu/good\n  faults: [{start: 100 s, duration: -5 s}]",
        "campaign.yaml:6:37: base.faults.0.duration: should be greater than or equal to 0, not '-5 s'",
    ),
    "a_ramp_that_ends_before_it_starts_is_refused": (
        "configs/imu/good.yaml",
        "gyro: {",
        "gyro: {temperature: {start: 10 s, end: 5 s, amplitude: [1 deg/h, 0, 0]}, ",
        "configs/imu/good.yaml:4:21: base.imu.gyro.temperature: the ramp's end should come after its start",
    ),
    "a_process_rate_that_does_not_divide_the_imu_rate_is_refused": (
        "configs/imu/good.yaml",
        'rate: "200 Hz"',
        'rate: "200 Hz"\nprocess_rate: 30 Hz',
        "configs/imu/good.yaml:4:15: base.imu.process_rate: 30 Hz does not divide the IMU rate of 200 Hz",
    ),
    "a_process_rate_above_the_imu_rate_is_refused": (
        "configs/imu/good.yaml",
        'rate: "200 Hz"',
        'rate: "200 Hz"\nprocess_rate: 400 Hz',
        "configs/imu/good.yaml:4:15: base.imu.process_rate: 400 Hz does not divide the IMU rate of 200 Hz",
    ),
    "an_unknown_metric_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\nrequirements: [{name: a, metric: velocity_eror_3d, probability: 0.9, below: 1 m/s}]",
        "campaign.yaml:3:34: requirements.0.metric: 'velocity_eror_3d' is not a metric (did you mean 'velocity_error_3d'?)",
    ),
    "a_bound_in_the_wrong_unit_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\nrequirements: [{name: a, metric: velocity_error_3d, probability: 0.9, below: 1 m}]",
        "campaign.yaml:3:78: requirements.0.below: '1 m' has the wrong unit; expected speed (m/s, km/s)",
    ),
    "a_bound_without_unit_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\nrequirements: [{name: a, metric: velocity_error_3d, probability: 0.9, below: 1}]",
        "campaign.yaml:3:78: requirements.0.below: 1 has no unit; write it with a unit, such as '0.3 m/s'",
    ),
    "a_probability_of_one_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\nrequirements: [{name: a, metric: velocity_error_3d, probability: 1, below: 1 m/s}]",
        "campaign.yaml:3:66: requirements.0.probability: should be less than 1, not 1",
    ),
    "a_metric_of_another_frame_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\nrequirements: [{name: a, metric: velocity_error_along, probability: 0.9, below: 1 m/s}]",
        "campaign.yaml:3:34: requirements.0.metric: 'velocity_error_along': frame ned has the axes north, east, down",
    ),
    "a_history_without_step_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\nkeep: {history: 0 s}",
        "campaign.yaml:3:17: keep.history: should be greater than 0, not '0 s'",
    ),
    "a_tab_is_refused": (
        "campaign.yaml",
        "  imu: imu/good",
        "\timu: imu/good",
        "campaign.yaml:5:1: a tab; YAML is indented with spaces",
    ),
    "a_bracket_that_is_not_closed_is_refused": (
        "campaign.yaml",
        "seed: 7",
        "axes: [1,",
        "campaign.yaml:4:13: is not YAML: expected ',' or ']', but got ':'",
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_a_mistake_is_told_in_one_line(study, what: str) -> None:
    file, old, new, message = BAD[what]
    study.edit(file, old, new)
    with pytest.raises(InputError) as caught:
        load(study.path.name)
    assert str(caught.value) == message


def test_what_may_point_either_way_keeps_its_sign(study) -> None:
    study.edit("configs/receivers/plain.yaml", "name: plain", "name: plain\nlever_b: [-1 m, 0, -2 m]\nmask: -5 deg")
    study.edit("configs/constellations/two.yaml", 'node: "60 deg"', "node: -60 deg")
    ramp = "temperature: {start: -30 s, end: 100 s, amplitude: [-1 deg/h, 0, 0]}"
    study.edit("configs/imu/good.yaml", "gyro: {", f"gyro: {{{ramp}, ")
    base = load("campaign.yaml").base
    assert base.receiver.lever_b == (-1.0, 0.0, -2.0)
    assert base.receiver.mask < 0.0
    assert base.constellation.slots[1].node < 0.0
    assert base.imu.gyro.temperature.amplitude[0] < 0.0
    assert base.trajectory.site.latitude < 0.0


def test_several_mistakes_are_told_together_each_in_its_line(study) -> None:
    study.edit("campaign.yaml", "seed: 7", "seed: seven")
    study.edit("campaign.yaml", "imu/good", "imu/goood")
    study.edit("configs/filters/near.yaml", "tight", "tigth")
    with pytest.raises(InputError) as caught:
        load("campaign.yaml")
    assert str(caught.value).splitlines() == [
        "campaign.yaml:2:7: seed: should be a valid integer, not 'seven'",
        "campaign.yaml:5:8: base.imu: no card 'imu/goood' (did you mean 'imu/good'?)",
        "configs/filters/near.yaml:3:7: base.filter.kind: 'tigth' is not one of inertial, loose, tight"
        " (did you mean 'tight'?)",
    ]


def test_a_mistake_is_also_data(study) -> None:
    study.edit("campaign.yaml", "seed: 7", "seed: seven")
    with pytest.raises(InputError) as caught:
        load("campaign.yaml")
    assert caught.value.records[0]._asdict() == {
        "message": "should be a valid integer, not 'seven'",
        "path": "seed",
        "file": "campaign.yaml",
        "line": 2,
        "column": 7,
    }


def test_a_campaign_that_is_not_there_is_told_with_the_nearest_name(study) -> None:
    with pytest.raises(InputError, match=r"^campain\.yaml: no such file \(did you mean 'campaign\.yaml'\?\)$"):
        load("campain.yaml")


def test_a_folder_is_no_campaign(study) -> None:
    with pytest.raises(InputError, match=r"^configs: is a folder, not a YAML file$"):
        load("configs")
