"""Sentences of the report, from facts and the templates in `templates/sentences.j2`."""

import re
from functools import cache
from typing import Any

import jinja2

from lvnav_trade.report.blocks import first_ones, listed, number, percent, words
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


def plural(count: int, one: str, some: str) -> str:
    """Return the singular form `one` or the plural form `some` for a count."""
    return one if count == 1 else some


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
        "listed": listed,
        "first_ones": first_ones,
    }
    return environment.get_template("sentences.j2").module
