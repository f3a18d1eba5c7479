"""Sentences of the report: their words stand in one template, and each of them is said somewhere."""

from __future__ import annotations

import ast
import gc
import re
from functools import cache
from pathlib import Path

import jinja2
import pytest

from lvnav_trade.report.escape import source
from lvnav_trade.report.sentences import plural, say

PACKAGE = Path(__file__).resolve().parents[2] / "lvnav_trade"
NAMED = set(re.findall(r"{% macro (\w+)", source("sentences.j2")))
WITHIN = {"inconsistent"}  # said by other sentences
ALONE = "By linear covariance, without a demonstration by runs: "
VERDICT = {"whole": 6, "requirements": 1, "evidence": "", "others": [], "by_covariance": False}


@cache
def nodes() -> tuple[list[ast.Call], list[ast.BinOp]]:
    """Return the calls and the products of the package."""
    gc.disable()  # a search for garbage among a million nodes takes longer than parsing
    try:
        trees = [ast.parse(file.read_text(encoding="utf-8")) for file in PACKAGE.rglob("*.py")]
        found = [node for tree in trees for node in ast.walk(tree)]
    finally:
        gc.enable()
    calls = [node for node in found if isinstance(node, ast.Call)]
    products = [node for node in found if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult)]
    return calls, products


def test_each_sentence_of_the_template_is_said_and_no_other() -> None:
    calls, _ = nodes()
    said = {node.args[0].value for node in calls if isinstance(node.func, ast.Name) and node.func.id == "say"}
    assert said == NAMED - WITHIN


def test_no_text_is_made_by_multiplication() -> None:
    def is_text(node: ast.AST) -> bool:
        text = node.value if isinstance(node, ast.Constant) else ""
        return isinstance(node, ast.JoinedStr) or (isinstance(text, str) and any(one.isalpha() for one in text))

    _, products = nodes()
    found = [ast.unparse(node) for node in products if is_text(node.left) or is_text(node.right)]
    assert found == []


@pytest.mark.parametrize(
    ("facts", "text"),
    [
        ({"met": 5}, "5 of 6 designs meet the requirement."),
        ({"met": 1, "requirements": 2}, "1 of 6 designs meets both requirements."),
        ({"met": 0, "requirements": 3}, "None of 6 designs meets all 3 requirements."),
        ({"met": 1, "whole": 1}, "The design meets the requirement."),
        (
            {"met": 0, "whole": 1, "others": ["1 does not"]},
            "The design does not meet the requirement; 1 does not.",
        ),
        (
            {"met": 2, "by_covariance": True, "evidence": ", shown by runs"},
            f"{ALONE}2 of 6 designs meet the requirement, shown by runs.",
        ),
    ],
)
def test_the_verdict_is_a_sentence(facts: dict[str, object], text: str) -> None:
    assert say("verdict", **(VERDICT | facts)) == text


@pytest.mark.parametrize(
    ("offset", "text"), [(0.0, "at burnout"), (2.04, "2.0 s after burnout"), (-0.5, "0.5 s before burnout")]
)
def test_the_place_of_a_worst_error_is_said_in_words(offset: float, text: str) -> None:
    assert say("when", offset=offset, event="burnout") == text


def test_a_fact_that_is_missing_is_an_error_and_no_gap() -> None:
    with pytest.raises(jinja2.UndefinedError):
        say("verdict", met=1)


def test_names_are_written_as_they_are() -> None:
    assert say("largest_mean", case="<b>A & B</b>", mean=0.5, unit="m", there="") == (
        "<b>A & B</b>: the mean error, 0.500 m in every run"
    )


def test_a_word_is_of_one_or_of_several() -> None:
    assert [plural(count, "case", "cases") for count in (0, 1, 2)] == ["cases", "case", "cases"]


MATRIX = {"required": "", "signs": ["✓ met"], "marks": [], "moments": ["injection"], "event": "injection"}


@pytest.mark.parametrize("has_multiples", [False, True])
@pytest.mark.parametrize("by_covariance", [False, True])
@pytest.mark.parametrize("has_windows", [False, True])
def test_what_may_be_left_out_leaves_no_blank_before_a_point(has_multiples, by_covariance, has_windows) -> None:
    text = say("matrix", has_multiples=has_multiples, by_covariance=by_covariance, has_windows=has_windows, **MATRIX)
    assert not re.search(r" [,.;:]|\.\S", text)
    assert ("twice the limit" in text, "does not consider" in text) == (has_multiples, has_windows)


def test_how_many_more_ways_to_comply_there_are_is_said_in_a_sentence() -> None:
    assert [say("comply_first", advice="Do.", others=count) for count in (0, 1, 3)] == [
        "Do.",
        "Do. 1 more way to comply is listed under Requirements.",
        "Do. 3 more ways to comply are listed under Requirements.",
    ]
