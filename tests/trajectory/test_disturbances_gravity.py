"""A disturbance of gravity as a block of true parameters."""

from __future__ import annotations

import math

import pytest

from lvnav_trade.trajectory.disturbances import GRAVITY, NO_SENSOR, GravityCard, disturbance


def test_a_card_is_one_gauss_markov_block_of_its_own_kind():
    (block,) = disturbance(GravityCard(sigma="30 ug", time="15 s"))
    assert (block.sensor, block.driver, block.walk) == (NO_SENSOR, GRAVITY, 0.0)
    assert block.sigma == pytest.approx(30e-6 * 9.80665)
    assert block.time_constant == 15.0


def test_without_a_time_it_is_constant_and_without_a_size_there_is_none():
    (block,) = disturbance(GravityCard(sigma="30 ug", time=None))
    assert math.isinf(block.time_constant)
    assert disturbance(None) == disturbance(GravityCard(sigma="0 ug")) == ()
