"""What runs a campaign and what evaluates many designs fit together."""

from __future__ import annotations

import inspect

import pytest

from lvnav_trade.campaign.running import conduct
from lvnav_trade.campaign.space import stage


@pytest.mark.parametrize("name", ["evaluate", "finish", "names"])
def test_the_designs_of_a_space_are_called_as_the_protocol_says(name: str) -> None:
    required, offered = (inspect.signature(getattr(one, name)) for one in (conduct.DesignStage, stage.SpaceEvaluation))
    assert list(offered.parameters) == list(required.parameters)
    assert [one.default for one in offered.parameters.values()] == [one.default for one in required.parameters.values()]


def test_a_campaign_is_resumed_whole_unless_told_otherwise() -> None:
    assert conduct.RunOptions().mode == "resume"
    assert conduct.Scope() == (None, (), None)
