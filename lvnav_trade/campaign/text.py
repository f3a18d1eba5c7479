"""Tables as plain text, for a terminal and for grep."""

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

_NARROWEST = 30  # characters of a last column that is wrapped


def table(header: Sequence[str], rows: Sequence[Sequence[Any]], width: int | None = None) -> str:
    """Return an aligned table without frames.

    header : names of the columns
    rows : cells of each row; floats are printed with four significant digits
    width : largest width of the table in characters, to which the last column is wrapped; None: no limit
    """
    lines = [list(header), *([_cell(value) for value in row] for row in rows)]
    columns = max(len(line) for line in lines)
    lines = [line + [""] * (columns - len(line)) for line in lines]
    if width is not None:
        lines = [part for line in lines for part in _wrapped(line, _room(lines, width))]
    widths = [max(len(line[index]) for line in lines) for index in range(columns)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines
    )


def _room(lines: Sequence[Sequence[str]], width: int) -> int:
    """Return the width of the last column (characters) in a table of a total width."""
    others = sum(max(len(cell) for cell in column) + 2 for column in list(zip(*lines, strict=True))[:-1])
    return max(width - others, _NARROWEST)


def _wrapped(line: Sequence[str], room: int) -> list[list[str]]:
    parts = wrap(line[-1], room, break_long_words=False, break_on_hyphens=False) or [""]
    return [[*line[:-1], parts[0]], *([""] * (len(line) - 1) + [part] for part in parts[1:])]


def _cell(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
