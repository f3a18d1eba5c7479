"""Reading results back: tidy pandas frames, manifest, resolved campaign; indexed row lookup and cached metrics."""

from __future__ import annotations

import json
import os
import weakref
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from ruamel.yaml.error import YAMLError

from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.input_files import read_bytes, refuse_irregular
from lvnav_trade.results.tables.contents import damaged_file_error, is_without_rows, read_manifest, refuse_changed
from lvnav_trade.results.tables.dictionary import OF_OUTPUTS, TABLES, arrow_schema
from lvnav_trade.results.tables.earlier_names import names_of, stored_names
from lvnav_trade.results.tables.versions import parse_resolved

if TYPE_CHECKING:
    import pandas as pd

PLACES: dict[int, dict[tuple[str, ...], dict[Any, Any]]] = {}
"""Index of stored tables: by identity of the frame and by columns, the positions of the rows with given values."""
_RESOLVED_BYTES = 2**26  # limit, far above the size of the largest resolved campaign


class Tables:
    """Results of one campaign; each table of `dictionary.TABLES` is an attribute, which is read on first use.

    Attributes
    ----------
    folder : Path
        Folder of the results.
    cache : dict
        Results of metrics computed from the tables.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.cache: dict[tuple[str, ...], Any] = {}
        self._read: dict[str, pd.DataFrame] = {}

    @classmethod
    def from_arrow(cls, tables: Mapping[str, pa.Table], campaign: Mapping[str, Any] | None = None) -> Tables:
        """Return tables in memory, without a folder; campaign: the resolved campaign, if known."""
        memory_tables = cls(Path())
        if campaign is not None:
            memory_tables.__dict__["campaign"] = dict(campaign)
        memory_tables._read = {name: table.to_pandas() for name, table in tables.items()}
        return memory_tables

    def with_frames(self, **frames: pd.DataFrame) -> Tables:
        """Return the results with some tables replaced by other frames."""
        new_tables = Tables(self.folder)
        new_tables._read = self._read | frames
        new_tables.__dict__ |= {name: self.__dict__[name] for name in ("campaign", "manifest") if name in self.__dict__}
        return new_tables

    def __getattr__(self, name: str) -> pd.DataFrame:
        if name not in TABLES:
            raise AttributeError(name)
        if name not in self._read:
            table = _complete_table(name, stored_table(self.folder, name))
            self._read[name] = table.combine_chunks().to_pandas()  # one chunk, since lookups are not case by case
        frame = self._read[name]
        if id(frame) not in PLACES:
            PLACES[id(frame)] = {}
            weakref.finalize(frame, PLACES.pop, id(frame), None).atexit = False
        return frame

    @property
    def has_designs(self) -> bool:
        """Whether the results are those of a design space, with one row per design."""
        return "designs" in self._read or (self.folder / "designs.parquet").is_file()

    @property
    def is_sampled(self) -> bool:
        """Whether the designs were drawn at random, so that they represent all designs within the limits."""
        return self.campaign.get("design") in ("latin_hypercube", "sobol")

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Manifest: request, versions and machine of the results."""
        return read_manifest(self.folder / "manifest.json")

    @cached_property
    def campaign(self) -> dict[str, Any]:
        """The resolved campaign, all defaults filled in."""
        path = self.folder / "campaign.resolved.yaml"
        refuse_changed(path)
        try:
            tree = dict(parse_resolved(read_bytes(path, _RESOLVED_BYTES).decode()))
        except (YAMLError, ValueError, TypeError, AttributeError, RecursionError) as error:
            raise damaged_file_error(path, error) from None
        return tree

    @cached_property
    def labels(self) -> dict[str, str]:
        """Label by digest of the case, in the order of the plan; equal labels are extended by the digest."""
        cases = self.cases
        repeated_labels = set(cases.label[cases.label.duplicated()])
        labels = {}
        for case, label in zip(cases.case, cases.label, strict=True):
            labels[case] = f"{label} [{case}]" if label in repeated_labels else label
        return labels

    @cached_property
    def levels(self) -> dict[str, dict[str, str]]:
        """Level of every axis by digest of the case, in the order of the plan."""
        axes_by_case = zip(self.cases.case, self.cases["axes"], strict=True)
        return {case: json.loads(axes) for case, axes in axes_by_case}

    @cached_property
    def display_units(self) -> dict[tuple[str, str], tuple[str, float]]:
        """Display unit and factor from SI to it, by quantity and axis."""
        display_units = {}
        for row in self.outputs.drop_duplicates(["quantity", "axis"]).itertuples(index=False):
            display_units[row.quantity, row.axis] = (row.label_unit, row.label_factor_ratio)
        return display_units


def _complete_table(name: str, table: pa.Table) -> pa.Table:
    """Return a table with every column of its schema; columns that an earlier version did not write are empty."""
    for field in arrow_schema(name):
        if field.name not in table.column_names:
            table = table.append_column(field, pa.nulls(table.num_rows, field.type))
    return table


def _is_compatible(stored_type: pa.DataType, expected_type: pa.DataType) -> bool:
    """Whether two types are both numbers, texts or truth values; their widths may differ."""
    if pa.types.is_dictionary(stored_type):
        stored_type = stored_type.value_type
    if pa.types.is_null(stored_type):
        return True
    return _type_class(stored_type) == _type_class(expected_type)


def _type_class(data_type: pa.DataType) -> str:
    """Return whether a type is that of texts, numbers or truth values; their widths may differ."""
    if pa.types.is_string(data_type) or pa.types.is_large_string(data_type):
        return "text"
    if pa.types.is_floating(data_type):
        return "real"
    if pa.types.is_integer(data_type):
        return "integer"
    if pa.types.is_boolean(data_type):
        return "boolean"
    return "other"


def load(results: Path | str | Tables) -> Tables:
    """Load the tables of a folder of results.

    Parameters
    ----------
    results : Path, str or Tables
        Folder of results; tables are returned unchanged.

    Returns
    -------
    Tables
        Tables, read on first use.

    Raises
    ------
    InputError
        The folder has no results, or of a version that cannot be read, or the campaign has not finished.
    """
    if isinstance(results, Tables):
        return results
    folder = Path(results)
    if not (folder / "manifest.json").exists():
        raise InputError(f"{folder}: no results here (no manifest.json)")
    refuse_irregular(folder)
    tables = Tables(folder)
    names_of(tables.manifest, folder / "manifest.json")
    if "created" in tables.manifest and "finished" not in tables.manifest:  # a kept base has neither
        raise InputError(f"{folder}: the campaign has not finished; the same lvnav-trade run goes on with it")
    return tables


def stored_table(folder: Path, name: str) -> pa.Table:
    """Read a table of a folder of results; a table without rows is not on disk and returned empty.

    The columns of results of the previous version get their present names.

    Raises an InputError if the table is missing or damaged, or a column has values of another type.
    """
    names = stored_names(folder)
    if is_without_rows(folder, names.table(name)):
        return _empty_table(folder, name)
    path = folder / f"{names.table(name)}.parquet"
    table = names.with_present_names(name, read_table(path))
    for field in arrow_schema(name):
        if field.name not in table.column_names:
            continue
        stored_type = table.schema.field(field.name).type
        if not _is_compatible(stored_type, field.type):
            column = quoted(names.column(name, field.name))
            raise damaged_file_error(path, f"the column {column} has values of type {stored_type}, not {field.type}")
    return table


def _empty_table(folder: Path, name: str) -> pa.Table:
    """Return a table without rows, with its columns of outputs."""
    column_names = OF_OUTPUTS.get(name, ())
    columns: dict[str, None] = {}
    if column_names:
        outputs = stored_table(folder, "outputs").to_pylist()  # empty as well if every case failed
        for column_name in column_names:
            for row in outputs:
                columns[column_name(row["quantity"], row["axis"], row["unit"])] = None
    return arrow_schema(name, tuple(columns)).empty_table()


def has_table(folder: Path, name: str) -> bool:
    """Whether `stored_table` finds a table, with or without rows."""
    stored_name = stored_names(folder).table(name)
    return is_without_rows(folder, stored_name) or (folder / f"{stored_name}.parquet").exists()


def read_table(path: Path) -> pa.Table:
    """Read a table of results, verifying its digest and the checksum of every page.

    Raises an InputError if the table is missing or damaged.
    """
    refuse_changed(path)
    try:
        return pq.read_table(path, page_checksum_verification=True)
    except FileNotFoundError:
        remedy = "a kept base has none, and of other results the same lvnav-trade run makes it again"
        raise InputError(f"{path}: this table is missing; {remedy}") from None
    except (OSError, pa.ArrowException, ValueError, MemoryError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise InputError(f"{path}: cannot be read: {os.strerror(error.errno)}") from None
        first_line = str(error).strip().partition("\n")[0]
        raise damaged_file_error(path, first_line or type(error).__name__) from None


_Result = TypeVar("_Result")  # frame or list


def cache_result(metric: Callable[..., _Result]) -> Callable[..., _Result]:
    """Return a function of tables (and of texts) that caches its result with the tables; each caller gets a copy."""

    @wraps(metric)
    def cached_metric(tables: Tables, *texts: str) -> _Result:
        key = (metric.__module__, metric.__qualname__, *texts)
        if key not in tables.cache:
            tables.cache[key] = metric(tables, *texts)
        result: Any = tables.cache[key]
        return result.copy()

    return cached_metric


def pick(rows: pd.DataFrame, **values: str) -> pd.DataFrame:
    """Return the rows of a table whose columns have the given values, by an index if the table is a stored one."""
    if id(rows) in PLACES:
        return rows.iloc[_row_positions(rows, values)]
    for column, value in values.items():
        rows = rows[rows[column] == value]
    return rows


def pick_columns(rows: pd.DataFrame, names: Sequence[str], **values: str) -> list[np.ndarray]:
    """Return columns (n,) of the rows that `pick` selects, without building a frame of all columns."""
    if not values:
        return [rows[name].to_numpy() for name in names]
    if id(rows) in PLACES:
        positions = _row_positions(rows, values)
        return [rows[name].to_numpy()[positions] for name in names]
    selected_rows = pick(rows, **values)
    return [selected_rows[name].to_numpy() for name in names]


def _row_positions(rows: pd.DataFrame, values: dict[str, str]) -> Any:
    """Return the positions (n,) in a stored table of the rows whose columns have the given values."""
    index = PLACES[id(rows)]
    columns = tuple(values)
    if columns not in index:
        index[columns] = rows.groupby(list(columns), sort=False).indices
    key = tuple(values.values())
    no_positions = np.empty(0, dtype=np.intp)
    # pandas has the key itself for a single column, and a tuple of keys for several
    return index[columns].get(key if len(key) > 1 else key[0], no_positions)
