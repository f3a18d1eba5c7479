"""Rows of a table by conditions that a user writes, such as ``velocity < 0.1 m/s and imu == tactical_fog``."""

import re
from collections.abc import Iterator, Sequence

import pandas as pd

from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.decimals import DECIMAL
from lvnav_trade.errors import InputError, quoted
from lvnav_trade.store.schema import unit_at_end
from lvnav_trade.units import parse

_LENGTH = 1_000
_TOKEN = re.compile(
    rf"\s*(?:(?P<text>'[^']*'|\"[^\"]*\")|(?P<number>{DECIMAL})|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<comparison><=|>=|==|!=|<|>)|(?P<sign>[-+*/(),]))"
)
_UNIT = re.compile(r"\s+(?!(?:and|or|not|in)\b)(?P<unit>[^\W\d][^\s<>=!,]*|[%\u00b0][^\s<>=!,]*)")
_WORD = re.compile(r"\s*(?P<word>[\w#.+%-]+)")
_JOINING = ("and", "or", "not", "in")


def column_named(name: str, frame: pd.DataFrame) -> str:
    """Return the column of a name, from which ``axis_`` and the unit at its end may be left out.

    InputError where no column, or several, have it.
    """
    columns = [str(one) for one in frame.columns]
    if name in columns:
        return name
    fitting = [one for one in columns if name in (one.removeprefix("axis_"), *_shortened(one))]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise InputError(f"{quoted(name)} fits several columns: {', '.join(fitting)}")
    known = dict.fromkeys(min((one, *_shortened(one)), key=len) for one in columns)
    raise InputError(f"no column {quoted(name)}{hint(name, list(known))}; there are {', '.join(known)}")


def _shortened(column: str) -> tuple[str, ...]:
    """Return the names of a column without its unit, with and without ``axis_``."""
    bare = unit_at_end(column)[0].removesuffix("_count").removesuffix("_number")
    return bare, bare.removeprefix("axis_")


def chosen(frame: pd.DataFrame, conditions: Sequence[str]) -> pd.DataFrame:
    """Return the rows for which every condition holds.

    A condition compares columns, numbers, quantities (``0.1 deg``) and words, joined by ``and``, ``or``, ``not`` and
    brackets. A number without a unit is in SI. InputError where it is none.
    """
    for condition in conditions:
        if len(condition) > _LENGTH:
            raise InputError(f"{quoted(condition)}: {len(condition)} characters; at most {_LENGTH}")
        whole = " ".join(_translated(condition, frame))
        try:
            kept = frame.eval(whole, engine="python")
        except Exception as error:  # pandas raises whatever its parser meets
            why = str(error).strip().partition("\n")[0]
            raise InputError(f"{quoted(condition)} is no condition such as 'velocity < 0.1 m/s' ({why})") from None
        if not isinstance(kept, pd.Series) or kept.dtype != bool:
            raise InputError(f"{quoted(condition)} compares nothing; write a condition such as 'velocity < 0.1 m/s'")
        frame = frame[kept]
    return frame.reset_index(drop=True)


def _translated(condition: str, frame: pd.DataFrame) -> Iterator[str]:
    """Yield the parts of a condition for pandas: names of columns, numbers in SI, words in quotation marks.

    What a condition may have is listed here, so that nothing else reaches pandas: no attribute, no call.
    """
    at, column, compared = 0, "", False
    while condition[at:].strip():
        if compared and column and _is_text(frame, column):
            found = _WORD.match(condition, at)
            if found is not None and found["word"] not in map(str, frame.columns):
                yield repr(found["word"])
                at, compared = found.end(), False
                continue
        found = _TOKEN.match(condition, at)
        if found is None:
            raise InputError(f"{quoted(condition)}: {quoted(condition[at:].strip())} has no meaning in a condition")
        at, compared = found.end(), bool(found["comparison"])
        if found["name"] and found["name"] not in _JOINING:
            if condition[at:].lstrip().startswith("("):
                raise InputError(f"{quoted(condition)}: {found['name']}() has no meaning in a condition")
            column = column_named(found["name"], frame)
            yield column
        elif found["number"] and (unit := _UNIT.match(condition, at)) is not None:
            yield repr(_quantity(f"{found['number']} {unit['unit'].rstrip(')')}", column))
            at = unit.start("unit") + len(unit["unit"].rstrip(")"))
        else:
            yield found[0].strip()


def _is_text(frame: pd.DataFrame, column: str) -> bool:
    return not pd.api.types.is_numeric_dtype(frame[column])


def _quantity(text: str, column: str) -> float:
    """Return a quantity in the unit of the column that it is compared with; InputError where that is another one."""
    unit = unit_at_end(column)[1]
    if not unit:
        raise InputError(f"{quoted(text)}: {column or 'what it is compared with'} has no unit")
    try:
        return parse(text, unit)
    except ValueError as error:
        raise InputError(f"{column}: {error}") from None


def ordered(frame: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Return the rows by columns, smallest first; those of a name that begins with ``-`` largest first."""
    for name in reversed(by):
        column = column_named(name.removeprefix("-"), frame)
        frame = frame.sort_values(column, ascending=not name.startswith("-"), kind="stable")
    return frame.reset_index(drop=True)
