"""Preparation makes each record once, in stages; geometry of lines of sight stands in one module."""

from __future__ import annotations

import ast

PREPARE = "lvnav_trade.simulation.preparation.prepare"
IMPORTED = 30  # names: a stage stands for what it is made of
PARAMETERS = 8
# Records that a stage makes, and that nothing in preparation makes again with other fields.
MADE_ONCE = {
    "flight",
    "times",
    "filtering",
    "measurements",
    "signals",
    "true_signals",
    "assumed_noise",
    "schedule",
    "model",
    "prepared",
}
RECORDS = ("TrueFlight", "Times", "Schedule", "CaseFilter", "TrueSignals", "Signals", "Measurements", "PreparedCase")
OF_A_STATION = "lvnav_trade.sensors.ground_station"  # azimuth and elevation at a station on the ground


def _setup(modules):
    return [m for m in modules if m.name.startswith("lvnav_trade.simulation.preparation.")]


def test_prepare_imports_at_most_thirty_names(modules):
    (module,) = [m for m in modules if m.name == PREPARE]
    imports = [node for node in ast.walk(module.tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert 0 < sum(len(node.names) for node in imports) <= IMPORTED


def test_no_function_of_preparation_has_more_than_eight_parameters(modules):
    found = {}
    for module in _setup(modules):
        for function in module.functions():
            count = len([*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs])
            if count > PARAMETERS:
                found[f"{module.at(function)} {function.name}"] = count
    assert found == {}


def _remade(module):
    """Yield the calls that make a record of `MADE_ONCE` again with some of its fields replaced."""
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "_replace":
            value = node.func.value
            name = value.attr if isinstance(value, ast.Attribute) else getattr(value, "id", "")
            if name in MADE_ONCE:
                yield module.at(node)


def test_no_record_of_a_stage_is_made_again(modules):
    assert [at for module in _setup(modules) for at in _remade(module)] == []
    calls = [node.func.id for module in _setup(modules) for node in ast.walk(module.tree)
             if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]  # fmt: skip
    assert {name: calls.count(name) for name in RECORDS} == dict.fromkeys(RECORDS, 1)


def _lengths_of_lines(module):
    """Yield the calls that compute the length of a line of sight."""
    for node in ast.walk(module.tree):
        is_norm = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "norm"
        if is_norm and isinstance(node.args[0], ast.Name) and node.args[0].id == "line":
            yield module.at(node)


def test_geometry_of_lines_of_sight_stands_in_one_module(modules):
    found = {m.name for m in modules if list(_lengths_of_lines(m))}
    assert found == {"lvnav_trade.quantities.line_of_sight", OF_A_STATION}
