"""What a campaign may state of a publication, and what it may not."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from lvnav_trade.campaign.definition.published_cards import PublishedNumber, event_of

NUMBER = {"source": "A paper", "metric": "velocity_error_3d", "value": 1.0, "unit": "m/s"}


def test_a_number_without_a_place_is_of_injection():
    found = PublishedNumber(**NUMBER)
    assert (found.at, found.during, found.statistic, found.band) == ("injection", None, "rms", (0.5, 2.0))


def test_a_number_of_a_phase_names_both_events_and_survives_being_written():
    found = PublishedNumber(**NUMBER, during="stage1_cutoff to stage1_cutoff + 30 s", statistic="worst")
    assert found.events == ("stage1_cutoff", "stage1_cutoff")
    assert PublishedNumber.model_validate(found.model_dump(mode="json")) == found
    assert PublishedNumber(**NUMBER, during="flight").events == ()
    assert PublishedNumber(**NUMBER, during="start to liftoff").events == ("liftoff",)
    assert event_of("injection - 5 s") == "injection"


@pytest.mark.parametrize(
    ("change", "reported"),
    [
        ({"metric": "velocity_eror_3d"}, "did you mean 'velocity_error_3d'"),
        ({"during": "liftoff until injection"}, "'liftoff until injection' is no phase"),
        ({"during": "liftoff to injection + 3"}, "has no unit"),
        ({"during": "flight", "at": "injection"}, "not both"),
        ({"statistic": "worst"}, "statistic worst needs a phase"),
        ({"statistic": "mean"}, "error of one axis"),
        ({"statistic": "mean", "metric": "perigee_error", "unit": "m"}, "error of one axis"),
        ({"statistic": "least", "during": "flight"}, "statistic least needs a metric that is counted"),
        ({"value": 0.0}, "0 has no ratio"),
        ({"band": (2.0, 0.5)}, "growing ratios"),
        ({"digit": 100.0}, "digit: 100 is larger than the number"),
        ({"against": {"filter": "loose"}}, "its unit is %"),
        ({"at": "7"}, "no instant"),
    ],
)
def test_a_statement_that_cannot_be_checked_is_refused(change, reported):
    with pytest.raises(ValidationError, match=reported):
        PublishedNumber(**NUMBER | change)
