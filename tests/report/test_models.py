"""The register of evidence is true: its tests exist, nothing is missing in it, and the report says what is in it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.campaign.syntax import fields
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.imu.error_model import AccelCard, GyroCard
from lvnav_trade.report import build, models
from lvnav_trade.report.build import make, markdown_page
from lvnav_trade.results.tables.read import load as results_of
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.family import SENSORS, card_kind
from tests import synthetic
from tests.both_engines.combinations import scenario_of
from tests.both_engines.covering import covering, refusal
from tests.building import loaded, with_fields

ROOT = Path(__file__).parents[2]
REGISTRY = models.registry()
ENTRIES = {entry["name"]: entry for entry in REGISTRY["model"]}
CHECKS = [(name, check) for name, entry in ENTRIES.items() for check in entry["checks"]]
CONDITIONS = {**{name: entry["used"] for name, entry in ENTRIES.items()}, **REGISTRY["where"]}


def sets_of(conditions: Any) -> list[dict[str, Any]]:
    return [conditions] if isinstance(conditions, dict) else list(conditions)


def listed(path: str) -> set[Any]:
    """Return the values that entries name at a path."""
    found = [one[path] for entry in ENTRIES.values() for one in sets_of(entry["used"]) if path in one]
    return {value for wanted in found for value in (wanted if isinstance(wanted, list) else [wanted])}


# -------------------------------------------------------------------------------------------------- it is well formed


@cache
def functions(file: str) -> set[str]:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize(("name", "check"), CHECKS, ids=[f"{name}-{k}" for k, (name, _) in enumerate(CHECKS)])
def test_the_test_of_a_check_exists(name, check):
    file, _, function = check["test"].partition("::")
    assert function.startswith("test_")
    assert function in functions(file)
    assert set(check) == {"by", "shown", "test"}
    assert check["by"] in REGISTRY["sorts"]


def test_every_entry_says_what_it_leaves_out_and_stands_once():
    assert len(ENTRIES) == len(REGISTRY["model"])
    for entry in ENTRIES.values():
        assert set(entry) - {"where"} == {"name", "used", "checks", "omits"}
        assert entry["omits"].endswith(".")
    assert set(REGISTRY["sorts"]) == {check["by"] for _, check in CHECKS}
    assert {entry["where"] for entry in ENTRIES.values() if "where" in entry} == set(REGISTRY["where"])


def kinds_at(kind: Any, path: str) -> list[Any]:
    """Return the annotations at a path of the scenario; `*` is every item, entry or field."""
    if not path:
        return [kind]
    key, _, rest = path.partition(".")
    inside = fields.entries(kind) or fields.item(kind, 0)
    if inside is not None and key != "*":
        return []
    of_models = [by for model in fields.models(kind) for by in [fields.fields_by_key(model)]]
    below = [inside] if inside is not None else []
    if inside is None or key == "*":
        below += [info.annotation for by in of_models for name, info in by.items() if key in ("*", name)]
    return [found for one in below for found in kinds_at(one, rest)]


def words_of(kind: Any) -> set[Any]:
    inside = fields.item(kind, 0)
    return set(fields.literals(kind)) | (set(fields.literals(inside)) if inside is not None else set())


@pytest.mark.parametrize("name", CONDITIONS)
def test_paths_and_values_of_a_condition_are_those_of_a_scenario(name):
    for one in sets_of(CONDITIONS[name]):
        for path, wanted in one.items():
            found = kinds_at(Scenario, path)
            assert found, path
            if not isinstance(wanted, bool):
                known = {word for kind in found for word in words_of(kind)}
                assert set(wanted if isinstance(wanted, list) else [wanted]) <= known, path


# ------------------------------------------------------------------------------------------------- nothing is missing


def families(model: Any, path: str = "", seen: set[Any] | None = None) -> dict[str, set[str]]:
    """Return the words of `kind` of every family of settings, by path."""
    seen = set() if seen is None else seen
    if model in seen:
        return {}
    seen.add(model)
    found: dict[str, set[str]] = {}
    for key, info in fields.fields_by_key(model).items():
        inside = fields.entries(info.annotation) or fields.item(info.annotation, 0)
        held, here = (info.annotation, f"{path}{key}.") if inside is None else (inside, f"{path}{key}.*.")
        members = fields.models(held)
        if len(set(fields.tags(held))) > 1:
            found[f"{here}kind"] = set(fields.tags(held))
        for member in members:
            found |= families(member, here, seen)
    return found


FAMILIES = families(Scenario)


def test_the_families_are_found():
    assert {"trajectory.kind", "constellation.kind", "sensors.*.kind", "faults.*.kind"} <= set(FAMILIES)
    assert {"receiver.solution.kind", "atmosphere.troposphere.kind"} <= set(FAMILIES)
    assert FAMILIES["sensors.*.kind"] == {card_kind(card) for card in SENSORS}
    assert len(FAMILIES["faults.*.kind"]) == 19


@pytest.mark.parametrize("path", FAMILIES)
def test_every_member_of_a_family_has_an_entry(path):
    assert FAMILIES[path] == listed(path)


def test_every_measurement_has_an_entry():
    (kind,) = kinds_at(Scenario, "filter.measurements")
    assert words_of(kind) <= listed("filter.measurements")


PLAIN = {
    # names; rates and sizes of what other entries are about; what a filter assumes of it
    Scenario: {"filter", "receiver", "imu", "sensors", "faults", "atmosphere", "frame", "diverged"},
    FilterCard: {"name", "source", "assumed", "second_hand", "covariance_rate", "update_rate", "imu", "receiver",
                 "initial", "sensor_models", "envelope", "corrections", "report_imu_samples", "strapdown", "iterations",
                 "reference_satellite", "delayed_state", "previous_noise"},
    ReceiverCard: {"name", "source", "assumed", "second_hand", "rate", "multipath_time",
                   "range_rate_instability_time", "channels", "pseudorange_sigma", "range_rate_sigma",
                   "carrier_phase_sigma", "carrier_ambiguity", "clock", "resources"},
    GyroCard: {"instability_time"},
    AccelCard: {"instability_time"},
}  # fmt: skip
PLACES = {
    Scenario: ("",), FilterCard: ("filter.",), ReceiverCard: ("receiver.",),
    GyroCard: ("imu.*.", "imu.units.*.*."), AccelCard: ("imu.*.", "imu.units.*.*."),
}  # fmt: skip


@pytest.mark.parametrize("card", PLAIN)
def test_every_field_of_the_main_cards_has_an_entry_or_is_plain(card):
    for place in PLACES[card]:
        named = {key for key in fields.fields_by_key(card) if listed(f"{place}{key}") or listed(f"{place}{key}.kind")}
        assert set(fields.fields_by_key(card)) - named == PLAIN[card], place


# ------------------------------------------------------------------------------------------------ entries are in use


PATCH = {"name": "patch", "pattern": {"kind": "table", "angle": ["0 deg", "90 deg"], "gain": ["3 dBi", "-3 dBi"]}}
PORT = {"kind": "barometer", "name": "port", "source": "test", "sigma": "20 Pa", "highest": "20 km"}
OF_TESTS = (
    # tests of the sky, of delays, of cards and of linear covariance fly these; no campaign that is shipped does
    {
        "faults": [
            {"kind": "clock_drift", "rate": "1 m/s", "start": "9 s", "duration": "9 s"},
            {"kind": "spoofing", "velocity": ["1 m/s", "0 m/s", "0 m/s"], "start": "9 s", "duration": "9 s"},
            {"kind": "jamming", "power": "1 dBW", "latitude": "1 deg", "longitude": "1 deg", "from": "9 s"},
            {"kind": "gyro_scale_factor_step", "size": ["1 %", "1 %", "1 %"], "from": "9 s"},
            {"kind": "dead_axis", "sensor": "gyro", "axis": 1, "from": "9 s"},
        ]
    },
    {"constellation": {"kind": "almanac", "almanac": "current.alm"}},
    {"constellation": {"kind": "rinex", "rinex": "brdc.nav"}},
    {"constellation": {"kind": "sp3", "sp3": "orbits.sp3"}},
    {"receiver.antennas": [PATCH]},
    {"filter.measurements": ["pseudorange", "carrier_phase"], "receiver.cycle_slips": {"rate": "2 1/h"}},
    {
        "filter.measurements": ["pseudorange", "tdcp"],
        "faults": [{"kind": "cycle_slip", "size": 1.0, "start": "9 s"}],
    },
    {"receiver.noise_by": [{"altitude": ["0 km", "9 km"], "factor": [1.0, 2.0]}], "receiver.frequencies": "L1_L5"},
    {"receiver.range_rate_offset": "0.1 m/s", "filter.clock": "differenced", "filter.reference_satellite": "G01"},
    {"filter.clock": "one_state", "filter.measurements": ["pseudorange"]},
    {"receiver.solution": {"kind": "bancroft", "range_sigma": "1 m", "rate_sigma": "0.1 m/s", "smoothing": {}}},
    {"atmosphere": {"troposphere": {"kind": "ray_traced", "profile": {"kind": "bean_thayer"}}}},
    {"atmosphere": {"troposphere": {"kind": "ray_traced", "profile": {"kind": "exponential"}}}},
    {"atmosphere": {"ionosphere": {"kind": "epstein"}}},
    {"sensors": {"port": PORT}, "filter.measurements": ["pseudorange", "pressure_altitude"]},
    {"atmosphere": {"troposphere": {"kind": "spilker"}}, "filter.as_noise": ["troposphere_scale"]},
    {
        "filter.underweighting": [{"beta": 0.2}],
        "filter.fading_memory": "60 s",
        "filter.transition_rate": "1 Hz",
        "filter.region_noise": [{"force_change": "5 m/s^2", "velocity": "1 m/s"}],
        "filter.feedback": "direct",
        "filter.integrity": {},
        "filter.backup": True,
    },
    {
        "imu.gyro.quantisation": "1e-6 rad",
        "filter.update": "joseph",
        "filter.gate": 4.0,
        "filter.gravity": "j2",
        "filter.mechanisation": "earth",
        "filter.strapdown.algorithm": "summed",
        "imu.gyro.instability_fit": {"processes": 2},
    },
)


def scenarios() -> Iterator[Any]:
    """Yield scenarios of the tests, of the shipped campaigns, and of the combination matrix, which has most."""
    for changes in OF_TESTS:
        yield with_fields(loaded(), **changes)
    for path in sorted((ROOT / "campaigns").rglob("*.yaml")):
        if path.name != "study.yaml" and not {"configs", "statements"} & set(path.parts):
            campaign = load(path)
            few = campaign if campaign.samples is None else load(path, ["samples=20"])  # of 10,000 designs
            for case in cases(few):
                yield case.scenario
    for case in covering():
        if not refusal(case):
            yield scenario_of(case)[0]


@cache
def used() -> frozenset[str]:
    """Return the names of the entries that a scenario uses; stops when all are used."""
    names: set[str] = set()
    for scenario in scenarios():
        data = scenario.model_dump(mode="json")
        names |= {name for name in ENTRIES.keys() - names if models.is_used(ENTRIES[name], data)}
        if len(names) == len(ENTRIES):
            break
    return frozenset(names)


@pytest.mark.parametrize("name", ENTRIES)
def test_an_entry_is_used_by_a_shipped_campaign_or_a_scenario_of_the_tests(name):
    assert name in used()


# ------------------------------------------------------------------------------------------------------- on the page


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    axes = "axes=[{path: imu, cards: [imu/tactical_fog, imu/navigation_matched], labels: [fine, coarse]}]"
    campaign = load("campaigns/smoke.yaml", [axes, "faults=[{kind: clock_jump, start: 10 s, size: 3 m}]"])
    folder = tmp_path_factory.mktemp("models") / "results"
    return build(synthetic.results(folder, n_run=40, campaign=resolved_text(campaign)))


def test_the_page_has_a_row_for_each_model_in_use_and_for_no_other(page):
    text = markdown_page(*make(results_of(page.parent), ["models"])[:3])
    rows = {line.split("|")[1].strip() for line in text.splitlines() if line.startswith("| ")}
    found = list(models.scenarios(results_of(page.parent)).values())
    used = {name for name, entry in ENTRIES.items() if any(models.is_used(entry, one) for one in found)}
    assert rows - {"model", "---"} == used
    assert {"Strapdown", "Pseudorange and range rate", "Fault: jump of the receiver's clock", "No troposphere"} <= used
    assert not used & {"Star tracker", "Stored gains", "Several inertial units", "Solution: stated noise"}


def test_the_csv_table_has_every_check_with_its_test(page):
    frame = pd.read_csv(page.parent / "models.csv", keep_default_na=False)
    strapdown = frame[frame.model == "Strapdown"]
    assert list(strapdown.test) == [check["test"] for check in ENTRIES["Strapdown"]["checks"]]
    assert set(frame[frame.model == "IMU: g-sensitivity"].cases) == {"imu=fine"}
    assert set(strapdown.cases) == {"all"}


def test_a_model_that_nothing_checks_is_said_so(page, monkeypatch):
    entry = {"name": "Phlogiston", "used": {}, "checks": [], "omits": "Everything."}
    monkeypatch.setattr(models, "registry", lambda: {**REGISTRY, "model": [entry]})
    (_, table) = models.models(results_of(page.parent))
    assert table.rows == (("Phlogiston", "Nothing independent.", "Everything."),)


@pytest.mark.parametrize(
    ("value", "wanted"),
    [("0.0 rad", False), ("0.1 deg", True), (["0.0 m", "0.0 m"], False), (["0.0 m", "1.0 m"], True), (None, False),
     ({}, False), ("stage1_cutoff", True), (0, False), (3, True), (False, False), ({"sigma": "0 m"}, True)],
)  # fmt: skip
def test_true_stands_for_anything_but_nothing_zero_empty_and_false(value, wanted):
    entry = {"used": {"field": True}}
    assert models.is_used(entry, {"field": value}) is wanted
    assert models.is_used({"used": {"field": False}}, {"field": value}) is not wanted
