"""Campaigns of many designs: rules with their mistakes, resolved files that keep the rule."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.definition.axes import cases, probes
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.campaign.space.numbered_designs import DesignSpace
from lvnav_trade.quantities.errors import InputError

SAMPLED = """design: latin_hypercube
samples: 600
axes:
  - {path: initial.heading, between: [0.01 deg, 1 deg], log: true}
  - {path: filter.gate, between: [3, 9]}
"""


def test_many_samples_store_metrics_unless_the_campaign_says_otherwise(study) -> None:
    study.append(SAMPLED)
    found = load(study.path)
    assert (found.store, found.is_space, len(DesignSpace(found))) == ("metrics", True, 600)
    few = load(study.path, ["samples=500"])
    assert (few.store, few.is_space, len(cases(few))) == (None, False, 500)
    assert load(study.path, ["samples=16", "store=metrics"]).is_space
    with pytest.raises(InputError, match="samples: 600 cases; at most 500 are stored whole: give `store: metrics`"):
        load(study.path, ["store=history"])
    with pytest.raises(InputError, match="1000000 is no count; a whole number from 2 to 500"):
        load(study.path, ["store=history", "samples=1000000"])


def test_the_resolved_campaign_has_the_rule_and_the_same_designs(study, tmp_path) -> None:
    study.append(SAMPLED)
    found, again = load(study.path), tmp_path / "again.yaml"
    text = resolved_text(found)
    assert text.count("0.01 deg") == 1
    again.write_text(text)
    read = load(again)
    assert read == found
    assert [DesignSpace(read).case(k).id for k in (0, 599)] == [DesignSpace(found).case(k).id for k in (0, 599)]


def test_the_ends_of_each_axis_alone_stand_for_all_designs(study) -> None:
    study.append(SAMPLED)
    assert [case.label for case in probes(load(study.path))] == [
        "base", "heading=0.01 deg", "heading=1 deg", "gate=3.0", "gate=9.0",
    ]  # fmt: skip


def test_a_large_grid_stores_metrics_with_its_exclusions(study) -> None:
    axes = (
        "axes:\n  - {path: initial.heading, linspace: [0.01 deg, 1 deg, 30]}\n"
        "  - {path: filter.gate, linspace: [3, 9, 20]}\n"
    )
    study.append(axes)
    assert len(DesignSpace(load(study.path))) == 600
    study.append(axes + 'exclude:\n  - {gate: "3"}\n')
    assert len(DesignSpace(load(study.path))) == 570
    study.append(axes + 'constraints: ["gate < 8.9"]\n')
    assert len(DesignSpace(load(study.path))) == 570


def test_constraints_of_samples_are_in_si(study) -> None:
    study.append(SAMPLED + 'constraints: ["heading < 0.001"]\n')
    designs = DesignSpace(load(study.path))
    assert 0 < len(designs) < 600
    assert max(float(designs.values(k)[0].split()[0]) for k in range(len(designs))) < 0.001


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("samples: 600", "samples: 200000"), "200000 is no count; a whole number from 2 to 100000"),
        (("samples: 600", "samples: true"), "no count"),
        (("[0.01 deg, 1 deg]", "[0.01 deg, 1 mrad]"), "axes.0.between: begins and ends in different units"),
        (("[0.01 deg, 1 deg]", "[0 deg, 1 deg]"), "axes.0.between: a logarithm needs ends above zero"),
        (("[0.01 deg, 1 deg]", "[0.01 kg, 1 kg]"), "wrong unit"),
        (("[0.01 deg, 1 deg]", "[0.01 deg]"), "should be [least, largest]"),
        (("initial.heading", "initial.headin"), "not a field of the base (did you mean"),
        (("latin_hypercube", "sobol"), "600 samples; Sobol's sequence is even for a power of two"),
        (("latin_hypercube\n", "zip\nstore: metrics\n"), "metrics: of the designs grid, latin_hypercube, sobol"),
    ],
)
def test_mistakes_in_a_rule_are_one_line_at_their_place(study, change, message) -> None:
    study.append(SAMPLED.replace(*change))
    with pytest.raises(InputError) as raised:
        load(study.path)
    assert message in str(raised.value)


def test_a_large_grid_that_is_to_be_stored_whole_is_told_what_stores_rows(study) -> None:
    study.append(
        "axes:\n  - {path: initial.heading, linspace: [0.01 deg, 1 deg, 30]}\n"
        "  - {path: filter.gate, linspace: [3, 9, 20]}\nstore: history\n"
    )
    with pytest.raises(InputError, match="axes: 600 cases; at most 500 are stored whole: give `store: metrics`"):
        load(study.path)


@pytest.mark.parametrize("store", ["metrics", "events"])
def test_rows_are_stored_with_few_samples_too_where_the_campaign_says_so(study, store) -> None:
    study.append(SAMPLED)
    found = load(study.path, ["samples=16", f"store={store}"])
    assert (found.store, found.is_space, len(DesignSpace(found))) == (store, True, 16)
    assert f"store: {store}" in resolved_text(found)


@pytest.mark.parametrize("axes", ["", "axes: []\n"])
@pytest.mark.parametrize("store", ["metrics", "events"])
def test_a_campaign_without_axes_has_no_designs_to_store(study, store, axes) -> None:
    line = len(study.path.read_text().splitlines()) + 1
    study.append(f"store: {store}\n{axes}")
    with pytest.raises(InputError, match=f":{line}:.* store: {store}: no effect: the campaign has no axes"):
        load(study.path)


def test_which_cases_have_runs_is_not_said_by_levels(study) -> None:
    study.append(SAMPLED + 'monte_carlo: {runs: 40, selected: {gate: "3"}}\n')
    with pytest.raises(InputError, match="of many designs `cases` says which have runs"):
        load(study.path)


@pytest.mark.parametrize("choice", ["cases: front", "most_cases: 3"])
def test_what_chooses_among_designs_is_refused_where_each_case_is_stored_whole(study, choice) -> None:
    text = SAMPLED.replace("600", "16") + f"monte_carlo: {{runs: 40, {choice}}}\n"
    study.append(text)
    line = len(study.path.read_text().splitlines())
    name = choice.partition(":")[0]
    with pytest.raises(InputError, match=f":{line}:.* monte_carlo.{name}: no effect: each case is stored whole"):
        load(study.path)
    assert load(study.path, ["store=metrics"]).monte_carlo is not None
