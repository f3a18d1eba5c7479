"""Sources of a case, and measurements with respect to the joint vector."""

from __future__ import annotations

import numpy as np

from lvnav_trade.covariance.sources import measurement_tables, n_joint, noise_sources, source_names
from lvnav_trade.simulation.epoch.joint import N_CLONE
from tests.building import INERTIAL, LOOSE, case

LATE = ("base.receiver.latency=0.3 s", "base.filter.delay_compensation={kind: buffered}")


def test_each_source_stands_once_and_an_unaided_filter_has_no_noise_of_measurements():
    for settings in ((), (LOOSE,), (INERTIAL,)):
        names = source_names(case(*settings))
        assert len(names) == len(set(names))
    assert not any(name.endswith("noise") for name in source_names(case(INERTIAL)))


def test_a_late_measurement_is_of_the_navigation_errors_of_its_clone():
    prepared_case = case(*LATE)
    n = prepared_case.layout.n_state
    assert n_joint(prepared_case) == n + N_CLONE
    table = measurement_tables(prepared_case, source_names(prepared_case))
    columns = table["column"][0, 0, : table["n_entry"][0]]
    assert set(columns.tolist()) <= {*range(n, n + 9), prepared_case.layout.clock}
    plain = measurement_tables(case(), source_names(case()))
    assert plain["column"].max() < n


def test_noise_of_a_channel_is_that_of_its_kind():
    names = source_names(case())
    found = noise_sources(case(), names)
    assert np.all(found[0::2] == names.index("pseudorange noise"))
    assert np.all(found[1::2] == names.index("range-rate noise"))
