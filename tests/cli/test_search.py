"""The verbs that search: what they refuse."""

from __future__ import annotations

from tests.cli.calling import call


def test_the_verbs_say_what_a_campaign_lacks_and_what_is_no_range() -> None:
    for verb, message in (("solve", "--vary PATH=LEAST:LARGEST"), ("indices", "block indices"), ("tune", "block tune")):
        result = call(verb, "campaigns/smoke.yaml")
        assert (result.exit_code, message in result.stderr) == (2, True)
    wrong = call("solve", "campaigns/smoke.yaml", "--vary", "initial.heading=1 deg")
    assert "should be PATH=LEAST:LARGEST" in wrong.stderr


def test_a_preference_that_is_none_is_refused_before_anything_is_flown() -> None:
    wrong = call("run", "campaigns/smoke.yaml", "--prefer", "mas")
    assert (wrong.exit_code, "did you mean 'mass'" in wrong.stderr) == (2, True)
