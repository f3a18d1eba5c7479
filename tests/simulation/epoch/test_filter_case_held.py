"""What is held of a receiver's solution until the next one."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.simulation.epoch.filter_case import _store_covariance

N, AT = 3, 2


class Part(NamedTuple):
    """Arrays of results: held by source, and of the mean."""

    solution_covariance: np.ndarray
    solution_mean: np.ndarray


class State(NamedTuple):
    """Arrays of the joint covariance."""

    sources: np.ndarray
    mean: np.ndarray


class Truth(NamedTuple):
    """Where the solution's error stands, and the lanes of the sources."""

    solution: int
    group: np.ndarray
    lane: np.ndarray


class Joint(NamedTuple):
    """As much of a pass as is held."""

    results: Any
    state: Any
    components: Any


def test_the_last_solution_is_held_where_there_is_no_new_one():
    rng = np.random.default_rng(1)
    sources, mean = rng.standard_normal((1, AT + N, AT + N, 8)), rng.standard_normal(AT + N)
    out = Part(np.zeros((2, N, N)), np.zeros(N))
    joint = Joint(out, State(sources.copy(), mean.copy()), Truth(AT, np.zeros(2, dtype=np.int64), np.array([0, 5])))
    solved = np.array([True, False])
    _store_covariance(joint, solved, 0)
    joint.state.sources[:], joint.state.mean[:] = 0.0, 0.0
    _store_covariance(joint, solved, 1)
    for source, lane in enumerate((0, 5)):
        np.testing.assert_array_equal(out.solution_covariance[source], sources[0, AT:, AT:, lane])
    np.testing.assert_array_equal(out.solution_mean, mean[AT:])
