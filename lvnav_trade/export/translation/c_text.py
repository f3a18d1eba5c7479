"""Texts of C functions: comments, declarations, structs, tables."""

from __future__ import annotations

import inspect
import re
import textwrap
from typing import Any

import numpy as np

from lvnav_trade.export.translation.values import (
    Array,
    literal,
    size_of,
)

WIDTH = 118
"""Characters of a line of C."""


def uses_self(text: str) -> bool:
    """Return whether a text refers to the struct of the program."""
    return re.search(r"\bself\b", text) is not None


def refers_to(name: str, text: str) -> bool:
    """Return whether a text refers to a local variable or parameter; fields of structs do not count."""
    return re.search(rf"(?<![.>\w]){name}\b", text) is not None


def declared_name(declaration: str) -> str:
    """Return the name in a declaration."""
    match = re.search(r"(\w+)\)?(\[\d+\])*$", declaration)
    assert match is not None
    return match.group(1)


def comment_lines(python: Any) -> list[str]:
    """Return the first paragraph of a kernel's docstring as a C comment."""
    paragraph = inspect.cleandoc(python.__doc__ or "").split("\n\n")[0]
    text = paragraph.replace("\n", " ").replace("*/", "* /")
    if not text:
        return []
    lines = textwrap.wrap(text, WIDTH - 6)
    lines = [f"/* {lines[0]}", *(f"   {line}" for line in lines[1:])]
    return [*lines[:-1], f"{lines[-1]} */"]


def declaration_lines(declarations: Any, text: str) -> list[str]:
    """Return the declarations of local variables that the text uses; numbers of one type share a line."""
    numbers: dict[str, list[str]] = {}
    arrays: list[str] = []
    for declaration in declarations:
        if not refers_to(declared_name(declaration), text):
            continue
        number_type, _, name = declaration.partition(" ")
        if name.isidentifier():
            numbers.setdefault(number_type, []).append(name)
        else:
            arrays.append(declaration)
    lines = []
    for number_type, names in numbers.items():
        wrapped_lines = textwrap.wrap(f"{number_type} {', '.join(names)}", WIDTH - 4, subsequent_indent="        ")
        lines.append("\n    ".join(wrapped_lines))  # a wrapped declaration counts as one line
    return lines + arrays


def static_text(text: str) -> str:
    """Return a function as static, because no other file calls it."""
    start = text.index("*/") + 3 if text.startswith("/*") else 0  # after its comment
    return f"{text[:start]}static {text[start:]}"


def struct_line(name: str, c_types: tuple[str, ...]) -> str:
    """Return the definition of a struct of numbers, which a function returns."""
    fields = [f"{number_type} v{i};" for i, number_type in enumerate(c_types)]
    return f"struct {name} {{ {' '.join(fields)} }};"


def table_text(name: str, array: Array) -> str:
    """Return the definition of a constant table."""
    sizes = "".join(f"[{size_of(size)}]" for size in array.sizes)
    return f"static const {array.c_type} {name}{sizes} = {_initialiser(array.value)};"


def _initialiser(content: np.ndarray) -> str:
    """Return the content of a table as a C initialiser."""
    if content.ndim == 1:
        row = ", ".join(literal(value).text for value in content) or "0"
        return "{" + "\n    ".join(textwrap.wrap(row, WIDTH - 4)) + "}"
    if not len(content):
        return "{{0}}"
    rows = [_initialiser(row) for row in content]
    return "{\n" + ",\n".join(rows) + "\n}"
