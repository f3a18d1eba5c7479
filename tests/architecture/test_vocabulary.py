"""Names and texts use the field's terms (docs/glossary.md), not words of this project's own invention."""

from __future__ import annotations

import io
import re
import tokenize

import pytest

WORDS = re.compile(
    r"(?<![a-z])(un)?(beliefs?|believ(e|es|ed|ing)|absorb(s|ed|ing)?|told|carried|chained|wander(s|ed|ing)?"
    r"|settl(e|es|ed|ing)|desks?|parted|judg(e|es|ed|ing)|aside|levers)(?![a-z])"
)
CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
READ = {tokenize.NAME, tokenize.STRING, tokenize.COMMENT, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING)}

ALLOWED = {
    "gnss/receiver_cards.py": {"told"},  # a key of earlier versions, refused with the new one
}
EXEMPT = {"CHANGELOG.md"}
"""It names what was renamed."""


def words_in(text: str) -> set[str]:
    """Return the words of the list in a text or an identifier."""
    spaced = CAMEL.sub(" ", text).replace("_", " ").lower()
    return {match.group(0) for match in WORDS.finditer(spaced)}


def offences(path: str, text: str) -> list[str]:
    """Return where a module's names, comments and strings hold such a word."""
    allowed = ALLOWED.get(path, set())
    return [
        f"{path}:{token.start[0]}: {word}"
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type in READ
        for word in sorted(words_in(token.string) - allowed)
    ]


def _within(path: str, places: set[str]) -> bool:
    return any(path == place or path.startswith(f"{place}/") for place in places)


@pytest.fixture(scope="module")
def found(modules) -> dict[str, list[str]]:
    """Offences by module, path within the package."""
    paths = {str(module.path.relative_to("lvnav_trade")): module.text for module in modules}
    every = {path: [*offences(path, text), *sorted(words_in(path))] for path, text in paths.items()}
    return {path: where for path, where in every.items() if where}


def test_modules_use_the_terms_of_the_glossary(found):
    assert found == {}


def test_cards_campaigns_and_documents_use_the_terms_of_the_glossary(root, published):
    wrong = []
    for file in published:
        path = str(file.relative_to(root))
        text = path.endswith(".md") and not path.startswith(("reports/", "tests/"))
        text |= path.startswith("lvnav_trade/") and path.endswith((".j2", ".toml"))
        yaml = path.endswith(".yaml") and path.startswith(("configs/", "campaigns/"))
        if (text or yaml) and not _within(path, EXEMPT):
            lines = enumerate(file.read_text().splitlines(), 1)
            wrong += [f"{path}:{number}: {word}" for number, line in lines for word in sorted(words_in(line))]
    assert wrong == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("believed_sigma", {"believed"}),
        ("class ImuBelief", {"belief"}),
        ("The filter is told; unsettled.", {"told", "unsettled"}),
        ("lever_b, the lever arm", set()),
        ("foretold, carriedge, judgement, besides", set()),
    ],
)
def test_the_check_of_words_knows_good_from_bad(text, words):
    assert words_in(text) == words
