"""Names of functions, arguments and variables are nouns or verbs, not bare prepositions, pronouns or participles."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

# prepositions; pronouns and adverbs; irregular participles
BARE = re.compile(
    "within|between|beyond|of|at|by|per|like|beside|above|below|behind|before|after|during|since|until|from|to|into|onto"
    "|over|under|with|without|through|against|among|around|off"
    "|one|others?|own|how|again|kind|parts?|each|here|there|those|these|both|rest|what|which|who|whose|whole|every|either"
    "|neither|such|same|more|less|most|least|much|many|few|some|any|another|once|later|earlier|soon|apart|alone"
    "|found|known|made|met|kept|asked|given|said|told|left|held|taken|drawn|flown|seen|put|shown|begun|gone|done|heard"
    "|chosen|split|written|sent|spent|won|lost|felt|meant|paid|led"
)
NOUNS = {"need", "seed", "speed", "feed", "thousand"}
PARTICIPLE = re.compile(r"[a-z]+[^e\W]ed")
# Names that a user writes or sees: options of the command line, functions and arguments of the Python interface.
PUBLIC = {"lvnav_trade.api", "lvnav_trade.cli"}
FIELD_TERMS = {
    "by",  # y component of a vector b, next to bx and bz
}
OVERRIDES = {"other"}  # second argument of __eq__
PUBLIC_FUNCTIONS = {  # exported by lvnav_trade.api, or drawn by name with these arguments
    "published_row",
    "quoted",
    "require_unit",
    "unevaluated",
    "marks",
    "reacquisition_times",
    "errors",
    "relative",
    "locus",
}


def is_bare(name: str) -> bool:
    """Return whether a name is a preposition, a pronoun or a participle alone."""
    word = name.strip("_")
    if word in NOUNS:
        return False
    return any(pattern.fullmatch(word) for pattern in (BARE, PARTICIPLE))


def names(function: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[tuple[str, ast.stmt | ast.expr | ast.arg]]:
    """Yield the names that a function defines: its own, its arguments, its local variables."""
    yield function.name, function
    for argument in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs):
        yield argument.arg, argument
    for node in ast.walk(function):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id, node


def test_no_name_is_a_bare_preposition_pronoun_or_participle(modules):
    bare_names = {
        f"{module.path}:{node.lineno} {name}"
        for module in modules
        if not any(module.name.startswith(package) for package in PUBLIC)
        for function in module.functions()
        if function.name not in PUBLIC_FUNCTIONS
        for name, node in names(function)
        if is_bare(name) and name not in FIELD_TERMS | OVERRIDES
    }
    assert bare_names == set()


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("known", True),
        ("_shown", True),
        ("expected", True),
        ("at", True),
        ("kind", True),
        ("stored_state", False),
        ("speed", False),
        ("is_delayed", False),
        ("count", False),
    ],
)
def test_the_check_knows_a_noun_from_a_participle(name, expected):
    assert is_bare(name) is expected
