"""Cases find their partners, and what does not compare is refused in words."""

from __future__ import annotations

import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.comparison.matching import match, unmatched_case_notes
from tests.results.variants import relabelled, variant

FINE, COARSE = "aaaaaaaaaaaa", "bbbbbbbbbbbb"


def test_cases_of_equal_labels_belong_together(good):
    assert match(good, good) == [(FINE, FINE, "imu=fine"), (COARSE, COARSE, "imu=coarse")]
    assert unmatched_case_notes(good, good, match(good, good)) == []


def test_a_level_of_another_name_is_found_by_the_mapping(good, tmp_path):
    other = variant(good, tmp_path / "b", cases=relabelled(fine="finer"))
    pairs = match(good, other)
    assert [pair.base for pair in pairs] == [COARSE]
    reported = unmatched_case_notes(good, other, pairs)
    assert [line.partition(": ")[2] for line in reported] == ["imu=fine.", "imu=finer."]
    assert match(good, other, {"fine": "finer"})[0] == (FINE, FINE, "imu=fine → imu=finer")
    assert match(good, other, {"imu=fine": "imu=finer"})[0] == match(good, other, {FINE: FINE})[0]


def test_a_mapping_can_lead_from_one_case_to_another_of_the_same_campaign(good):
    assert match(good, good, {"fine": "coarse"}) == [
        (FINE, COARSE, "imu=fine → imu=coarse"),
        (COARSE, COARSE, "imu=coarse"),
    ]


def test_the_only_cases_belong_together_whatever_they_are_called(good, tmp_path):
    one = variant(good, tmp_path / "a", cases=lambda cases: cases[:1])
    other = variant(good, tmp_path / "b", cases=lambda cases: relabelled(fine="new")(cases[:1]))
    assert match(one, other) == [(FINE, FINE, "imu=fine → imu=new")]


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"campaign": lambda c: c | {"seed": 8}}, r"other seed \(.* drew with 7, .* with 8\)"),
        ({"cases": lambda t: t.assign(epoch="2026-08-02T12:00:00Z")}, "imu=fine: other trajectory .lift-off at"),
        ({"events": lambda t: t[t.event != "stage1_cutoff"]}, r"imu=fine: other events \(only one .* stage1_cutoff\)"),
        ({"events": lambda t: t.assign(t_s=t.t_s * 1.01)}, "other events .stage1_cutoff at 40 s and at 40.4 s"),
        ({"reference": lambda t: t.assign(altitude_m=t.altitude_m + 50.0)}, "other trajectory .50 m apart"),
        ({"cases": relabelled(fine="x", coarse="y")}, "no common case; .* has imu=fine; imu=coarse, .* imu=x; imu=y;"),
    ],
)
def test_what_does_not_compare_is_refused_in_words(good, tmp_path, changes, why):
    with pytest.raises(InputError, match=why):
        match(good, variant(good, tmp_path / "b", **changes))


def test_a_name_in_the_mapping_that_nothing_has_is_refused(good):
    with pytest.raises(InputError, match=r"no case or level 'fime' \(did you mean 'fine'\?\)"):
        match(good, good, {"fime": "coarse"})
    with pytest.raises(InputError, match=r"no case or level 'navigation'; it has imu=fine; imu=coarse"):
        match(good, good, {"fine": "navigation"})
