"""How results show themselves in a notebook: a title, a line of text, tables; as HTML and as text."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import NamedTuple

import pandas as pd

MOST_ROWS = 40
"""Rows of a table that are shown; the rest is counted."""


class Shown(NamedTuple):
    """What is shown of a result: title, lines of text, tables by caption."""

    title: str
    lines: tuple[str, ...] = ()
    tables: Mapping[str, pd.DataFrame] = {}


class Displayed:
    """A result that shows itself in a notebook; a subclass says what in `_shown`."""

    def _shown(self) -> Shown:
        raise NotImplementedError

    def _repr_html_(self) -> str:
        return html_of(self._shown())

    def __str__(self) -> str:
        return text_of(self._shown())


def html_of(shown: Shown) -> str:
    """Return HTML; names of the user are text in it, never markup."""
    parts = [f"<h4>{html.escape(shown.title)}</h4>"] if shown.title else []
    parts += [f"<p>{html.escape(line)}</p>" for line in shown.lines]
    for caption, frame in shown.tables.items():
        parts.append(f"<p><b>{html.escape(caption)}</b></p>" if caption else "")
        parts.append(frame.head(MOST_ROWS).to_html(index=False, border=0, na_rep="", float_format=_short))
        parts += [f"<p>{more}</p>" for more in _more(frame)]
    return "\n".join(part for part in parts if part)


def text_of(shown: Shown) -> str:
    """Return the same as text."""
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
