"""Building blocks of a report: paragraphs, tables, figures of cases; format of names and numbers."""

import math
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.report.escape import note, texts
from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.browser import data_of
from lvnav_trade.report.figures.figure import Figure, Panel, alt_text
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.mission.orbit import LEAST
from lvnav_trade.results.tables.read import Tables

_HALF_SHEET = 78  # characters of a table, with a space per column, across half a page
_HALF_ROWS = 40  # largest number of rows of such a table, which is not split between pages


class Text(NamedTuple):
    """A paragraph, or a command.

    text : The text.
    lead : First words, emphasised.
    block_type : "text", or "code" for a command.
    is_nothing : Whether the text only says that there is nothing to show.
    """

    text: str
    lead: str = ""
    block_type: str = "text"
    is_nothing: bool = False


class Table(NamedTuple):
    """A table with finished texts."""

    head: tuple[str, ...]  # column headings
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[bool, ...]  # whether each column is numeric, and so right-aligned
    caption: str = ""
    block_type: str = "table"

    @property
    def is_narrow(self) -> bool:
        """Whether it fits into half the width of a page, with headings broken between words."""
        if len(self.rows) > _HALF_ROWS:
            return False
        n_characters = 0
        for column, name in enumerate(self.head):
            lengths = [len(word) for word in name.split()] + [len(row[column]) for row in self.rows]
            n_characters += max(lengths, default=0) + 1
        return n_characters <= _HALF_SHEET


class Picture(NamedTuple):
    """A figure with its caption."""

    name: str  # file name without extension
    figure: Figure
    caption: str
    block_type: str = "picture"

    @property
    def data(self) -> str:
        """The figure as JSON, for the script of the report."""
        return data_of(self.figure)

    @property
    def height(self) -> int:
        """Approximate height in pixels, reserved in the report until the figure is drawn."""
        return int(88 * self.figure.height * len(self.figure.grid)) + 60

    @property
    def alt(self) -> str:
        """Description for screen readers: the caption and the content of each panel."""
        descriptions = [f"{alt_text(panel)}." for panel in self.figure.panels if panel.marks]
        return " ".join([self.caption, *descriptions])

    @property
    def width(self) -> str:
        """Width on a printed page: wide, half, or third for a column of many panels."""
        rows, columns = self.figure.grid.shape
        has_map = any(map(_is_map, self.figure.panels))
        has_bars = columns > 1 and self.figure.options.get("sharey") and not has_map
        if columns > 2 or has_bars:
            return "wide"
        return "third" if columns == 1 and rows > 2 else "half"


def _is_map(panel: Panel) -> bool:
    """Whether a panel colours cells by their values."""
    return any(mark.mark_type == "cells" for mark in panel.marks)


class SourceScaling(NamedTuple):
    """Interactive control that scales an error source; in HTML reports only."""

    data: str  # JSON for the script of the report
    block_type: str = "grades"


class DesignExplorer(NamedTuple):
    """Interactive scatter plot and parallel axes of a design space; in HTML reports only."""

    data: str  # JSON for the script of the report
    block_type: str = "designs"


class Details(NamedTuple):
    """Blocks that an HTML report shows on demand, and Markdown below a heading; a brief report omits them."""

    title: str
    blocks: Sequence[Any]
    block_type: str = "more"


Block = Text | Table | Picture | SourceScaling | DesignExplorer | Details
Blocks = Callable[[Tables], list[Block]]
_TableBlocks = Callable[[Tables, pd.DataFrame], list[Block]]  # of a computed table


class Section(NamedTuple):
    """A section of the report."""

    name: str  # name by which a campaign selects the section
    title: str
    blocks: list[Block]


def number(value: float) -> str:
    """Return a number as text with three significant digits; a dash for None and NaN."""
    if value is None or value != value:
        return "–"
    if isinstance(value, int | np.integer):
        return str(value)
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.2e}"
    rounded_value = float(f"{value:.2e}")
    exponent = math.floor(math.log10(abs(rounded_value)))
    return f"{rounded_value:.{max(0, 2 - exponent)}f}"


def percent(value: float) -> str:
    """Return a fraction in percent as text, with six digits so that 99.73 % is not rounded to 100 %."""
    return f"{100.0 * value:.6g} %"


def join_texts(texts: Sequence[str], max_count: int, separator: str = "; ") -> str:
    """Return texts joined by a separator.

    Of more than `max_count` texts only the first are listed, followed by the number of the others.
    """
    text = separator.join(texts[:max_count])
    n_more = len(texts) - max_count
    return f"{text}; and {n_more} more, see the table" if n_more > 0 else text


def join_first_names(names: Sequence[str], max_count: int) -> str:
    """Join names by "and"; of more than `max_count` + 1 names only the first, with the number of the others."""
    n_more = len(names) - max_count
    if n_more > 1:
        names = [*names[:max_count], f"{n_more} more"]
    return " and ".join(names)


def join_names(names: Sequence[str], max_count: int, separator: str = ", ") -> str:
    """Return names joined by a separator: "a, b and 3 more".

    Of more than `max_count` names only the first are listed, followed by the number of the others.
    """
    text = separator.join(names[:max_count])
    n_more = len(names) - max_count
    if n_more <= 0:
        return text
    conjunction = "; and" if separator == "; " else " and"
    return f"{text}{conjunction} {n_more} more"


def words(names: Any) -> Any:
    """Return a name, or a column of names, with spaces for underscores."""
    if isinstance(names, pd.Series):
        return names.str.replace("_", " ")
    return str(names).replace("_", " ")


def formatted_columns(frame: pd.DataFrame, columns: str) -> pd.DataFrame:
    """Return columns of a frame with headings and formatted values.

    Parameters
    ----------
    frame : pandas.DataFrame
        The frame.
    columns : str
        Entries ``HEADING = COLUMN: FORM`` separated by bars. FORM is a Python format (a missing number becomes a dash),
        ``words``, ``number``, ``percent``, ``element`` (seven digits; zero is given with its bound) or ``time`` (s;
        "never" if missing); without FORM the column is unchanged. ``COLUMN to OTHER: FORM`` are bounds, shown as one
        number if they are equal. Without HEADING the name of the column is used. Missing columns are omitted.

    Returns
    -------
    pandas.DataFrame
        The columns in the order of the entries.
    """
    columns_by_heading = {}
    for entry in columns.split(" | "):
        heading, _, content = entry.rpartition(" = ")
        name, _, form = content.partition(": ")
        bounds = [_format_column(frame[bound], form) for bound in name.split(" to ") if bound in frame]
        if len(bounds) == 1:
            columns_by_heading[heading or words(name)] = bounds[0]
        elif bounds:
            columns_by_heading[heading or words(name)] = _interval_text(*bounds)
    return pd.DataFrame(columns_by_heading)


def _format_column(values: pd.Series, form: str) -> pd.Series:
    """Return a column as text in a form (see `formatted_columns`)."""
    if not form:
        return values
    if form == "words":
        text: pd.Series = words(values)
        return text
    formats: dict[str, Callable[[float], str]] = {
        "number": number,
        "percent": percent,
        "element": _format_element,
        "time": _format_time,
    }
    to_text = formats.get(form, lambda value: format(value, form) if value == value else "–")
    return values.map(to_text)


def _format_element(value: float) -> str:
    """Return an orbital element with seven digits; zero with the bound below which it is not resolved."""
    if value != value:
        return "–"
    return f"{value:.7g}" if value else f"0 (below {LEAST:g})"


def _format_time(value: float) -> str:
    return f"{value:.0f}" if value == value else "never"


def _interval_text(low: pd.Series, high: pd.Series) -> pd.Series:
    """Return bounds as the text of an interval, or of one number if they are equal."""
    return low.where(low == high, low + " to " + high)


def table(frame: pd.DataFrame, caption: str = "", columns: str = "") -> Table:
    """Return a frame as a table.

    Parameters
    ----------
    frame : pandas.DataFrame
        The frame.
    caption : str
        Caption of the table.
    columns : str
        Columns and their formats, see `formatted_columns`; by default all columns.
    """
    if columns:
        frame = formatted_columns(frame, columns)
    numeric = tuple(pd.api.types.is_numeric_dtype(dtype) and dtype is not bool for dtype in frame.dtypes)
    rows = tuple(tuple(map(_cell, row)) for row in frame.itertuples(index=False))
    return Table(tuple(map(str, frame.columns)), rows, numeric, caption)


def _cell(value: Any) -> str:
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return value if isinstance(value, str) else number(value)


def all_cases(count: int) -> str:
    """Return the name of all cases together, such as "both cases" or "all 6 cases"."""
    return "both cases" if count == 2 else f"all {count} cases"


def combine_equal_cases(frame: pd.DataFrame) -> pd.DataFrame:
    """Return a frame with column `case` in which cases with equal rows are combined under a common name."""
    groups: dict[tuple[tuple[str, ...], ...], list[str]] = {}
    rows = list(frame.drop(columns="case").astype(str).itertuples(index=False, name=None))
    for case, places in row_numbers(frame.case).items():
        content = tuple(rows[k] for k in places)
        groups.setdefault(content, []).append(case)
    if len(groups) == frame.case.nunique():
        return frame
    names = {}
    for cases in groups.values():
        names[cases[0]] = all_cases(len(cases)) if len(groups) == 1 else "; ".join(cases)
    first = frame[frame.case.isin(list(names))]
    return first.assign(case=first.case.map(names))


def table_section(metric: str, empty_text: str = "") -> Callable[[_TableBlocks], Blocks]:
    """Decorate a function of a computed table so that it becomes a function of results.

    Parameters
    ----------
    metric : str
        Name of the computed table.
    empty_text : str
        Text if the table is empty; no block if this text is empty as well.
    """

    def decorate(make: _TableBlocks) -> Blocks:
        @wraps(make)
        def section(tables: Tables) -> list[Block]:
            frame = METRICS[metric](tables)
            if len(frame):
                return make(tables, frame)
            return [Text(empty_text, is_nothing=True)] if empty_text else []

        return section

    return decorate


def formatted_table(name: str, frame: pd.DataFrame, combines_cases: bool = False, **content: str) -> Table:
    """Return a frame as a table with the layout of `templates/texts.toml`.

    Parameters
    ----------
    name : str
        Name of the layout, which selects columns (see `blocks.formatted_columns`) or gives headings, and a caption.
    frame : pandas.DataFrame
        The rows.
    combines_cases : bool
        Combine cases with equal rows.
    **content
        Texts for the braces in the caption.
    """
    layout = texts()["tables"][name]
    if "columns" in layout:
        frame = formatted_columns(frame, " ".join(layout["columns"].split()))
    else:
        headings = " ".join(layout["headings"].split())
        frame = frame.set_axis(headings.split(" | "), axis=1)
    caption = " ".join(layout.get("caption", "").split())
    return table(combine_equal_cases(frame) if combines_cases else frame, caption.format(**content))


def row_numbers(cases: pd.Series) -> dict[str, Any]:
    """Return the row numbers (n_row,) of each case, in order of first occurrence."""
    return {str(case): places for case, places in cases.groupby(cases, sort=False).indices.items()}


def case_sentence(tables: Tables, case: str, cases: Sequence[str]) -> str:
    """Return the label of a case as a sentence if its figure does not represent all cases."""
    if len(cases) > 1:
        return f" {tables.labels[case]}."
    return ""


def figures(tables: Tables, plot: str, cases: Sequence[str], **content: str) -> list[Block]:
    """Return a numbered figure for each case; with several cases the caption names the case.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    plot : str
        Name of the plot, and of its caption in `templates/texts.toml`.
    cases : sequence of str
        Digests of the cases.
    **content
        Texts for the braces in the caption.
    """
    pictures: list[Block] = []
    for k, case in enumerate(cases, 1):
        caption = note(plot, "figures", **content) + case_sentence(tables, case, cases)
        pictures.append(Picture(f"{plot}-{k}", PLOTS[plot](tables, case), caption))
    return pictures


def figure(tables: Tables, plot: str, *about: str, name: str = "", **content: str) -> Picture:
    """Return a figure of a case, of a quantity, or of both.

    The figure is named after its plot and its subjects. Its caption is a text of `templates/texts.toml`, with its
    braces filled with label, quantity and `content`.

    plot : name of the plot
    about : arguments of the plot: digest of the case, quantity, or both; the last is used as the quantity
    name : name of the figure and its caption, if not that of the plot
    """
    if about:
        case = about[0]
        quantity = about[-1]
    else:
        case = ""
        quantity = ""
    name = name or plot
    content["label"] = tables.labels.get(case, "")
    content["quantity"] = quantity
    content["Quantity"] = quantity.capitalize()
    caption = note(name, "figures", **content)
    return Picture("-".join([name, *about]), PLOTS[plot](tables, *about), caption)
