"""True error components for the linear covariance: sources, what matches the filter's states, where they start."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.covariance.components import REMAINDER, build_components, initial_state
from lvnav_trade.covariance.sources import source_names
from lvnav_trade.kernels.lanes import GROUP
from lvnav_trade.kernels.transition import OWN_0
from tests.both_engines.modelled import modelled
from tests.building import INERTIAL, LOOSE, MATCHED, case, loaded, prepare_hop, with_fields
from tests.covariance.small import of_lanes


def model(prepared_case):
    return build_components(prepared_case)


def test_sources_are_physical_causes_each_named_once():
    names = source_names(case())
    assert len(set(names)) == len(names)
    assert "gyro misalignment" in names  # two blocks of parameters, one cause
    assert {"pseudorange noise", "range-rate noise", "receiver clock", "receiver clock start"} <= set(names)


def test_every_coupling_names_its_own_measurement_noise():
    loose, unaided = set(source_names(case(LOOSE))), set(source_names(case(INERTIAL)))
    assert {"position solution noise", "velocity solution noise"} <= loose
    assert "receiver clock" not in loose
    assert not any("noise" in name for name in unaided)


def test_true_parameters_match_the_filters_state_of_the_same_driver_or_none():
    true = model(case(MATCHED))
    assert set(true.filter_state) == {9, 12}
    assert (model(case()).filter_state == -1).any()


def place(true, source):
    """Return the place of a source in the order that `of_lanes` counts: group by group, lane by lane."""
    return int(true.group[source]) * GROUP + int(true.lane[source])


def table_of(true, name, block):
    """Return a table (n_length, n_group, n_slot, 1[, 8]) of a block's first component, (n_length,)."""
    component = true.first[block]
    source = int(true.source[component])
    at = (slice(None), true.group[source], true.slot[component], 0)
    return getattr(true, name)[*at, true.lane[source]]


def test_every_source_has_a_lane_of_its_own_and_those_of_many_components_stand_together():
    true = model(case())
    places = [place(true, source) for source in range(true.group.size)]
    assert sorted(places) == list(range(true.group.size))
    assert np.all(np.diff(true.n_slot) <= 0)
    slots = list(zip(true.source.tolist(), true.slot.tolist(), strict=True))
    assert len(set(slots)) == len(slots)


def test_the_estimate_starts_at_zero_so_error_and_component_are_the_same_thing():
    prepared_case = case(MATCHED)
    true = model(prepared_case)
    sources, cross, variance = initial_state(prepared_case, true)
    total = sum(of_lanes(sources, place(true, source)) for source in range(true.group.size))
    matched = np.flatnonzero(np.diff(true.state_from))
    assert matched.size >= 6
    for c in matched:
        source, slot, at = true.source[c], true.slot[c], true.states[true.state_from[c]]
        own = of_lanes(variance, place(true, source))[slot, 0]
        assert own == true.initial_variance[c]
        assert of_lanes(cross, place(true, source))[slot, at] == own
        assert total[at, at] >= own
    # a matched filter assumes just that
    np.testing.assert_allclose(np.diag(total), np.diag(prepared_case.initial_state.P), rtol=1e-12)


@pytest.mark.parametrize("seconds", [0.1, 0.05])
def test_a_true_process_keeps_its_variance_over_windows(seconds):
    scenario = loaded()
    imu = with_fields(scenario.imu, **{"gyro.bias_instability": "2 deg/h", "gyro.instability_time": "3 s"})
    card = with_fields(scenario.filter, covariance_rate=f"{1.0 / seconds} Hz")
    prepared_case = prepare_hop(scenario.model_copy(update={"imu": imu, "filter": card}))
    true, length = model(prepared_case), int(np.argmin(np.abs(prepared_case.lengths - seconds)))
    j = [b.name for b in prepared_case.sources].index("gyro bias instability")
    sigma2, factor = (2.0 * math.radians(1.0) / 3600.0) ** 2, table_of(true, "component_decay", j)[length]
    assert true.initial_variance[true.first[j]] == pytest.approx(sigma2, rel=1e-12)
    assert factor == pytest.approx(math.exp(-seconds / 3.0), rel=1e-12)
    assert factor**2 * sigma2 + table_of(true, "noise", j)[length] == pytest.approx(sigma2, rel=1e-12)


def test_what_quantisation_holds_back_is_drawn_anew_in_every_window():
    scenario = loaded()
    imu = with_fields(scenario.imu, **{"gyro.quantisation": "1e-5 rad"})
    prepared_case = prepare_hop(scenario.model_copy(update={"imu": imu}))
    true = model(prepared_case)
    j = int(np.flatnonzero(true.driver == REMAINDER)[0])
    moving = prepared_case.lengths > 0.0
    np.testing.assert_array_equal(table_of(true, "component_decay", j), np.where(moving, 0.0, 1.0))
    np.testing.assert_allclose(table_of(true, "noise", j)[moving], 1e-10 / 12.0, rtol=1e-12)
    np.testing.assert_array_equal(table_of(true, "echo", j), table_of(true, "noise", j))


def test_where_samples_are_measurements_what_no_state_stands_for_enters_them_and_not_the_motion():
    true = model(modelled(imu__gyro__scale_factor="300 ppm"))
    scale = int(np.flatnonzero((true.filter_state < 0) & (true.driver >= OWN_0))[0])
    assert true.has_sample_updates
    assert true.block_enters_samples[scale]
    assert not true.block_drives_motion[scale]
    assert not true.block_enters_samples[true.filter_state >= 0].any()
    other = model(case())
    assert other.block_drives_motion[other.filter_state < 0].all()
    assert not other.block_enters_samples.any()
