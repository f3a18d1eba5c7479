"""Tables as plain text, for a terminal and for grep."""

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

_NARROWEST_COLUMN = 30  # characters of a last column that is wrapped


def table(header: Sequence[str], rows: Sequence[Sequence[Any]], width: int | None = None) -> str:
    """Return an aligned table without frames.

    Parameters
    ----------
    header : sequence of str
        Names of the columns.
    rows : sequence of sequence
        Cells of each row; floats are printed with four significant digits.
    width : int, optional
        Largest width of the table in characters, to which the last column is wrapped; no limit by default.
    """
    lines = [list(header)]
    for row in rows:
        lines.append([_cell(value) for value in row])
    n_columns = max(map(len, lines))
    for line in lines:
        line.extend([""] * (n_columns - len(line)))
    if width is not None:
        lines = _wrap_last_column(lines, width)
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(_line_text(line, widths) for line in lines)


def frame_table(frame: Any) -> str:
    """Return the table of a pandas DataFrame."""
    return table(list(frame.columns), list(frame.itertuples(index=False)))


def _line_text(line: Sequence[str], widths: Sequence[int]) -> str:
    cells = [cell.ljust(width) for cell, width in zip(line, widths, strict=True)]
    return "  ".join(cells).rstrip()


def _wrap_last_column(lines: Sequence[list[str]], width: int) -> list[list[str]]:
    """Return a table whose last column is wrapped so that a line has at most `width` characters, where possible."""
    *first_columns, _ = zip(*lines, strict=True)
    first_columns_width = sum(max(map(len, column)) + 2 for column in first_columns)
    last_column_width = max(width - first_columns_width, _NARROWEST_COLUMN)
    wrapped_lines = []
    for line in lines:
        pieces = wrap(line[-1], last_column_width, break_long_words=False, break_on_hyphens=False)
        first_piece, *further_pieces = pieces or [""]
        wrapped_lines.append([*line[:-1], first_piece])
        blank_cells = [""] * (len(line) - 1)
        for piece in further_pieces:
            wrapped_lines.append([*blank_cells, piece])
    return wrapped_lines


def _cell(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
