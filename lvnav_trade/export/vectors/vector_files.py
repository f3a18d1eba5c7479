"""Files of reference vectors: tables as CSV or Parquet, units of their columns, the case, a README."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import pandas as pd

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.syntax.tree import dump
from lvnav_trade.export.vectors.vector_tables import VectorTable, vectors_of
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare

Format = Literal["csv", "parquet"]
_MARKUP = re.compile(r"[\\`*_<>\[\]#!|~&]")  # Markdown characters, which are escaped in names
_LARGEST_RUN = 2**63


@dataclass(frozen=True)
class ReferenceVectors:
    """Inputs and expected outputs of a filter in one run.

    Attributes
    ----------
    tables : dict of str to pandas.DataFrame
        Tables by name: imu, windows, epochs, measurements, antennas, satellites, states, model, estimates, covariance;
        depending on the case sensors and reported_covariance. SI units, in the names of the columns.
    columns : pandas.DataFrame
        Unit and meaning of every column: table, column, unit, meaning.
    files : dict of str to bytes or str
        Content of the files by name.
    run : int
        Number of the run.
    """

    tables: dict[str, pd.DataFrame]
    columns: pd.DataFrame
    files: dict[str, bytes | str]
    run: int


def reference_vectors(campaign: Campaign, case: Case, run: int, file_format: str) -> ReferenceVectors:
    """Return the reference vectors of one run of a case.

    Parameters
    ----------
    campaign : Campaign
        The campaign; its seed determines the random draws.
    case : Case
        One of its cases.
    run : int
        Number of the run, from 0.
    file_format : {"csv", "parquet"}
        Format of the tables.

    Returns
    -------
    ReferenceVectors
        Tables, columns, content of the files.

    Raises
    ------
    InputError
        The run or the format does not exist, or as `vectors_of`.
    """
    if not 0 <= run < _LARGEST_RUN:
        raise InputError(f"run {run}: runs are numbered from 0")
    if file_format not in get_args(Format):
        raise InputError(f"format {file_format!r}: should be csv or parquet")
    prepared_case = prepare(case.scenario)
    tables = vectors_of(prepared_case, campaign.seed, run)
    columns = _column_table(tables)
    title = f"Case {case.label} ({case.id}) of the campaign {campaign.name}, seed {campaign.seed}, run {run}."
    title = _MARKUP.sub(r"\\\g<0>", " ".join(title.split()))
    files: dict[str, bytes | str] = {
        f"{name}.{file_format}": _table_content(table.frame, file_format) for name, table in tables.items()
    }
    files["columns.csv"] = columns.to_csv(index=False)
    files["case.yaml"] = dump(case.scenario.model_dump(mode="json", exclude_none=True))
    files["README.md"] = _readme(title, tables, file_format, prepared_case)
    return ReferenceVectors(
        tables={name: table.frame for name, table in tables.items()},
        columns=columns,
        files=files,
        run=run,
    )


def _column_table(tables: Mapping[str, VectorTable]) -> pd.DataFrame:
    """Return table, name, unit and meaning of every column."""
    rows = []
    for table_name, table in tables.items():
        for name, (unit, meaning) in table.columns.items():
            rows.append((table_name, name, unit, meaning))
    return pd.DataFrame(rows, columns=["table", "column", "unit", "meaning"])


def _table_content(frame: pd.DataFrame, file_format: str) -> bytes | str:
    """Return a table as a file; CSV has enough digits to restore the same double."""
    if file_format == "csv":
        return str(frame.to_csv(index=False))
    buffer = io.BytesIO()
    frame.to_parquet(buffer, index=False)
    return buffer.getvalue()


def _readme(title: str, tables: Mapping[str, VectorTable], file_format: str, prepared_case: PreparedCase) -> str:
    """Return the README with the description and use of the tables.

    title : title of the README
    tables : tables by name
    file_format : file name extension of the tables, "csv" or "parquet"
    """
    rows = [f"| `{name}.{file_format}` | {table.description} | {len(table.frame)} |" for name, table in tables.items()]
    filter_card = prepared_case.scenario.filter
    notes = [_OPEN if filter_card.feedback == "open" else _CLOSED]
    if prepared_case.model.excess_density is not None:
        gyro, accel = prepared_case.model.excess_density
        notes.append(_UNEVEN.format(gyro=_axis_values(gyro), accel=_axis_values(accel)))
    if filter_card.gains is not None:
        notes.append(_GAINS)
    if "reported_covariance" in tables:
        notes.append(_WHITENED)
    if prepared_case.options.delay_processing is not None:
        notes.append(_LATE)
    return _README.format(title=title, tables="\n".join(rows), notes="\n".join(notes))


def _axis_values(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.17g}" for value in values)


_README = """# Reference vectors of a navigation filter

{title}

Inputs and expected outputs of one simulated run, to test another implementation of the filter. All numbers are doubles
in SI units; `columns.csv` states unit and meaning of every column. `case.yaml` is the case: filter, sensors, lever arms
and initial errors, in the units that the engineer wrote.

| file | content | rows |
| --- | --- | ---: |
{tables}

## Conventions

Frame i is Earth-centred inertial; frame b is body-fixed. A quaternion rotates from b to i, scalar first. An error is
truth minus estimate; the attitude error is the small rotation in frame i that is applied to the estimated attitude
from the left. An empty cell is not-a-number.

## Use

1. Start from the rows `start` of `estimates` and `covariance`.
2. For every window take its samples from `imu` (`first_tick`, `n_tick`), correct them with the estimated IMU
   parameters, and propagate attitude, velocity and position. Propagate the covariance: P <- Phi (P + Q/2) Phi' + Q/2,
   where Q is diagonal with `noise_si` of `model`.
3. At the window's epoch compare with the rows `before`. Process the epoch's `measurements` one by one in the order of
   the table: innovation, gate, gain, update. All are linearised at the estimate `before`, unless the filter is direct
   or iterated (`case.yaml`). The body rate at an antenna is that of the last IMU sample, corrected. Compare
   `innovation_ratio` and the rows `after`.

Reasonable tolerances are relative to the standard deviations in `covariance`: 1e-6 of a sigma for the estimates of the
same algorithm in double precision.

## Notes on this case

{notes}
"""
_CLOSED = (
    "- The loop is closed: after the measurements of an epoch the error state is added to the estimates and set to\n"
    "  zero, so it is not listed."
)
_OPEN = (
    "- The loop is open: attitude, velocity, position and parameters are those of the inertial system; the corrected\n"
    "  outputs are their sum with the columns `error_...` of `estimates`."
)
_UNEVEN = (
    "- White noise differs by body axis. Before and after the transition add C diag(q) C' times half of the window's\n"
    "  length to the attitude block (q = {gyro} rad^2/s) and to the velocity block (q = {accel} m^2/s^3), with C the\n"
    "  window's mean rotation from b to i."
)
_GAINS = "- The gains are stored (filter.gains in `case.yaml`); the covariance has no part in them."
_LATE = (
    "- Measurements are late by `delay_s` of `epochs`; the filter compensates as `filter.delay_compensation` states.\n"
    "  An extrapolated solution is decorrelated after its extrapolation, and the ratios are those of the scalars then."
)
_WHITENED = (
    "- A solution of the receiver is decorrelated by its reported covariance before it is processed; the ratios are\n"
    "  those of the decorrelated scalars."
)
