"""Cases and rows of tables that a user names: by digest or label, or by conditions such as ``velocity < 0.1 m/s``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load as load_campaign
from lvnav_trade.campaign.running.replay import find
from lvnav_trade.campaign.space.numbered_designs import DesignSpace, number_in
from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.input_files import DECIMAL
from lvnav_trade.quantities.units import parse
from lvnav_trade.results.tables.dictionary import unit_at_end

_LENGTH = 1_000
_TOKEN = re.compile(
    rf"\s*(?:(?P<text>'[^']*'|\"[^\"]*\")|(?P<number>{DECIMAL})|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<comparison><=|>=|==|!=|<|>)|(?P<sign>[-+*/(),]))"
)
_UNIT = re.compile(r"\s+(?!(?:and|or|not|in)\b)(?P<unit>[^\W\d][^\s<>=!,]*|[%\u00b0][^\s<>=!,]*)")
_WORD = re.compile(r"\s*(?P<word>[\w#.+%-]+)")
_OPERATORS = ("and", "or", "not", "in")


def column_named(name: str, frame: pd.DataFrame) -> str:
    """Return the full name of a column.

    Parameters
    ----------
    name : str
        Name of a column; ``axis_`` at its beginning and the unit at its end may be omitted.
    frame : pandas.DataFrame
        Table with the columns.

    Returns
    -------
    str
        Name of the column in the table.

    Raises
    ------
    InputError
        The name fits no column, or several.
    """
    columns = [str(column) for column in frame.columns]
    if name in columns:
        return name
    fitting = [column for column in columns if name in (column.removeprefix("axis_"), *_short_names(column))]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise InputError(f"{quoted(name)} fits several columns: {', '.join(fitting)}")
    shortest = dict.fromkeys(min((column, *_short_names(column)), key=len) for column in columns)
    raise InputError(f"no column {quoted(name)}{hint(name, list(shortest))}; there are {', '.join(shortest)}")


def _short_names(column: str) -> tuple[str, ...]:
    """Return the names of a column without its unit, with and without ``axis_``."""
    name, _ = unit_at_end(column)
    name = name.removesuffix("_count").removesuffix("_number")
    return name, name.removeprefix("axis_")


def select_rows(frame: pd.DataFrame, conditions: Sequence[str]) -> pd.DataFrame:
    """Return the rows that satisfy every condition.

    Parameters
    ----------
    frame : pandas.DataFrame
        Table, numbers in SI.
    conditions : sequence of str
        Comparisons of columns, numbers, quantities (``0.1 deg``) and words, joined by ``and``, ``or``, ``not`` and
        parentheses. A number without a unit is in SI.

    Returns
    -------
    pandas.DataFrame
        The rows, numbered from 0.

    Raises
    ------
    InputError
        A text is not a condition, or its units do not fit those of the column.
    """
    for condition in conditions:
        if len(condition) > _LENGTH:
            raise InputError(f"{quoted(condition)}: {len(condition)} characters; at most {_LENGTH}")
        expression = " ".join(_pandas_tokens(condition, frame))
        try:
            is_selected = frame.eval(expression, engine="python")
        except Exception as error:  # pandas raises whatever its parser meets
            reason = str(error).strip().partition("\n")[0]
            raise InputError(f"{quoted(condition)} is no condition such as 'velocity < 0.1 m/s' ({reason})") from None
        if not isinstance(is_selected, pd.Series) or is_selected.dtype != bool:
            raise InputError(f"{quoted(condition)} compares nothing; write a condition such as 'velocity < 0.1 m/s'")
        frame = frame[is_selected]
    return frame.reset_index(drop=True)


def _pandas_tokens(condition: str, frame: pd.DataFrame) -> Iterator[str]:
    """Yield the tokens of a condition for pandas: names of columns, numbers in SI, words in quotation marks.

    Only the tokens listed here are passed on. Attributes and calls are refused, since `DataFrame.eval` would run them.
    """
    position = 0
    column = ""  # last named column
    after_comparison = False
    while condition[position:].strip():
        if after_comparison and column and _is_text(frame, column):
            # a word compared with a text column is a value unless it names a column itself
            word = _WORD.match(condition, position)
            if word is not None and word["word"] not in map(str, frame.columns):
                yield repr(word["word"])
                position = word.end()
                after_comparison = False
                continue
        token = _TOKEN.match(condition, position)
        if token is None:
            remaining_text = condition[position:].strip()
            raise InputError(f"{quoted(condition)}: {quoted(remaining_text)} has no meaning in a condition")
        position = token.end()
        after_comparison = bool(token["comparison"])
        unit = _UNIT.match(condition, position) if token["number"] else None
        if token["name"] and token["name"] not in _OPERATORS:
            if condition[position:].lstrip().startswith("("):
                raise InputError(f"{quoted(condition)}: {token['name']}() has no meaning in a condition")
            column = column_named(token["name"], frame)
            yield column
        elif unit is not None:
            unit_text = unit["unit"].rstrip(")")  # parentheses are tokens of the condition
            yield repr(_si_number(f"{token['number']} {unit_text}", column))
            position = unit.start("unit") + len(unit_text)
        else:
            yield token[0].strip()


def _is_text(frame: pd.DataFrame, column: str) -> bool:
    return not pd.api.types.is_numeric_dtype(frame[column])


def _si_number(text: str, column: str) -> float:
    """Return a quantity in the unit of the compared column; InputError if the dimensions differ."""
    _, unit = unit_at_end(column)
    if not unit:
        raise InputError(f"{quoted(text)}: {column or 'the other side of the comparison'} has no unit")
    try:
        return parse(text, unit)
    except ValueError as error:
        raise InputError(f"{column}: {error}") from None


def sort_rows(frame: pd.DataFrame, columns: Sequence[str]) -> pd.DataFrame:
    """Sort a table.

    Parameters
    ----------
    frame : pandas.DataFrame
        Table to sort.
    columns : sequence of str
        Columns in order of priority, smallest value first; a leading ``-`` puts the largest value first.

    Returns
    -------
    pandas.DataFrame
        The sorted rows, numbered from 0.

    Raises
    ------
    InputError
        A name fits no column, or several.
    """
    for name in reversed(columns):
        column = column_named(name.removeprefix("-"), frame)
        frame = frame.sort_values(column, ascending=not name.startswith("-"), kind="stable")
    return frame.reset_index(drop=True)


_DIGITS = 6  # fewest digits of a digest that identify one of many designs


def case_of(campaign: str | Path | Campaign, sets: Sequence[str], case: str | None) -> tuple[Campaign, Case]:
    """Return a campaign and one of its cases.

    Parameters
    ----------
    campaign : str, Path or Campaign
        Campaign file, name of a campaign that comes with the tool, or a loaded one.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``. They apply to a file and not to a loaded campaign.
    case : str or None
        Label of the case, its digest, or the first digits of its digest; the first case if None.

    Returns
    -------
    Campaign, Case
        The campaign and the case.

    Raises
    ------
    InputError
        The campaign has an input error, or the text fits no case or several.
    """
    loaded_campaign = campaign if isinstance(campaign, Campaign) else load_campaign(campaign, sets)
    if loaded_campaign.is_space:
        return loaded_campaign, _find_design(DesignSpace(loaded_campaign), case)
    all_cases = cases(loaded_campaign)
    if case:
        return loaded_campaign, find(all_cases, case)
    return loaded_campaign, all_cases[0]


def _find_design(designs: DesignSpace, name: str | None) -> Case:
    """Return the design with a digest, its first digits, or a label (``design 12``); the first design if None."""
    number = None if name is None else number_in(name)
    if number is not None and number < len(designs):
        return designs.case(number)
    for case in designs.cases():
        if name is None or case.label == name:
            return case
        if len(name) >= _DIGITS and case.id.startswith(name):
            return case
    raise InputError(f"no case {name!r} among {len(designs)} designs; give {_DIGITS} digits of its digest or more")
