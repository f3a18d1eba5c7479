"""Names of tables and columns in results of the previous version, which are read under their present names."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables.contents import MANIFEST, read_manifest
from lvnav_trade.results.tables.dictionary import COLUMNS_OF_VERSION_2, TABLES_OF_VERSION_2
from lvnav_trade.results.tables.versions import RESULTS_VERSION, results_version


class StoredNames(NamedTuple):
    """Names in a folder of results by the present names; a name that is missing is the same in both."""

    tables: Mapping[str, str]  # stored name by present name of a table
    columns: Mapping[str, Mapping[str, str]]  # stored name by present name of a column, for each table

    def table(self, name: str) -> str:
        """Return the stored name of a table, which is that of its file."""
        return self.tables.get(name, name)

    def column(self, table: str, name: str) -> str:
        """Return the stored name of a column."""
        return self.columns.get(table, {}).get(name, name)

    def with_present_names(self, name: str, table: pa.Table) -> pa.Table:
        """Return a stored table with the present names of its columns; values and order are unchanged."""
        present_names = {stored_name: present for present, stored_name in self.columns.get(name, {}).items()}
        return table.rename_columns([present_names.get(column, column) for column in table.column_names])


PRESENT = StoredNames({}, {})
VERSION_2 = StoredNames(TABLES_OF_VERSION_2, COLUMNS_OF_VERSION_2)
_NAMES = {2: VERSION_2, RESULTS_VERSION: PRESENT}


def stored_names(folder: Path) -> StoredNames:
    """Return the names in a folder of results; those of the present version if it has no manifest.

    Raises
    ------
    InputError
        The manifest is damaged, or the results are of a version that cannot be read.
    """
    path = folder / MANIFEST
    if not path.is_file():
        return PRESENT
    state = path.stat()
    return _read_names(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=8)
def _read_names(path: Path, _changed_ns: int, _size: int) -> StoredNames:
    """Return the names in results by their manifest, cached until the manifest changes."""
    return names_of(read_manifest(path), path)


def names_of(manifest: Mapping[str, Any], path: Path) -> StoredNames:
    """Return the names in results with a manifest; InputError if the results are of a version that cannot be read."""
    version = results_version(manifest)
    if version not in _NAMES:
        readable = " and ".join(map(str, _NAMES))
        raise InputError(f"{path}: results of version {version}; this version of lvnav-trade reads {readable}")
    return _NAMES[version]
