# ruff: noqa: E501 - a message stands in one line, as the user sees it
"""Mistakes that are nearly right, and what is offered in their place; a table as that of `mistakes`."""

from __future__ import annotations

from lvnav_trade.trajectory.ascent.dispersion_card import SOURCES

NEAR: dict[str, tuple[str, str, str, str]] = {
    "a_key_that_begins_another_is_taken_for_it": (
        "configs/filters/near.yaml",
        "measurements: [pseudorange, range_rate]",
        "measurements: [pseudorange, range_rate]\ndelay: {kind: buffered}",
        "configs/filters/near.yaml:4:1: base.filter.delay: unknown key (did you mean 'delay_compensation'?)",
    ),
    "a_key_that_is_like_no_other_is_told_those_that_are_known": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\nkeep: {everything: yes}",
        "campaign.yaml:3:8: keep.everything: unknown key (known: history, allan)",
    ),
    "a_kind_that_is_written_as_a_card_is_told_how_it_is_written": (
        "campaign.yaml",
        "  imu: imu/good",
        "  imu: imu/good\n  atmosphere: {troposphere: saastamoinen}",
        "campaign.yaml:6:29: base.atmosphere.troposphere: no card 'saastamoinen' (did you mean {kind: saastamoinen}?)",
    ),
    "a_card_that_is_like_no_other_is_told_those_of_its_folder": (
        "campaign.yaml",
        "constellations/two",
        "constellations/orion",
        "campaign.yaml:6:18: base.constellation: no card 'constellations/orion' (constellations/ has beidou_30, galileo_24, glonass_24, gps_24, gps_galileo, gps_galileo_glonass, gps_galileo_glonass_beidou, two)",
    ),
    "a_rule_between_fields_is_told_at_the_field_that_breaks_it": (
        "configs/filters/near.yaml",
        "measurements: [pseudorange, range_rate]",
        "measurements: [pseudorange, range_rate]\ndelay_compensation: {kind: extrapolated}",
        "configs/filters/near.yaml:4:28: base.filter.delay_compensation.kind: a solution's position is extrapolated by its velocity, and the filter does not take both of them; buffered compares whatever is late with the stored state",
    ),
    "a_measurement_that_stands_twice_is_refused": (
        "configs/filters/near.yaml",
        "measurements: [pseudorange, range_rate]",
        "measurements: [pseudorange, range_rate, pseudorange]",
        "configs/filters/near.yaml:3:15: base.filter.measurements: 'pseudorange' is listed twice",
    ),
    "a_solution_beside_its_ranges_is_refused_with_the_reason": (
        "configs/filters/near.yaml",
        "measurements: [pseudorange, range_rate]",
        "measurements: [position, pseudorange]",
        "configs/filters/near.yaml:3:15: base.filter.measurements: the receiver's solution is computed from the same ranges: information would be counted twice; take position and velocity, or pseudorange and range_rate",
    ),
    "a_measurement_without_a_sensor_is_refused": (
        "configs/filters/near.yaml",
        "measurements: [pseudorange, range_rate]",
        "measurements: [pseudorange, range_rate, altitude]",
        "configs/filters/near.yaml:3:15: base.filter.measurements: no sensor of the scenario measures altitude",
    ),
    "a_filter_kind_of_earlier_versions_says_its_measurements": (
        "configs/filters/near.yaml",
        "measurements: [pseudorange, range_rate]",
        "kind: tight",
        "configs/filters/near.yaml:3:7: base.filter.kind: replaced by measurements: [pseudorange, range_rate]",
    ),
    "a_model_of_an_altimeter_of_earlier_versions_says_its_new_key": (
        "configs/filters/near.yaml",
        "measurements: [pseudorange, range_rate]",
        "measurements: [pseudorange, range_rate]\naltimeter: {sigma: 1 m}",
        "configs/filters/near.yaml:4:12: base.filter.altimeter: replaced by sensor_models.altitude",
    ),
    "an_altimeter_of_earlier_versions_says_its_new_key": (
        "campaign.yaml",
        "  imu: imu/good",
        "  imu: imu/good\n  altimeter: altimeters/radar_004",
        "campaign.yaml:6:14: base.altimeter: replaced by sensors, such as sensors: {altimeter: CARD}; the filter lists altitude among its measurements",
    ),
    "a_name_that_no_sensor_can_have_is_refused": (
        "campaign.yaml",
        "  imu: imu/good",
        "  imu: imu/good\n  sensors: {radar-1: altimeters/radar_004}",
        "campaign.yaml:6:12: base.sensors: 'radar-1' cannot name a sensor; use letters, digits and '_'",
    ),
    "a_mistake_in_a_sensor_stands_where_it_was_written": (
        "campaign.yaml",
        "  imu: imu/good",
        "  imu: imu/good\n  sensors: {radar: {card: altimeters/radar_004, sigma: 1 s}}",
        "campaign.yaml:6:56: base.sensors.radar.sigma: '1 s' has the wrong unit; expected length (m, km, cm)",
    ),
    "a_rate_of_a_sensor_that_is_no_part_of_the_filters_is_refused": (
        "campaign.yaml",
        "  imu: imu/good",
        "  imu: imu/good\n  sensors: {radar: {card: altimeters/radar_004, rate: 3 Hz}}",
        "campaign.yaml:6:55: base.sensors.radar.rate: 3 Hz does not divide the update rate of 1 Hz",
    ),
    "an_unknown_key_of_a_trajectory_is_answered_with_those_of_the_trajectory": (
        "configs/trajectories/climb.yaml",
        "vehicle: vehicles/small",
        "vehicle: vehicles/small\npad_hol: 2 s",
        "configs/trajectories/climb.yaml:6:1: base.trajectory.pad_hol: unknown key (did you mean 'pad_hold'?)",
    ),
    "a_word_that_is_unknown_where_a_list_could_be_is_told_once": (
        "campaign.yaml",
        "trajectories/climb",
        "{card: trajectories/climb, dispersion: {draw: al}}",
        "campaign.yaml:4:61: base.trajectory.dispersion.draw: 'al' is not one of none, all (did you mean 'all'?)",
    ),
    "an_unknown_item_of_a_list_where_a_word_could_be_is_told_once": (
        "campaign.yaml",
        "trajectories/climb",
        "{card: trajectories/climb, dispersion: {draw: [thrust, wnd]}}",
        f"campaign.yaml:4:70: base.trajectory.dispersion.draw.1: 'wnd' is not one of {', '.join(SOURCES)} (did you mean 'wind'?)",
    ),
}
