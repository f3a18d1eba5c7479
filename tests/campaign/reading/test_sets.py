# ruff: noqa: E501 - a message stands in one line, as the user sees it
"""A word in the list of requirements is a set of them; what is wrong is reported where it can be mended."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.quantities.errors import InputError

SET = """\
    name: two bounds
    source: test
    requirements:
      - {name: speed, metric: velocity_error_3d, at: stage1_cutoff, probability: 0.9, below: 1 m/s}
      - {name: height, metric: position_error_down, during: flight, probability: 0.9, below: 9 m}
    """
PLAIN = "{name: own, metric: attitude_error_3d, probability: 0.9, below: 1 deg}"


@pytest.fixture
def asked(study):
    """Return a function that loads the study with these requirements."""
    study.write("configs/requirements/two.yaml", SET)

    def asked(*items: str):
        return load(study.append("requirements:\n" + "".join(f"  - {item}\n" for item in items)))

    return asked


def test_a_set_stands_among_requirements_of_ones_own(asked):
    found = asked("requirements/two", PLAIN).requirements
    assert [(r.name, r.at, r.during, r.events) for r in found] == [
        ("speed", "stage1_cutoff", None, ("stage1_cutoff",)),
        ("height", None, "flight", ()),
        ("own", "injection", None, ("injection",)),
    ]


def test_the_resolved_campaign_reads_back_to_the_same(asked, tmp_path):
    campaign = asked("requirements/two", PLAIN)
    (tmp_path / "again.yaml").write_text(resolved_text(campaign))
    assert load(tmp_path / "again.yaml") == campaign


def test_fields_beside_the_name_change_every_requirement_of_the_set(asked):
    found = asked("{card: requirements/two, confidence: 0.95, at: injection}").requirements
    assert [(r.confidence, r.at, r.during) for r in found] == [(0.95, "injection", None)] * 2
    found = asked("{card: requirements/two, during: liftoff to injection}").requirements
    assert [(r.at, r.during, r.events) for r in found] == [(None, "liftoff to injection", ("liftoff", "injection"))] * 2


def test_requirements_of_a_set_have_its_source_unless_they_state_their_own(asked, study):
    assert [one.source for one in asked("requirements/two").requirements] == ["test", "test"]
    study.edit("configs/requirements/two.yaml", "below: 1 m/s", "below: 1 m/s, source: section 2")
    assert [one.source for one in load(study.path).requirements] == ["section 2", "test"]


@pytest.mark.parametrize(
    ("items", "message"),
    [
        (["requirements/tow"], "campaign.yaml:11:5: requirements.0: no card 'requirements/tow' (did you mean 'requirements/two'?)"),
        (["imu/good"], "campaign.yaml:11:5: requirements.0: 'imu/good' is no set of requirements"),
        (["7"], "campaign.yaml:11:5: requirements.0: should be a requirement, or the name of a set of them"),
        (["{card: requirements/two, confidense: 0.9}"],
         "campaign.yaml:11:30: requirements.0.confidense: cannot be changed for a whole set (did you mean 'confidence'?)"),
        (["{card: requirements/two, name: x}"], "campaign.yaml:11:30: requirements.0.name: cannot be changed for a whole set"),
        ([PLAIN, "requirements/two", "{card: requirements/two, at: liftoff}"],
         "configs/requirements/two.yaml:4:12: requirements.3.name: 'speed' is used twice; give another name\n"
         "configs/requirements/two.yaml:5:12: requirements.4.name: 'height' is used twice; give another name"),
        ([PLAIN.replace("probability", "during: flight, at: liftoff, probability")],
         "campaign.yaml:11:64: requirements.0.at: a requirement holds at an event or during a phase, not both"),
        ([PLAIN.replace("probability", "during: liftoff, probability")],
         "campaign.yaml:11:52: requirements.0.during: 'liftoff' is no phase; write 'EVENT to EVENT' or flight"),
        ([PLAIN.replace("attitude_error_3d", "perigee_error, during: flight").replace("deg", "km")],
         "campaign.yaml:11:48: requirements.0.during: perigee_error is a number of the orbit at an event; give at in place of during"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_reported_in_one_line(asked, items, message):
    with pytest.raises(InputError) as caught:
        asked(*items)
    assert str(caught.value) == message


def test_a_mistake_in_a_set_is_reported_in_its_card(asked, study):
    study.edit("configs/requirements/two.yaml", "9 m", "9 kg")
    with pytest.raises(InputError) as caught:
        asked("requirements/two")
    assert str(caught.value).startswith("configs/requirements/two.yaml:5:")
    assert "'9 kg' has the wrong unit" in str(caught.value)


@pytest.mark.parametrize("name", ["ariane5_hybrid", "range_safety_tracking"])
def test_the_sets_that_come_with_the_tool_can_be_asked(asked, name):
    assert asked(f"requirements/{name}").requirements
