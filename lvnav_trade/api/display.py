"""Display of results in a notebook, as HTML and as text: a title, lines of text, tables."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import NamedTuple

import pandas as pd

MOST_ROWS = 40
"""Largest number of rows shown of a table; the number of further rows is printed below it."""


class Shown(NamedTuple):
    """Content of a displayed result."""

    title: str  # heading; none if empty
    lines: tuple[str, ...] = ()  # paragraphs below the heading
    tables: Mapping[str, pd.DataFrame] = {}  # tables by caption, in their order


class Displayed:
    """Base of results that a notebook and `print` display; a subclass returns the content from `_shown`."""

    def _shown(self) -> Shown:
        raise NotImplementedError

    def _repr_html_(self) -> str:
        return html_of(self._shown())

    def __str__(self) -> str:
        return text_of(self._shown())


def html_of(shown: Shown) -> str:
    """Return the content as HTML.

    Parameters
    ----------
    shown : Shown
        Content to display.

    Returns
    -------
    str
        HTML. Texts are escaped, because names that a user chose may contain markup.
    """
    parts = [f"<h4>{html.escape(shown.title)}</h4>"] if shown.title else []
    parts += [f"<p>{html.escape(line)}</p>" for line in shown.lines]
    for caption, frame in shown.tables.items():
        parts.append(f"<p><b>{html.escape(caption)}</b></p>" if caption else "")
        parts.append(frame.head(MOST_ROWS).to_html(index=False, border=0, na_rep="", float_format=_short))
        parts += [f"<p>{more}</p>" for more in _more(frame)]
    return "\n".join(part for part in parts if part)


def text_of(shown: Shown) -> str:
    """Return the content as plain text.

    Parameters
    ----------
    shown : Shown
        Content to display.

    Returns
    -------
    str
        Lines with the title, the paragraphs and the tables.
    """
    lines = [shown.title, *shown.lines]
    for caption, frame in shown.tables.items():
        lines.append(caption)
        lines.append(frame.head(MOST_ROWS).to_string(index=False, na_rep="", float_format=_short))
        lines += _more(frame)
    return "\n".join(line for line in lines if line)


def _short(value: float) -> str:
    return f"{value:.6g}"


def _more(frame: pd.DataFrame) -> list[str]:
    return [f"{len(frame) - MOST_ROWS} more rows"] if len(frame) > MOST_ROWS else []
