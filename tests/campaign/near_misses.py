# ruff: noqa: E501 - a message stands in one line, as the user sees it
"""Mistakes that are nearly right, and what is offered in their place; a table as that of `mistakes`."""

from __future__ import annotations

NEAR: dict[str, tuple[str, str, str, str]] = {
    "a_key_that_begins_another_is_taken_for_it": (
        "configs/filters/near.yaml",
        "kind: tight",
        "kind: tight\ndelay: {kind: buffered}",
        "configs/filters/near.yaml:4:1: base.filter.delay: unknown key (did you mean 'delay_compensation'?)",
    ),
    "a_key_that_is_like_no_other_is_told_those_that_are_known": (
        "campaign.yaml",
        "seed: 7",
        "seed: 7\nkeep: {everything: yes}",
        "campaign.yaml:3:8: keep.everything: unknown key (known: history)",
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
        "campaign.yaml:6:18: base.constellation: no card 'constellations/orion' (constellations/ has galileo_24, glonass_24, gps_24, gps_galileo, gps_galileo_glonass, two)",
    ),
    "a_rule_between_fields_is_told_at_the_field_that_breaks_it": (
        "configs/filters/near.yaml",
        "kind: tight",
        "kind: tight\ndelay_compensation: {kind: extrapolated}",
        "configs/filters/near.yaml:4:28: base.filter.delay_compensation.kind: only a solution can be extrapolated; a tight filter buffers",
    ),
}
