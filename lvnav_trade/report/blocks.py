"""Building blocks of a report: paragraphs, tables, figures of cases; format of names and numbers."""

import hashlib
import math
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.layout import split_metric
from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.basics.select import NAVIGATION
from lvnav_trade.metrics.mission.orbit import LEAST
from lvnav_trade.metrics.requirements.margins import key_cases
from lvnav_trade.plots import PLOTS
from lvnav_trade.plots.browser import data_of
from lvnav_trade.plots.figure import Figure, Panel, alt_text
from lvnav_trade.report.escape import note, texts
from lvnav_trade.store.read import Tables

_HALF_SHEET = 78  # letters of a table, and a space a column, across half a sheet of paper
_HALF_ROWS = 40  # rows of it: it is kept in one piece
MOST_CASES = 8
"""Cases whose own figures are drawn; of more, those that decide and the best."""


class Text(NamedTuple):
    """A paragraph whose lead stands out, or lines to type (kind "code").

    is_nothing: it says that there is nothing to show; a section of such paragraphs alone is left out.
    """

    text: str
    lead: str = ""
    kind: str = "text"
    is_nothing: bool = False


class Table(NamedTuple):
    """A table: headings, rows of finished texts, which columns hold numbers, caption."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[bool, ...]
    caption: str = ""
    kind: str = "table"

    @property
    def narrow(self) -> bool:
        """Whether it has room on half the width of a sheet of paper; a heading may break between words."""
        headings = [max(map(len, name.split()), default=0) for name in self.head]
        longest = [max([size, *(len(row[k]) for row in self.rows)]) for k, size in enumerate(headings)]
        return len(self.rows) <= _HALF_ROWS and sum(longest) + len(longest) <= _HALF_SHEET


class Picture(NamedTuple):
    """A figure: file name without ending, its data, caption."""

    name: str
    figure: Figure
    caption: str
    kind: str = "picture"

    @property
    def data(self) -> str:
        """The figure as JSON, for the script of the page."""
        return data_of(self.figure)

    @property
    def height(self) -> int:
        """Pixels that the page keeps free for it until it is drawn, about."""
        return int(88 * self.figure.height * len(self.figure.grid)) + 60

    @property
    def alt(self) -> str:
        """The figure in words: its caption, then what each panel shows."""
        return " ".join([self.caption, *(f"{alt_text(panel)}." for panel in self.figure.panels if panel.marks)])

    @property
    def width(self) -> str:
        """Part of a sheet of paper that it needs: the whole one of three columns, a third where panels are many."""
        rows, columns = self.figure.grid.shape
        bars = columns > 1 and self.figure.options.get("sharey") and not any(map(_is_map, self.figure.panels))
        return "wide" if columns > 2 or bars else "third" if columns == 1 and rows > 2 else "half"


def _is_map(one: Panel) -> bool:
    """Whether a panel colours cells by their values."""
    return any(mark.kind == "cells" for mark in one.marks)


class Grades(NamedTuple):
    """Data, as JSON, of a control that scales a source of error; shown by a script on the page, else not at all."""

    data: str
    kind: str = "grades"


class Designs(NamedTuple):
    """Data, as JSON, of a scatter and of parallel axes of many designs; drawn by a script of the page, else not."""

    data: str
    kind: str = "designs"


class More(NamedTuple):
    """Blocks that are one click away on the page, and below a heading in Markdown; a brief report leaves them out."""

    title: str
    blocks: Sequence[Any]
    kind: str = "more"


Block = Text | Table | Picture | Grades | Designs | More
Blocks = Callable[[Tables], list[Block]]


class Section(NamedTuple):
    """A part of the report."""

    name: str
    title: str
    blocks: list[Block]


def number(value: float) -> str:
    """Write a number with three significant digits; a dash where there is none."""
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
    rounded = float(f"{value:.2e}")
    return f"{rounded:.{max(0, 2 - math.floor(math.log10(abs(rounded))))}f}"


def percent(value: float) -> str:
    """Write a fraction in percent without rounding 99.73 to 100."""
    return f"{100.0 * value:.6g} %"


def listed(texts: Sequence[str], most: int, separator: str = "; ") -> str:
    """Join texts; of more than `most` the first ones, and how many more there are."""
    more = [f"and {len(texts) - most} more, see the table"] if len(texts) > most else []
    return "; ".join([separator.join(texts[:most]), *more])


def first_ones(names: Sequence[str], most: int) -> str:
    """Join names by "and"; of more than one beyond `most` the first ones, and how many more there are."""
    more = len(names) - most
    return " and ".join([*names[:most], f"{more} more"] if more > 1 else names)


def among(names: Sequence[str], most: int, separator: str = ", ") -> str:
    """Join names; of more than `most` the first ones, and how many more there are: "a, b and 3 more"."""
    more = len(names) - most
    last = ("; and " if separator == "; " else " and ") + f"{more} more"
    return separator.join(names[:most]) + (last if more > 0 else "")


def words(names: Any) -> Any:
    """Return a name, or a column of names, with spaces for underscores."""
    return names.str.replace("_", " ") if isinstance(names, pd.Series) else str(names).replace("_", " ")


def shown(frame: pd.DataFrame, columns: str) -> pd.DataFrame:
    """Return columns of a frame as they are shown.

    columns : entries ``HEADING = COLUMN: FORM`` between bars. FORM is a format of Python (a number that is missing is
        a dash), ``words``, ``number``, ``percent``, ``element`` (seven digits; a zero has its bound) or ``time`` (s;
        "never" where it is missing); without it the column stays what it is. ``COLUMN to OTHER: FORM`` are bounds,
        one number where both are the same.
        Without a heading the column's own name is it, in words. Columns that the frame lacks are left out.
    """
    found = {}
    for entry in columns.split(" | "):
        heading, _, source = entry.rpartition(" = ")
        name, _, form = source.partition(": ")
        bounds = [_written(frame[bound], form) for bound in name.split(" to ") if bound in frame]
        if bounds:
            found[heading or words(name)] = bounds[0] if len(bounds) == 1 else _interval_text(*bounds)
    return pd.DataFrame(found)


def _interval_text(low: pd.Series, high: pd.Series) -> pd.Series:
    """Write bounds as an interval; those that are the same as one number."""
    return low.where(low == high, low + " to " + high)


def _written(values: pd.Series, form: str) -> pd.Series:
    if form in ("", "words"):
        return words(values) if form else values
    named: dict[str, Callable[[float], str]] = {
        "number": number,
        "percent": percent,
        "element": lambda value: "–" if value != value else f"{value:.7g}" if value else f"0 (below {LEAST:g})",
        "time": lambda value: f"{value:.0f}" if value == value else "never",
    }
    return values.map(named.get(form, lambda value: format(value, form) if value == value else "–"))


def table(frame: pd.DataFrame, caption: str = "", columns: str = "") -> Table:
    """Return a frame as a table, all of it under its own names, or the columns that are asked for (see `shown`)."""
    frame = shown(frame, columns) if columns else frame
    numeric = tuple(pd.api.types.is_numeric_dtype(kind) and kind is not bool for kind in frame.dtypes)
    rows = tuple(tuple(_cell(value) for value in row) for row in frame.itertuples(index=False))
    return Table(tuple(map(str, frame.columns)), rows, numeric, caption)


def _cell(value: Any) -> str:
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return value if isinstance(value, str) else number(value)


def same_once(frame: pd.DataFrame) -> pd.DataFrame:
    """Return a frame with a column `case` in which cases that have the same rows stand once, named together."""
    groups: dict[tuple[tuple[str, ...], ...], list[str]] = {}
    said = list(frame.drop(columns="case").astype(str).itertuples(index=False, name=None))
    for case, places in _places(frame.case).items():
        groups.setdefault(tuple(said[k] for k in places), []).append(case)
    if len(groups) == frame.case.nunique():
        return frame
    kept = frame[frame.case.isin([cases[0] for cases in groups.values()])]
    whole = len(groups) == 1
    names = {cases[0]: f"all {len(cases)} cases" if whole else "; ".join(cases) for cases in groups.values()}
    return kept.assign(case=kept.case.map(names))


def of(metric: str, nothing: str = "") -> Callable[[Callable[[Tables, pd.DataFrame], list[Block]]], Blocks]:
    """Make the blocks of a function from the rows of a metric; without rows they are the text `nothing`, or none."""

    def decorate(make: Callable[[Tables, pd.DataFrame], list[Block]]) -> Blocks:
        @wraps(make)
        def section(tables: Tables) -> list[Block]:
            frame = METRICS[metric](tables)
            if len(frame):
                return make(tables, frame)
            return [Text(nothing, is_nothing=True)] if nothing else []

        return section

    return decorate


def stated(name: str, frame: pd.DataFrame, alike: bool = False, **content: str) -> Table:
    """Return a frame as the table of that name in `templates/texts.toml`.

    Its columns are chosen (see `blocks.shown`) or get other headings; braces of its caption are filled with content.
    alike: cases that have the same rows stand once.
    """
    found = texts()["tables"][name]
    if "columns" in found:
        frame = shown(frame, " ".join(found["columns"].split()))
    else:
        frame = frame.set_axis(" ".join(found["headings"].split()).split(" | "), axis=1)
    caption = " ".join(found.get("caption", "").split()).format(**content)
    return table(same_once(frame) if alike else frame, caption)


def chosen_cases(tables: Tables) -> dict[str, str]:
    """Return digest and label of the cases that get figures of their own, in the order of the plan."""
    if len(tables.labels) <= MOST_CASES:
        return tables.labels
    order = [*key_cases(tables), *METRICS["ranking"](tables).case]
    kept = list(dict.fromkeys(order))[:MOST_CASES]
    return {case: label for case, label in tables.labels.items() if label in kept}


def deciding(tables: Tables) -> tuple[list[str], list[str]]:
    """Return the cases (digests) and the quantities that requirements are decided by: those of the open sections.

    Without requirements the best case, and all quantities.
    """
    asked = [
        split_metric(str(one["metric"]))[0].removeprefix("normalised_")
        for one in tables.campaign.get("requirements") or ()
    ]
    known = [quantity for quantity in NAVIGATION if (quantity, "3d") in tables.people]
    labels = list(key_cases(tables)) or list(METRICS["ranking"](tables).case[:1])
    digests = {label: case for case, label in tables.labels.items()}
    return [digests[label] for label in labels], [one for one in known if one in asked] or known


def left_out(tables: Tables) -> list[Block]:
    """Say that cases are left out, where some are."""
    more = len(tables.labels) - len(chosen_cases(tables))
    text = f"The decisive cases and the best ones are shown, {MOST_CASES} in all; {more} more are in the tables."
    return [Text(text)] if more > 0 else []


def distinct(tables: Tables, name: str, columns: Sequence[str], cases: Iterable[str]) -> list[str]:
    """Return one of these cases for each group whose rows of a table are the same."""
    frame, first = getattr(tables, name), dict[bytes, str]()
    values = [_numbers(frame[column]) for column in columns]
    places = _places(frame.case)
    for case in cases:
        at = places.get(case, np.empty(0, dtype=int))
        said = b"".join(column[at].tobytes() for column in values)
        first.setdefault(hashlib.sha256(said).digest(), case)
    return list(first.values())


def _places(cases: pd.Series) -> dict[str, Any]:
    """Return the places (n_row,) of the rows of each case, the case first that stands first."""
    return {str(case): places for case, places in cases.groupby(cases, sort=False).indices.items()}


def _numbers(column: pd.Series) -> Any:
    """Return numbers (n_row,) as they are, texts as numbers that are the same where the texts are."""
    return column.to_numpy() if pd.api.types.is_numeric_dtype(column) else pd.factorize(column)[0]


def few(group: Sequence[str]) -> tuple[Sequence[str], list[Block]]:
    """Return no more cases than are drawn, and what to say then."""
    more = len(group) - MOST_CASES
    said: list[Block] = [Text(f"{more} more cases that differ here are in the tables.")] if more > 0 else []
    return group[:MOST_CASES], said


def named(tables: Tables, case: str, cases: Sequence[str]) -> str:
    """Return the label of a case as a sentence where a figure does not stand for all cases."""
    return f" {tables.labels[case]}." if len(cases) > 1 else ""


def figures(tables: Tables, plot: str, cases: Sequence[str], **content: str) -> list[Block]:
    """Return a figure of each case, numbered; the caption names it where there are several."""
    return [
        Picture(
            f"{plot}-{k}",
            PLOTS[plot](tables, case),
            note(plot, "figures", **content) + named(tables, case, cases),
        )
        for k, case in enumerate(cases, 1)
    ]


def figure(tables: Tables, plot: str, *about: str, name: str = "", **content: str) -> Picture:
    """Return a figure of a case, a quantity or both, named by them and by its plot, or by `name` in its place.

    Its caption is the one of that name in `templates/texts.toml`, braces filled with label, quantity and content.
    """
    case, quantity = (about[0], about[-1]) if about else ("", "")
    content |= {"label": tables.labels.get(case, ""), "quantity": quantity, "Quantity": quantity.capitalize()}
    caption = note(name or plot, "figures", **content)
    return Picture("-".join((name or plot, *about)), PLOTS[plot](tables, *about), caption)
