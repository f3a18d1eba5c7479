"""One case of a campaign, by its digest or label."""

from __future__ import annotations

import pytest

from lvnav_trade.api import case_of
from lvnav_trade.quantities.errors import InputError


def test_a_case_is_found_by_digest_beginning_or_label() -> None:
    _, first = case_of("demo", (), None)
    for name in (first.id, first.id[:5], first.label):
        assert case_of("demo", (), name)[1].id == first.id


def test_one_of_many_designs_is_found_without_making_those_behind_it(tmp_path) -> None:
    text = """
name: many
seed: 1
base: {trajectory: trajectories/two_stage_leo, imu: imu/tactical_fog, constellation: constellations/gps_24,
  receiver: receivers/l1_two_metre, filter: filters/tight,
  initial: {tilt: "0.1 deg", heading: "0.05 deg", position: "1 m", velocity: "0.01 m/s"}}
design: sobol
samples: 64
store: metrics
axes: [{path: initial.heading, between: [0.01 deg, 1 deg]}]
"""
    path = tmp_path / "many.yaml"
    path.write_text(text)
    _, first = case_of(path, (), None)
    assert case_of(path, (), first.id[:6])[1].id == first.id
    assert case_of(path, (), first.label)[1].id == first.id
    with pytest.raises(InputError, match="no case 'abc' among 64 designs; give 6 digits"):
        case_of(path, (), "abc")
