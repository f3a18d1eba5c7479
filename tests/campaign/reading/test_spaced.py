"""Axes written as linspace, logspace, range and samples; nested choice, exclusion and constraints."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.campaign.reading.spaced import points
from lvnav_trade.quantities.errors import InputError


def loaded(study, text: str):
    study.append(text)
    return load(study.path)


def labels(study, text: str) -> list[str]:
    return [case.label for case in cases(loaded(study, text))]


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        ("{path: filter.gate, linspace: [3, 5, 5]}", ["3", "3.5", "4", "4.5", "5"]),
        ("{path: filter.gate, range: [3, 6, 1]}", ["3", "4", "5", "6"]),
        ("{path: filter.gate, range: [6, 3, -1.5]}", ["6", "4.5", "3"]),
        ("{path: initial.heading, logspace: [0.01 deg, 1 deg, 3]}", ["0.01 deg", "0.1 deg", "1 deg"]),
        ("{path: initial.heading, range: [1 mrad, 2 mrad, 0.5 mrad]}", ["1 mrad", "1.5 mrad", "2 mrad"]),
        ("{path: initial.heading, linspace: [1 mrad, 2 mrad, 2], labels: [a, b]}", ["a", "b"]),
    ],
)
def test_equally_spaced_levels_are_written_out_with_their_unit(study, axis: str, expected: list[str]) -> None:
    name = "gate" if "gate" in axis else "heading"
    assert labels(study, f"axes: [{axis}]\n") == [f"{name}={level}" for level in expected]


def test_what_is_spaced_reads_back_from_the_resolved_campaign(study, tmp_path) -> None:
    found = loaded(study, "axes: [{path: initial.heading, logspace: [0.01 deg, 1 deg, 3]}]\n")
    again = tmp_path / "again.yaml"
    again.write_text(resolved_text(found))
    assert [case.id for case in cases(load(again))] == [case.id for case in cases(found)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "axes: [{path: initial.heading, linspace: [1 deg, 2 mrad, 3]}]",
            "axes.0.linspace: begins and ends in different",
        ),
        ("axes: [{path: initial.heading, linspace: [1 deg, 2 deg]}]", "should be [first, last, count]"),
        ("axes: [{path: initial.heading, linspace: [1 deg, 2 deg, 1]}]", "1 is no count; a whole number from 2 to 500"),
        ("axes: [{path: initial.heading, logspace: [0 deg, 2 deg, 3]}]", "a logarithm needs ends above zero"),
        ("axes: [{path: initial.heading, range: [1 deg, 2 deg, 0.1]}]", "needs a step in the unit of its ends (deg)"),
        ("axes: [{path: initial.heading, range: [1 deg, 2 deg, -1 deg]}]", "a step that leads away"),
        ("axes: [{path: initial.heading, between: [1 deg, 2 deg]}]", "needs a sampled design: latin_hypercube, sobol"),
        ("axes: [{path: filter.gate, linspace: [1, 1e999, 3]}]", "axes.0.linspace: should begin and end with numbers"),
        (f"axes: [{{path: filter.gate, linspace: [1, {'9' * 400}, 3]}}]", "should begin and end with numbers that are"),
        ("axes: [{path: filter.gate, range: [1, 2, 1e-320]}]", "1000000001 values; from 2 to 500 are possible"),
        ("axes: [{path: filter.gate, linspace: [1, 2, 3], values: [4]}]", "an axis has either cards or values"),
        ("axes: [{path: filter.gate, between: [1, 2]}]\ndesign: sobol\nsamples: 6", "samples: 6 samples; Sobol's"),
        ("axes: [{path: filter.gate, between: [1, 2]}]\ndesign: latin_hypercube", "None is no count"),
        ("axes: [{path: filter.gate, between: [1, 2]}]\ndesign: box_behnken", "needs three axes or more"),
        ("axes: [{path: filter.gate, values: [4, 5]}]\nsamples: 8", "samples: no effect"),
    ],
)
def test_what_is_no_axis_is_refused_at_its_place(study, text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        loaded(study, f"{text}\n")
    assert message in str(caught.value)
    assert all(record.line > 0 for record in caught.value.records)


def test_samples_fill_the_limits_and_follow_the_seed(study) -> None:
    text = (
        "axes:\n  - {path: filter.gate, between: [3, 7]}\n"
        "  - {path: initial.heading, between: [0.01 deg, 1 deg], log: true}\n"
        "  - {path: imu, cards: [imu/good, imu/poor]}\ndesign: sobol\nsamples: 16\n"
    )
    found = loaded(study, text)
    gate, heading, imu = ([case.axes[name] for case in cases(found)] for name in ("gate", "heading", "imu"))
    unit = (np.array([float(one) for one in gate]) - 3.0) / 4.0
    tenths = np.log10([float(one.split()[0]) for one in heading]) / 2.0 + 1.0
    for part in (unit, tenths):  # each sixteenth of the way has one point: a net
        assert sorted(np.floor(16.0 * part)) == list(range(16))
    assert sorted(imu) == ["good"] * 8 + ["poor"] * 8
    assert [case.id for case in cases(load(study.path))] == [case.id for case in cases(found)]
    assert [case.axes for case in cases(load(study.path, ["seed=99"]))] != [case.axes for case in cases(found)]


def test_a_latin_hypercube_has_one_point_in_every_row_and_is_less_uneven_than_chance() -> None:
    found = points("latin_hypercube", 3, 20, 4)
    assert (np.sort(np.floor(20 * found), axis=0) == np.arange(20)[:, None]).all()
    assert qmc.discrepancy(points("sobol", 3, 64, 4)) < qmc.discrepancy(np.random.default_rng(4).random((64, 3)))


def test_box_and_behnken_have_pairs_at_their_ends_and_one_centre() -> None:
    found = points("box_behnken", 3, 0, 0)
    assert len(found) == 13
    assert sorted((found == 0.5).sum(axis=1)) == [1] * 12 + [3]
