"""Slots of error components: a lane and a slot for each, sources of many components together."""

from __future__ import annotations

import numpy as np

from lvnav_trade.covariance.slots import Component, align, arrange_lanes, assign_lanes, slot_tables
from lvnav_trade.kernels.lanes import GROUP


def test_sources_of_many_components_share_a_group():
    group, lane, n_slot = assign_lanes([0, 3, 0, 9, 1] + [0] * 8)
    assert group[3] == group[1] == group[4] == 0
    assert n_slot.tolist() == [9, 0]
    assert len({(g, k) for g, k in zip(group.tolist(), lane.tolist(), strict=True)}) == 13


def test_a_value_of_a_source_is_in_its_lane_and_nowhere_else():
    count = [0, 2, 1]
    group, lane, _ = assign_lanes(count)
    found = arrange_lanes(np.array([[0.0], [5.0], [7.0]]), group, lane)
    assert found[group[1], 0, lane[1]] == 5.0
    assert found[group[2], 0, lane[2]] == 7.0
    assert found.sum() == 12.0
    assert found.shape[-1] == GROUP


def test_a_component_keeps_its_decay_noise_and_flags():
    first = Component(1, np.array([1.0, 0.9]), np.array([0.0, 0.2]), 4.0, states=(9, 11), has_cross=True)
    second = Component(1, np.ones(2), np.array([0.0, 0.3]), 9.0, drives_motion=True, has_echo=True)
    table = slot_tables([first, second], 2, 2)
    group, lane = table["group"][1], table["lane"][1]
    assert table["slot"].tolist() == [0, 1]
    assert (table["states"].tolist(), table["state_from"].tolist()) == ([9, 11], [0, 2, 2])
    assert table["initial_variance"].tolist() == [4.0, 9.0]
    assert table["component_decay"][1, group, 0, 0, lane] == 0.9
    assert table["noise"][1, group, :, 0, lane].tolist() == [0.2, 0.3]
    assert table["echo"][1, group, :, 0, lane].tolist() == [0.0, 0.3]
    assert table["has_cross"][group].tolist() == [True, False]
    assert table["drives_motion"][group].tolist() == [False, True]


def test_lanes_begin_at_cache_lines():
    values = np.arange(3.0 * GROUP).reshape(3, GROUP)
    found = align(values)
    np.testing.assert_array_equal(found, values)
    assert found.ctypes.data % 64 == 0
