"""Every verb of the command line is a documented function; what is public says what it takes and returns."""

from __future__ import annotations

import inspect
import re

import pytest
from typer.main import get_command

from lvnav_trade import api
from lvnav_trade.cli import app

VERBS = sorted(name.replace("-", "_") for name in get_command(app).commands)  # type: ignore[attr-defined]
FUNCTIONS = sorted(name for name in api.__all__ if inspect.isfunction(getattr(api, name)))
CLASSES = sorted(name for name in api.__all__ if inspect.isclass(getattr(api, name)))


def sections_of(docstring: str) -> dict[str, list[str]]:
    """Return the lines of the sections of a numpydoc docstring by heading."""
    found: dict[str, list[str]] = {"": []}
    heading = ""
    lines = inspect.cleandoc(docstring).splitlines()
    for at, line in enumerate(lines):
        if at + 1 < len(lines) and re.fullmatch(r"-{3,}", lines[at + 1]) and len(lines[at + 1]) == len(line):
            heading = line
            found[heading] = []
        elif not re.fullmatch(r"-{3,}", line):
            found[heading].append(line)
    return found


def entries_of(lines: list[str]) -> dict[str, str]:
    """Return the meaning of every name in a section; several names share a line."""
    found: dict[str, str] = {}
    for line in lines:
        if line and not line.startswith(" "):
            names = [name.strip() for name in line.partition(" : ")[0].split(",")]
            found |= dict.fromkeys(names, "")
        elif line.strip():
            found |= {name: f"{found[name]} {line.strip()}".strip() for name in names}
    return found


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_is_a_function_of_its_name(verb):
    assert verb in FUNCTIONS


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_documents_what_it_takes_and_returns(name):
    function = getattr(api, name)
    sections, taken = sections_of(function.__doc__ or ""), inspect.signature(function).parameters
    entries = entries_of(sections.get("Parameters", []))
    assert list(entries) == list(taken)
    assert all(meaning.endswith((".", ";")) for meaning in entries.values()), entries
    assert sections["Returns"]
    assert sections[""][0].endswith("."), "the first line is a sentence of its own"
    assert inspect.signature(function).return_annotation is not inspect.Signature.empty


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_takes_at_most_eight_arguments(name):
    assert len(inspect.signature(getattr(api, name)).parameters) <= 8


@pytest.mark.parametrize("name", CLASSES)
def test_every_public_record_documents_its_fields(name):
    kind = getattr(api, name)
    fields = set(getattr(kind, "__dataclass_fields__", {}))
    documented = entries_of(sections_of(kind.__doc__ or "").get("Attributes", []))
    assert fields <= set(documented)
    public = {n for n, member in vars(kind).items() if inspect.isfunction(member) and not n.startswith("_")}
    assert all(getattr(kind, method).__doc__ for method in public)


def test_the_check_of_docstrings_knows_good_from_bad():
    text = "Do it.\n\nParameters\n----------\na, b : int\n    What they are.\nc : str\n    Its\n    name.\n\n"
    text += "Returns\n-------\nint\n"
    sections = sections_of(text)
    assert entries_of(sections["Parameters"]) == {"a": "What they are.", "b": "What they are.", "c": "Its name."}
    assert sections["Returns"] == ["int"]
    assert "Parameters" not in sections_of("Do it.\n\nParameters: a.")


def test_names_of_the_package_are_sorted_and_there():
    assert all(hasattr(api, name) for name in api.__all__)
    assert len(set(api.__all__)) == len(api.__all__)
