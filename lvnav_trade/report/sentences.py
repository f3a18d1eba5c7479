"""Sentences of the report, from facts and the templates in `templates/sentences.j2`."""

import re
from functools import cache
from typing import Any

import jinja2

from lvnav_trade.report.blocks import all_cases, join_first_names, join_texts, number, percent, words
from lvnav_trade.report.escape import source

_BLANKS = re.compile(r"[ \n]+")


def say(name: str, /, **facts: Any) -> str:
    """Return a sentence of the report.

    Parameters
    ----------
    name : str
        Name of the macro in `templates/sentences.j2`.
    **facts
        Values for the macro.

    Returns
    -------
    str
        Sentence with single spaces. It is not escaped; the templates of the documents escape it.
    """
    return _BLANKS.sub(" ", getattr(_sentences(), name)(**facts)).strip()


def plural(count: int, singular_form: str, plural_form: str) -> str:
    """Return the singular form `singular_form` or the plural form `plural_form` for a count."""
    return singular_form if count == 1 else plural_form


@cache
def _sentences() -> Any:
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(source), undefined=jinja2.StrictUndefined, autoescape=False
    )
    environment.filters |= {
        "plural": plural,
        "number": number,
        "percent": percent,
        "words": words,
        "all_cases": all_cases,
        "join_texts": join_texts,
        "join_first_names": join_first_names,
    }
    return environment.get_template("sentences.j2").module
