"""What a campaign states for its readers is checked where it is written."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.definition.document import MarginPolicy, Window
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.errors import InputError


def test_margins_are_fractions_by_phase():
    found = MarginPolicy.model_validate({"phase": "PDR", "required": {"PDR": "20 %", "CDR": "10 %"}})
    assert found.required == {"PDR": pytest.approx(0.2), "CDR": pytest.approx(0.1)}


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"phase": "PDA", "required": {"PDR": "20 %"}}, "no margin for the phase 'PDA' .did you mean 'PDR'"),
        ({"phase": "PDR", "required": {"PDR": "100 %"}}, "PDR: a margin of 100 % leaves no error"),
        ({"phase": "PDR", "required": {}}, "at least 1"),
    ],
)
def test_a_policy_that_cannot_be_kept_is_refused(stated, message):
    with pytest.raises(ValueError, match=message):
        MarginPolicy.model_validate(stated)


def test_a_window_is_5_s_before_to_20_s_after_unless_stated():
    assert (Window().before, Window().after) == (5.0, 20.0)
    assert Window.model_validate({"after": "1 min"}).after == 60.0


def test_a_mistake_in_the_policy_is_at_its_line(study):
    study.append("margin_policy: {phase: CDR, required: {PDR: 20 %}}\n")
    with pytest.raises(InputError, match=r"campaign.yaml:\d+:\d+: margin_policy.required: no margin for the phase"):
        load(study.path)
