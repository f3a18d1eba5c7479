"""The package knows no publication of a study: neither names, settings nor texts are named after one.

Docstrings and comments may cite their sources, and standard models keep the names that they have everywhere.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

# Agencies, authors, vehicles and file numbers of the publications that the studies in campaigns/ answer. GAINS is the
# name of a filter there, and counts in capitals only.
WORDS = re.compile(
    r"conae|(?<![a-z])dlr(?![a-z])|drdc|(?<![a-z])isro(?![a-z])|shefex|(?<![a-z])vlm(?![a-z])|canepa|servidia|trigo(?!n)"
    r"|(?<![a-z])theil(?![a-z])|beaudoin|desbiens|gagnon|landry|karuturi|syamala|shukkoor|mohanlal|pslv"
    r"|thomas et al|_00[0-4](?![0-9])|paper 00|(?-i:\bGAINS\b)",
    re.IGNORECASE,
)
TEXT = {".toml", ".j2", ".js", ".css", ".txt"}


def said(source: str) -> Iterator[tuple[int, str]]:
    """Yield line and text of what a module says apart from docstrings and comments: names, strings, numbers."""
    nodes = ast.walk(ast.parse(source))
    holders = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    documented = [node.body for node in nodes if isinstance(node, holders)]
    lines: set[int] = set()
    for body in documented:
        for statement in body:  # a string by itself documents what stands before it
            alone = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
            if alone and isinstance(statement.value.value, str):
                lines |= set(range(statement.lineno, (statement.end_lineno or statement.lineno) + 1))
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in (tokenize.COMMENT, tokenize.NUMBER) and token.start[0] not in lines:
            yield token.start[0], token.string


def test_nothing_in_the_package_is_named_after_a_publication_of_a_study(root: Path, modules) -> None:
    suspects = [module for module in modules if WORDS.search(module.text)]
    found = [
        f"{one.path}:{line}: {text[:80]}" for one in suspects for line, text in said(one.text) if WORDS.search(text)
    ]
    files = [path.relative_to(root) for path in (root / "lvnav_trade").rglob("*") if "_data" not in path.parts]
    found += [str(path) for path in files if WORDS.search(str(path))]
    for path in files:
        if path.suffix in TEXT:
            lines = (root / path).read_text(encoding="utf-8").splitlines()
            found += [f"{path}:{k}: {line[:80]}" for k, line in enumerate(lines, 1) if WORDS.search(line)]
    assert found == []


@pytest.mark.parametrize(
    ("source", "is_found"),
    [
        ('"""Canepa and Servidia, eq. 3.1."""\n', False),
        ("gain = 2.47  # of Beaudoin et al.\n", False),
        ("def conae(): ...\n", True),
        ('kind = "conae_000"\n', True),
        ('class A:\n    """Trigo and Theil, eq. 16."""\n\n    text = "of Trigo and Theil"\n', True),
        ("trigonometric = gains = 60_000\n", False),
        ('study = "GAINS"\n', True),
    ],
)
def test_the_check_of_names_knows_a_citation_from_a_name(source: str, is_found: bool) -> None:
    assert any(WORDS.search(text) for _, text in said(source)) == is_found
