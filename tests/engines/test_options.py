"""Parts of a flight that not every case has: what the cards make of them, and what cannot be had together."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.engines.options import direct, epoch_interval, every, refuse_contradiction, solver_of, solves
from lvnav_trade.errors import InputError
from lvnav_trade.filters.base import ReceiverBelief
from lvnav_trade.scenario import beliefs
from lvnav_trade.world.solutions import BancroftSolution, DirectSolution, FilteredSolution
from tests.building import loaded, with_fields

POINT = {"kind": "bancroft", "range_sigma": "2 m", "rate_sigma": "0.1 m/s"}
FILTERED = {**POINT, "kind": "filtered", "jerk": "1 m/s^3", "clock_noise": "0.1 m/s^2"}


def solving(solution, *settings):
    scenario = loaded("base.filter=filters/loose", *settings)
    card = {"bancroft": BancroftSolution, "filtered": FilteredSolution}[solution["kind"]].model_validate(solution)
    receiver = scenario.receiver.model_copy(update={"solution": card})
    return scenario.model_copy(update={"receiver": receiver, "faults": ()})


def test_only_a_loose_filter_takes_the_solution_of_a_receiver_that_solves():
    assert solves(solving(POINT))
    assert not solves(loaded("base.filter=filters/loose"))
    tight = solving(POINT, "base.filter=filters/tight")
    assert not solves(tight)
    assert direct(tight).position_sigma == 0.0  # nobody takes it
    assert isinstance(loaded().receiver.solution, DirectSolution)
    assert direct(loaded()) == loaded().receiver.solution
    assert solver_of(tight, beliefs(tight)[1], 12) is None


def test_a_solving_receiver_works_at_its_own_rate_and_the_filter_takes_every_nth():
    scenario = solving(FILTERED)
    fast = scenario.model_copy(update={"receiver": scenario.receiver.model_copy(update={"rate": 5.0})})
    assert (epoch_interval(fast), every(fast)) == (pytest.approx(0.2), 5)
    plain = loaded("base.filter=filters/loose")
    plain = plain.model_copy(update={"receiver": plain.receiver.model_copy(update={"rate": 5.0})})
    assert (epoch_interval(plain), every(plain)) == (1.0, 1)


def test_the_receiver_tells_its_own_covariance_unless_the_filter_has_numbers_of_its_own():
    scenario = solving({**POINT, "told": {"kind": "own", "factor": 10.0}})
    told = solver_of(scenario, beliefs(scenario)[1], 12).point.told
    assert (told.own, told.correlated, told.factor) == (True, True, 10.0)
    constant = solving({**FILTERED, "told": {"kind": "constant", "position_sigma": "3 m", "velocity_sigma": "1 m/s"}})
    told = solver_of(constant, beliefs(constant)[1], 12).filter.told
    assert (told.own, told.position_variance, told.velocity_variance) == (False, 9.0, 1.0)
    numbers = ReceiverBelief.model_validate({
        "pseudorange_sigma": "2 m", "range_rate_sigma": "0.1 m/s", "position_sigma": "5 m", "velocity_sigma": "0.5 m/s",
        "clock_h0": 0.0, "clock_h_minus2": 0.0,
    })  # fmt: skip
    stated = scenario.model_copy(update={"filter": scenario.filter.model_copy(update={"receiver": numbers})})
    told = solver_of(stated, numbers, 12).point.told
    assert (told.own, told.position_variance) == (False, 25.0)


def test_the_filter_of_the_receiver_steps_by_the_interval_of_its_epochs():
    scenario = solving(FILTERED)
    fast = scenario.model_copy(update={"receiver": scenario.receiver.model_copy(update={"rate": 2.0})})
    solver = solver_of(fast, beliefs(fast)[1], 12)
    assert solver.filter.interval == 0.5
    assert np.isinf(solver.point.limits[4])
    assert solver_of(solving(POINT), beliefs(scenario)[1], 12).filter is None


def test_what_a_filter_behind_a_solving_receiver_cannot_have_is_refused():
    scenario = solving(POINT)
    refuse_contradiction(scenario)
    refuse_contradiction(loaded())
    with_state = scenario.model_copy(update={"filter": with_fields(scenario.filter, extra_states=["position_bias"])})
    with pytest.raises(InputError, match="position_bias: a filter behind a solving receiver"):
        refuse_contradiction(with_state)
    unit_states = with_fields(scenario.filter, extra_states=["accel_scale_factor"])
    refuse_contradiction(scenario.model_copy(update={"filter": unit_states}))
