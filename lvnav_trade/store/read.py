"""Reading results back: tidy pandas frames, the manifest, the resolved campaign."""

from __future__ import annotations

import json
import os
import weakref
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from lvnav_trade.errors import InputError
from lvnav_trade.store.contents import refuse_foreign
from lvnav_trade.store.schema import TABLES, arrow_schema
from lvnav_trade.store.versions import parsed

PLACES: dict[int, dict[tuple[str, ...], dict[Any, Any]]] = {}
"""Where the rows of values stand in a frame that is a table, by its identity and the columns; filled when asked for."""


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
            table = _whole(name, read_table(self.folder / f"{name}.parquet"))
            self._read[name] = table.combine_chunks().to_pandas()  # rows are looked up in one piece, not case by case
        frame = self._read[name]
        if id(frame) not in PLACES:
            PLACES[id(frame)] = {}
            weakref.finalize(frame, PLACES.pop, id(frame), None).atexit = False
        return frame

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """What computed the results."""
        path = self.folder / "manifest.json"
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise InputError(f"{path}: damaged: {error}") from None
        refuse_foreign(path, content)
        return content

    @cached_property
    def campaign(self) -> dict[str, Any]:
        """The resolved campaign, all defaults filled in."""
        text = (self.folder / "campaign.resolved.yaml").read_text(encoding="utf-8")
        return dict(parsed(text))

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


def load(results: Path | str | Tables) -> Tables:
    """Return the tables of a results folder; InputError where there is none. Tables are handed through."""
    if isinstance(results, Tables):
        return results
    folder = Path(results)
    if not (folder / "manifest.json").exists():
        raise InputError(f"{folder}: no results here (no manifest.json)")
    tables = Tables(folder)
    if "created" in tables.manifest and "finished" not in tables.manifest:  # a kept base has neither
        raise InputError(f"{folder}: the campaign has not finished; the same lvnav-trade run goes on with it")
    return tables


def read_table(path: Path) -> pa.Table:
    """Return a table of results, every page held against its checksum; InputError where it is missing or damaged."""
    try:
        return pq.read_table(path, page_checksum_verification=True)
    except FileNotFoundError:
        why = "a kept base has none, and of other results the same lvnav-trade run makes it again"
        raise InputError(f"{path}: this table is missing; {why}") from None
    except (OSError, pa.ArrowException, ValueError, MemoryError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise InputError(f"{path}: cannot be read: {os.strerror(error.errno)}") from None
        why = str(error).strip().partition("\n")[0] or type(error).__name__
        raise InputError(f"{path}: damaged: {why}; the same lvnav-trade run makes it again") from None
