"""Lock of phase: what interrupts a carrier between two epochs, and how often it slips by chance."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.gnss.tracking import CycleSlipCard, draw_cycle_slips, is_continuous
from tests.building import loaded

NAMES, T = ("G01", "G02"), 0.1 * np.arange(31)
OWNER = np.concatenate([[0], np.repeat(np.arange(1, 4), 10)])  # three intervals of ten steps
HELD, ANTENNA, CN0 = np.ones((31, 2), bool), np.zeros((31, 2), int), np.full((31, 2), 40.0)


def test_a_carrier_goes_on_while_its_signal_is_held():
    found = is_continuous(None, NAMES, T, OWNER, HELD, ANTENNA, CN0)
    np.testing.assert_array_equal(found, [[False, False], [True, True], [True, True], [True, True]])


@pytest.mark.parametrize("step", [11, 15, 19])
def test_a_tenth_of_a_second_without_the_signal_ends_a_phase(step):
    held = HELD.copy()
    held[step, 1] = False
    found = is_continuous(None, NAMES, T, OWNER, held, ANTENNA, CN0)
    np.testing.assert_array_equal(found[1:], [[True, True], [True, False], [True, True]])


def test_another_antenna_has_another_phase():
    antenna = ANTENNA.copy()
    antenna[15:, 0] = 1
    found = is_continuous(None, NAMES, T, OWNER, HELD, antenna, CN0)
    np.testing.assert_array_equal(found[1:], [[True, True], [False, True], [True, True]])


def test_a_weak_signal_has_no_phase_though_its_range_is_measured():
    card, cn0 = CycleSlipCard(below="30 dB-Hz"), CN0.copy()
    cn0[22:25, 0] = 29.9
    found = is_continuous(card, NAMES, T, OWNER, HELD, ANTENNA, cn0)
    np.testing.assert_array_equal(found[1:], [[True, True], [True, True], [False, True]])
    text = loaded().receiver.model_dump(mode="json") | {"cycle_slips": {"below": "30 dB-Hz"}}
    with pytest.raises(ValueError, match="needs a link"):
        ReceiverCard.model_validate(text)


def test_slips_come_as_often_as_the_rate_says_and_by_satellite_and_realisation():
    t = np.arange(0.0, 20000.0, 1.0)
    found = draw_cycle_slips(CycleSlipCard(rate="36 1/h"), NAMES, t)
    expected = 0.01 * t[-1]
    assert np.all(np.abs(found.sum(axis=0) - expected) < 4.0 * np.sqrt(expected))
    assert np.sum(found[:, 0] & found[:, 1]) < 15  # two of independent ones in 1e4 steps
    other = draw_cycle_slips(CycleSlipCard(rate="36 1/h", realisation=1), NAMES, t)
    assert np.sum(found & other) < 30
    # whatever else there is: a satellite, a time
    np.testing.assert_array_equal(draw_cycle_slips(CycleSlipCard(rate="36 1/h"), NAMES[1:], t)[:, 0], found[:, 1])
