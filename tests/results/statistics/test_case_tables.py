"""A case of results as metrics read it."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.statistics.case_tables import CaseTables
from tests import synthetic


@pytest.fixture
def case(good):
    return CaseTables(good, "aaaaaaaaaaaa")


def test_units_axes_and_events_are_those_of_the_tables(case):
    assert case.output("velocity", "3d")[2:] == ("m/s", "m/s", 1.0)
    assert case.output("gyro_bias", "x") is None
    assert case.axes("velocity") == ["north", "east", "down"]
    assert case.events() == synthetic.EVENTS


def test_errors_of_a_failed_run_are_infinite_sizes(case):
    errors, failed = case.errors("injection", "velocity"), case.has_failed("injection")
    assert np.flatnonzero(failed).tolist() == np.flatnonzero(case.failed_runs()).tolist() == [3]
    size = case.sizes("injection", "velocity", "3d")
    np.testing.assert_allclose(size[~failed], np.linalg.norm(errors[~failed], axis=1), rtol=1e-9)
    assert np.isinf(size[3])
    assert case.sizes("touchdown", "velocity", "3d").size == 0


def test_the_largest_of_a_phase_is_no_smaller_than_at_its_end(case):
    largest = case.largest("velocity", "3d", *case.phase("liftoff to injection"))
    assert (largest >= case.sizes("injection", "velocity", "3d") * (1.0 - 1e-12)).all()
    assert case.largest("velocity", "3d", 1.0, 2.0).size == 0
