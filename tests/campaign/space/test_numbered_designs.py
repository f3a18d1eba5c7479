"""Designs by number: the scenarios that the rule makes, and those that are impossible."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.reading.written_cases import single_case
from lvnav_trade.campaign.space.numbered_designs import (
    BaseValue,
    DesignSpace,
    label_of,
    make_designs,
    number_in,
    number_of,
    reason_of,
)
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.units import parse


def test_a_design_has_the_values_of_its_point(campaign) -> None:
    designs = DesignSpace(campaign)
    assert len(designs) == 40
    for design in make_designs(designs.batch(range(40))):
        assert design.case is not None
        scenario = design.case.scenario
        bias = parse(design.levels["bias_repeatability"], "rad/s")
        assert float(np.max(scenario.imu.gyro.bias_repeatability)) == pytest.approx(bias, rel=1e-5)
        assert scenario.initial.heading == pytest.approx(parse(design.levels["heading"], "rad"), rel=1e-5)
        assert design.levels["filter"] == ("tight" if scenario.filter.tight else "loose")


def test_a_latin_hypercube_has_one_design_in_every_row(campaign) -> None:
    numbers = np.array([number_of(values[0])[0] for values in map(DesignSpace(campaign).values, range(40))])
    low, high = (parse(text, "rad/s") for text in ("0.01 deg/h", "10 deg/h"))
    rows = np.floor(40 * np.log(numbers / low) / np.log(high / low)).astype(int)
    assert sorted(rows) == list(range(40))


def test_the_same_design_has_the_same_digest_alone_and_in_any_part(campaign) -> None:
    designs = DesignSpace(campaign)
    together = [design.case.id for design in make_designs(designs.batch(range(10)))]  # type: ignore[union-attr]
    assert [designs.case(number).id for number in range(10)] == together
    assert [cases(single_case(campaign, designs.case(number)))[0].id for number in (0, 7)] == [together[0], together[7]]
    assert len(set(together)) == 10


def test_sections_that_designs_have_in_common_are_one_object(campaign) -> None:
    found = [design.case.scenario for design in make_designs(DesignSpace(campaign).batch(range(10)))]  # type: ignore[union-attr]
    assert len({id(one.receiver) for one in found}) == 1
    assert len({id(one.filter) for one in found}) == 2
    assert len({id(one.imu) for one in found}) == 10


def test_a_part_goes_to_another_process(campaign) -> None:
    part = DesignSpace(campaign).batch([1, 2])
    again = pickle.loads(pickle.dumps(part))
    assert [design.case.id for design in make_designs(again)] == [design.case.id for design in make_designs(part)]  # type: ignore[union-attr]


def test_impossible_designs_say_why_without_their_numbers(written) -> None:
    axis = "{path: filter, cards: [filters/loose, filters/tight]}"
    written.write_text(written.read_text().replace(axis, "{path: filter.update_rate, values: [1 Hz, 10 Hz]}"))
    found = list(make_designs(DesignSpace(load(written)).batch(range(40))))
    bad = [design for design in found if design.case is None]
    assert len(bad) == 20
    assert {design.reason for design in bad} == {"filter.update_rate: … Hz does not divide the receiver rate of … Hz"}
    assert {design.levels["update_rate"] for design in bad} == {"10 Hz"}


def test_a_base_that_is_impossible_is_a_mistake(written) -> None:
    fast = "filter: {card: filters/tight, update_rate: 10 Hz}"
    written.write_text(written.read_text().replace("filter: filters/tight", fast))
    with pytest.raises(InputError, match="10 Hz does not divide the receiver rate of 1 Hz"):
        load(written)


def test_cases_come_in_the_order_of_the_designs(campaign) -> None:
    designs = DesignSpace(campaign)
    assert [case.id for case in designs.cases()] == [designs.case(number).id for number in range(40)]


def test_a_design_is_called_by_its_number(campaign) -> None:
    assert DesignSpace(campaign).case(7).label == label_of(7) == "design 7"
    assert number_in("design 7") == 7
    for text in ("design", "design -7", "design 7a", "7", "designs 7"):
        assert number_in(text) is None


def test_a_value_is_a_number_a_quantity_or_neither() -> None:
    assert number_of("0.5 rad/s") == (0.5, "rad/s")
    assert number_of(3) == (3.0, "")
    assert number_of({"name": "card"}) is None
    assert number_of(True) is None
    assert number_of(BaseValue) is None


def test_reasons_are_alike_but_for_numbers() -> None:
    one, other = (reason_of(ValueError(f"rate {rate} Hz is above 10.5 Hz")) for rate in (11, 12.5))
    assert one == other == "ValueError: rate … Hz is above … Hz"
