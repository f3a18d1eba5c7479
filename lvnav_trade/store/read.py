"""Reading results back: tidy pandas frames, the manifest, the resolved campaign."""

from __future__ import annotations

import json
import os
import weakref
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq
from ruamel.yaml.error import YAMLError

from lvnav_trade.errors import InputError, quoted
from lvnav_trade.input_files import read_bytes, refuse_irregular
from lvnav_trade.store.contents import is_without_rows
from lvnav_trade.store.manifest import damaged, read_manifest, refuse_changed
from lvnav_trade.store.schema import OF_OUTPUTS, TABLES, arrow_schema
from lvnav_trade.store.versions import parsed

if TYPE_CHECKING:
    import pandas as pd

PLACES: dict[int, dict[tuple[str, ...], dict[Any, Any]]] = {}
"""Where the rows of values stand in a frame that is a table, by its identity and the columns; filled when asked for."""
_RESOLVED_BYTES = 2**26  # far beyond what a resolved campaign of the largest size has


class Tables:
    """The results of one campaign; each table of `schema.TABLES` is an attribute, read when first asked for.

    cache: frames that metrics have computed from them.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.cache: dict[tuple[str, ...], Any] = {}
        self._read: dict[str, pd.DataFrame] = {}

    @classmethod
    def of(cls, tables: Mapping[str, pa.Table], campaign: Mapping[str, Any] | None = None) -> Tables:
        """Return tables that are in memory, without a folder; campaign: the resolved one, where it is known."""
        found = cls(Path())
        if campaign is not None:
            found.__dict__["campaign"] = dict(campaign)
        found._read = {name: table.to_pandas() for name, table in tables.items()}
        return found

    def with_frames(self, **frames: pd.DataFrame) -> Tables:
        """Return the same results with other frames in the place of some tables."""
        found = Tables(self.folder)
        found._read = self._read | frames
        found.__dict__ |= {name: self.__dict__[name] for name in ("campaign", "manifest") if name in self.__dict__}
        return found

    def __getattr__(self, name: str) -> pd.DataFrame:
        if name not in TABLES:
            raise AttributeError(name)
        if name not in self._read:
            table = _whole(name, stored_table(self.folder, name))
            self._read[name] = table.combine_chunks().to_pandas()  # rows are looked up in one piece, not case by case
        frame = self._read[name]
        if id(frame) not in PLACES:
            PLACES[id(frame)] = {}
            weakref.finalize(frame, PLACES.pop, id(frame), None).atexit = False
        return frame

    @property
    def has_designs(self) -> bool:
        """Whether the results hold one row for each of many designs."""
        return "designs" in self._read or (self.folder / "designs.parquet").is_file()

    @property
    def is_sampled(self) -> bool:
        """Whether the designs were drawn at random, so that they stand for all others between the same limits."""
        return self.campaign.get("design") in ("latin_hypercube", "sobol")

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """What computed the results."""
        return read_manifest(self.folder / "manifest.json")

    @cached_property
    def campaign(self) -> dict[str, Any]:
        """The resolved campaign, all defaults filled in."""
        path = self.folder / "campaign.resolved.yaml"
        refuse_changed(path)
        try:
            found = dict(parsed(read_bytes(path, _RESOLVED_BYTES).decode()))
        except (YAMLError, ValueError, TypeError, AttributeError, RecursionError) as error:
            raise damaged(path, error) from None
        return found

    @cached_property
    def labels(self) -> dict[str, str]:
        """Case digest to label, in the order of the plan; a label that two cases share carries the digest too."""
        cases = self.cases
        twice = set(cases.label[cases.label.duplicated()])
        return {
            case: f"{label} [{case}]" if label in twice else label
            for case, label in zip(cases.case, cases.label, strict=True)
        }

    @cached_property
    def levels(self) -> dict[str, dict[str, str]]:
        """Level of every axis by case digest, in the order of the plan."""
        return {case: json.loads(axes) for case, axes in zip(self.cases.case, self.cases["axes"], strict=True)}

    @cached_property
    def people(self) -> dict[tuple[str, str], tuple[str, float]]:
        """Unit for people and its factor per SI unit, by (quantity, axis)."""
        rows = self.outputs.drop_duplicates(["quantity", "axis"])
        return {
            (row.quantity, row.axis): (row.label_unit, row.label_factor_ratio) for row in rows.itertuples(index=False)
        }


def _whole(name: str, table: pa.Table) -> pa.Table:
    """Return a table with every column of its schema; one that an earlier version did not write is empty."""
    for field in arrow_schema(name):
        if field.name not in table.column_names:
            table = table.append_column(field, pa.nulls(table.num_rows, field.type))
    return table


def _is_of_kind(held: pa.DataType, wanted: pa.DataType) -> bool:
    """Whether values of a type are numbers, texts or switches as those of another: the widths may differ."""
    if pa.types.is_dictionary(held):
        held = held.value_type
    kinds = (pa.types.is_floating, pa.types.is_integer, pa.types.is_boolean)
    is_text = [pa.types.is_string(kind) or pa.types.is_large_string(kind) for kind in (held, wanted)]
    return pa.types.is_null(held) or (is_text[0] == is_text[1] and all(of(held) == of(wanted) for of in kinds))


def load(results: Path | str | Tables) -> Tables:
    """Return the tables of a results folder; InputError where there is none. Tables are handed through."""
    if isinstance(results, Tables):
        return results
    folder = Path(results)
    if not (folder / "manifest.json").exists():
        raise InputError(f"{folder}: no results here (no manifest.json)")
    refuse_irregular(folder)
    tables = Tables(folder)
    if "created" in tables.manifest and "finished" not in tables.manifest:  # a kept base has neither
        raise InputError(f"{folder}: the campaign has not finished; the same lvnav-trade run goes on with it")
    return tables


def stored_table(folder: Path, name: str) -> pa.Table:
    """Return a table of a results folder; without rows where it was not written for lack of them. InputError as of
    `read_table`.
    """
    if not is_without_rows(folder, name):
        path = folder / f"{name}.parquet"
        found = read_table(path)
        for field in arrow_schema(name):
            held = found.schema.field(field.name).type if field.name in found.column_names else field.type
            if not _is_of_kind(held, field.type):
                raise damaged(path, f"the column {quoted(field.name)} has values of type {held}, not {field.type}")
        return found
    kinds = OF_OUTPUTS.get(name, ())
    outputs = stored_table(folder, "outputs").to_pylist() if kinds else []  # none either where every case failed
    every = {kind(row["quantity"], row["axis"], row["unit"]): None for kind in kinds for row in outputs}
    return arrow_schema(name, tuple(every)).empty_table()


def read_table(path: Path) -> pa.Table:
    """Return a table of results, held against its digest and every page against its checksum; InputError where it is
    missing or damaged.
    """
    refuse_changed(path)
    try:
        return pq.read_table(path, page_checksum_verification=True)
    except FileNotFoundError:
        why = "a kept base has none, and of other results the same lvnav-trade run makes it again"
        raise InputError(f"{path}: this table is missing; {why}") from None
    except (OSError, pa.ArrowException, ValueError, MemoryError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise InputError(f"{path}: cannot be read: {os.strerror(error.errno)}") from None
        why = str(error).strip().partition("\n")[0] or type(error).__name__
        raise damaged(path, why) from None
