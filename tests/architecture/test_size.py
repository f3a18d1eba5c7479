"""Modules of at most 500 lines, functions of at most 80 and of at most eight parameters."""

from __future__ import annotations

import ast

MODULE_LINES = 500
FUNCTION_LINES = 80
REASON = "Long because"  # a longer function says so in its docstring, and why
PARAMETERS = 8  # outside `kernels`, where mathematics takes what it computes with


def test_no_module_is_longer_than_500_lines(modules, root):
    tests = [path.relative_to(root) for path in (root / "tests").rglob("*.py")]
    lengths = {path: len((root / path).read_text().splitlines()) for path in [*tests, *(m.path for m in modules)]}
    assert {str(path): n for path, n in lengths.items() if n > MODULE_LINES} == {}


def test_no_function_is_longer_than_80_lines_unless_its_docstring_says_why(modules):
    long = {}
    for module in modules:
        for function in module.functions():
            lines = function.end_lineno - function.lineno + 1
            if lines > FUNCTION_LINES and REASON not in (ast.get_docstring(function) or ""):
                long[f"{module.at(function)} {function.name}"] = lines
    assert long == {}


def test_no_function_outside_the_kernels_has_more_than_eight_parameters(modules):
    found = set()
    for module in modules:
        if module.path.parts[1] == "kernels":
            continue
        for function in module.functions():
            given = function.args
            if len(given.posonlyargs) + len(given.args) + len(given.kwonlyargs) > PARAMETERS:
                found.add(f"{module.path} {function.name}")
    assert found == set()
