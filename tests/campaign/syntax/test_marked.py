"""What a card marks as assumed or second hand: refused where it names no field, gone where an override replaces it."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.definition.case_digest import case_id
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables.versions import campaign_digest

MARKED = """\
name: marked
source: test
assumed: {rate: usual, gyro.random_walk: a guess, accel: typical of the class, gyro.rate_random_walk: none known}
second_hand: {gyro.bias_repeatability: "a manual, page 3"}
rate: "200 Hz"
gyro: {random_walk: "0.03 deg/sqrt(h)", bias_repeatability: "1 deg/h"}
accel: {random_walk: "0.05 mg/sqrt(Hz)", bias_repeatability: "2 mg"}
"""


@pytest.fixture
def marked(study):
    study.write("configs/imu/marked.yaml", MARKED)
    study.edit("campaign.yaml", "imu: imu/good", "imu: imu/marked")
    return study


def _marks(campaign, case: int = 0) -> tuple[dict[str, str], dict[str, str]]:
    imu = cases(campaign)[case].scenario.imu
    return dict(imu.assumed), dict(imu.second_hand)


def test_marks_come_into_every_case_and_the_resolved_campaign(marked) -> None:
    campaign = load(marked.path)
    assumed, second_hand = _marks(campaign)
    assert list(assumed) == ["rate", "gyro.random_walk", "accel", "gyro.rate_random_walk"]
    assert second_hand == {"gyro.bias_repeatability": "a manual, page 3"}
    marked.write("again.yaml", resolved_text(campaign))
    assert _marks(load(marked.folder / "again.yaml")) == (assumed, second_hand)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rate: usual", "correlation_time: usual", "'correlation_time' is not a field of the card (known: name, "),
        (
            "rate: usual",
            "gyro.random_wak: usual",
            "'random_wak' is not a field of the card (did you mean 'random_walk'?)",
        ),
        ("rate: usual", "rate.value: usual", "'value' is not a field of the card (known: none)"),
        ("rate: usual", "rate: ''", "a reason in words is missing"),
        ("rate: usual", "rate: 3", "a reason in words is missing"),
        ("rate: usual", "gyro.bias_repeatability: a guess", "marked as assumed and as second hand; leave one"),
        ("rate: usual", "assumed: a guess", "'assumed' is not a field of the card"),
        ("assumed: {", "assumed: [{", "should be reasons by dotted path of a field"),
    ],
)
def test_a_mark_on_what_is_no_field_of_the_card_is_refused_where_it_is_written(
    marked, old: str, new: str, message: str
) -> None:
    marked.edit("configs/imu/marked.yaml", old, new)
    if "[{" in new:
        marked.edit("configs/imu/marked.yaml", "none known}", "none known}]")
    with pytest.raises(InputError) as caught:
        load(marked.path)
    (record,) = caught.value.records
    assert message in record.message
    assert record.file.endswith("marked.yaml")
    assert record.line == 3
    assert record.path.startswith("base.imu.assumed")


@pytest.mark.parametrize(
    ("override", "gone"),
    [
        ("gyro: {random_walk: '1 deg/sqrt(h)'}", {"gyro.random_walk"}),
        ("gyro: {rate_random_walk: '1 deg/h/sqrt(h)'}", {"gyro.rate_random_walk"}),
        ("gyro: {bias_instability: '1 deg/h'}", set()),
        ("accel: {random_walk: '1 mg/sqrt(Hz)'}", set()),  # the rest of what is marked is the card's still
        ("accel: {random_walk: '1 mg/sqrt(Hz)', bias_repeatability: '1 mg'}", {"accel"}),
        ("rate: '400 Hz'", {"rate"}),
    ],
)
def test_an_override_takes_the_mark_of_what_it_replaces_with_it(marked, override: str, gone: set[str]) -> None:
    before, _ = _marks(load(marked.path))
    marked.edit("campaign.yaml", "imu: imu/marked", f"imu: {{card: imu/marked, {override}}}")
    assert set(before) - set(_marks(load(marked.path))[0]) == gone


def test_an_override_adds_marks_of_its_own(marked) -> None:
    own = "{card: imu/marked, gyro: {random_walk: '1 deg/sqrt(h)'}, assumed: {gyro.random_walk: ours}}"
    marked.edit("campaign.yaml", "imu: imu/marked", f"imu: {own}")
    assumed, _ = _marks(load(marked.path))
    assert assumed["gyro.random_walk"] == "ours"
    assert assumed["rate"] == "usual"


def test_an_assignment_and_an_axis_take_the_mark_with_them(marked) -> None:
    assumed, _ = _marks(load(marked.path, ["imu.gyro.random_walk=1 deg/sqrt(h)"]))
    assert "gyro.random_walk" not in assumed
    assert "rate" in assumed
    marked.append("axes: [{path: imu.gyro.bias_repeatability, values: ['1 deg/h', '2 deg/h']}]\n")
    marked.edit("campaign.yaml", "imu: imu/good", "imu: imu/marked")
    campaign = load(marked.path)
    assert [_marks(campaign, number)[1] for number in (0, 1)] == [{}, {}]
    assert _marks(campaign, 1)[0] == assumed | {"gyro.random_walk": "a guess"}


def test_marks_change_no_digest(marked) -> None:
    """Cases and campaign are those of the same numbers without marks: runs that are there already stay valid."""
    with_marks = load(marked.path)
    lines = [line for line in MARKED.splitlines(keepends=True) if not line.startswith(("assumed", "second_hand"))]
    marked.write("configs/imu/marked.yaml", "".join(lines))
    without = load(marked.path)
    assert without.base.imu.assumed == ()
    assert with_marks.base.imu.assumed != ()
    assert case_id(with_marks.base, 1, 1.0) == case_id(without.base, 1, 1.0)
    assert campaign_digest(resolved_text(with_marks)) == campaign_digest(resolved_text(without))
