"""What is public has a docstring; a module's first line is its caption; a record describes its fields line by line."""

from __future__ import annotations

import ast
import re

import pytest

FEW = 8
"""Largest number of fields of a record that may be described in one paragraph."""


def _public(tree: ast.Module):
    """Yield public functions and classes of a module, and public methods of public classes."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node
            if isinstance(node, ast.ClassDef):
                yield from (item for item in _public(node) if isinstance(item, ast.FunctionDef))


def test_every_public_function_and_class_has_a_docstring(modules):
    bare = [
        f"{module.at(node)} {node.name}"
        for module in modules
        for node in _public(module.tree)
        if not ast.get_docstring(node)
    ]
    assert bare == []


def test_every_module_begins_with_a_caption(modules):
    wrong = {}
    for module in modules:
        first, _, rest = (ast.get_docstring(module.tree) or "").partition("\n")
        one_sentence_alone = first.endswith(".") and (not rest or rest.startswith("\n"))
        if not one_sentence_alone:
            wrong[str(module.path)] = first
    assert wrong == {}


def _fields(node: ast.ClassDef) -> list[ast.AnnAssign]:
    """Return the fields of a record or card, but for constants of the class and the word that says which card it is."""
    found = [item for item in node.body if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)]
    return [x for x in found if "ClassVar" not in ast.unparse(x.annotation) and ast.unparse(x.target) != "kind"]


def undescribed(node: ast.ClassDef, text: str) -> list[str]:
    """Return the fields that have no line of their own: `name : meaning` in the docstring, a comment, or for a card the
    description that the command `fields` prints.
    """
    lines = text.splitlines()
    listed = re.findall(r"^(\w+) : \S", ast.get_docstring(node) or "", re.MULTILINE)
    found = []
    for field in _fields(node):
        name = ast.unparse(field.target)
        own = ["  # " in lines[field.end_lineno - 1], lines[field.lineno - 2].lstrip().startswith("# ")]
        own += [isinstance(part, ast.keyword) and part.arg == "description" for part in ast.walk(field)]
        if listed.count(name) != 1 and not any(own):
            found.append(name)
    return found


def test_records_of_more_than_eight_fields_describe_one_field_per_line(modules):
    missing, seen = {}, 0
    for module in modules:
        for node in ast.walk(module.tree):
            if isinstance(node, ast.ClassDef) and len(_fields(node)) > FEW:
                seen += 1
                if names := undescribed(node, module.text):
                    missing[f"{module.at(node)} {node.name}"] = names
    assert seen > 80  # the check finds the records
    assert missing == {}


def _described_tuples(tree: ast.Module) -> dict[str, tuple[list[str], str]]:
    """Return the fields of every call of `namedtuple` that is assigned to a name, and the text below it."""
    found = {}
    for item, below in zip(tree.body, [*tree.body[1:], ast.Pass()], strict=True):
        if isinstance(item, ast.Assign) and isinstance(item.value, ast.Call):
            call = item.value
            if ast.unparse(call.func).split(".")[-1] == "namedtuple" and isinstance(call.args[1], ast.Constant):
                value = below.value if isinstance(below, ast.Expr) else None
                text = str(value.value) if isinstance(value, ast.Constant) else ""
                found[ast.unparse(item.targets[0])] = (str(call.args[1].value).split(), text)
    return found


def test_named_tuples_of_more_than_eight_arrays_describe_one_array_per_line(modules):
    missing, seen = {}, 0
    for module in modules:
        for name, (fields, text) in _described_tuples(module.tree).items():
            if len(fields) > FEW:
                seen += 1
                listed = re.findall(r"^(\w+) : \S", text, re.MULTILINE)
                if listed != fields:
                    missing[f"{module.path} {name}"] = [field for field in fields if field not in listed]
    assert seen > 0
    assert missing == {}


@pytest.mark.parametrize(
    ("docstring", "fields", "names"),
    [
        ("A place.\n\n    x : m. East.\n    y : m. North.\n    ", "x: float\n    y: float", []),
        ("A place: x, y m east and north.", "x: float\n    y: float", ["x", "y"]),
        ("A place.\n\n    x, y : m. East and north.\n    ", "x: float\n    y: float", ["x", "y"]),
        ("A place.", "x: float  # m, east\n    # m, north\n    y: float = 0.0", []),
        ("A place.", "x: float  # m, east\n    y: float", ["y"]),
        ("A place.", 'kind: str\n    x: float = Field(0.0, description="m, east")\n    y: float = Field(0.0)', ["y"]),
    ],
)
def test_the_check_of_fields_knows_good_from_bad(docstring, fields, names):
    text = f'class Place(NamedTuple):\n    """{docstring}"""\n\n    {fields}\n'
    node = ast.parse(text).body[0]
    assert isinstance(node, ast.ClassDef)
    assert undescribed(node, text) == names
