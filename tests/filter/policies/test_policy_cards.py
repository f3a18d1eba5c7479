"""The card of a mode logic."""

from __future__ import annotations

import pytest

from lvnav_trade.filter.policies.policy_cards import CHECKS, LogicCard


def test_all_and_none_of_the_checks_have_words_of_their_own():
    assert LogicCard(check_flags=True).check_flags == LogicCard().check_flags == CHECKS
    assert LogicCard(check_flags=False).check_flags == ()
    with pytest.raises(ValueError, match="check_flags"):
        LogicCard(check_flags=["crc"])
