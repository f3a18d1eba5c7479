"""The data dictionary, `tables.toml`: which tables there are and of which feature, which columns, in which unit."""

import re
import tomllib
from functools import lru_cache
from importlib import resources

import pyarrow as pa

from lvnav_trade.quantities.units import EXAMPLES

_FILE = resources.files("lvnav_trade.results.tables") / "tables.toml"
_STATED = tomllib.loads(_FILE.read_text(encoding="utf-8"))
# Possible last parts of the name of a column of numbers
SUFFIXES: dict[str, str] = _STATED["units"]
# Meaning of every column by table, in order, after the column `case` that all of them begin with
TABLES: dict[str, dict[str, str]] = {
    table: {name: meaning or _STATED["shared"][name] for name, meaning in columns.items()}
    for table, columns in _STATED["tables"].items()
}
# Feature of a campaign that each table belongs to; a table without rows is not written
FEATURES: dict[str, str] = {table: _STATED["features"][table] for table in TABLES}
# Feature of a campaign that each CSV table of a report belongs to
REPORTED: dict[str, str] = _STATED["reported"]
# Names in results of version 2 by the present names: of tables, and of columns by table
TABLES_OF_VERSION_2: dict[str, str] = _STATED["version_2"]["tables"]
COLUMNS_OF_VERSION_2: dict[str, dict[str, str]] = _STATED["version_2"]["columns"]
# Suffix of a column of errors in the table `runs`, by the SI unit of the output
SI_SUFFIX = {
    "m": "m",
    "s": "s",
    "m/s": "m_per_s",
    "m/s**2": "m_per_s2",
    "m/s^2": "m_per_s2",
    "rad": "rad",
    "rad/s": "rad_per_s",
    "rad*s/m": "rad_s_per_m",
    "s/rad": "s_per_rad",
    "s^2/m": "s2_per_m",
    "T": "tesla",
    "dimensionless": "ratio",
    "": "ratio",
    "1": "ratio",
}


def unit_suffix(unit: str) -> str:
    """Return the end of a column's name for numbers in an SI unit, such as rad_per_sqrt_s for ``rad/s**0.5``."""
    if unit in SI_SUFFIX:
        return SI_SUFFIX[unit]
    text = re.sub(r"([A-Za-z]+)(?:\*\*|\^)0\.5", r"sqrt_\1", unit)
    text = re.sub(r"([A-Za-z]+)(?:\*\*|\^)1\.5", r"\1_sqrt_\1", text)
    text = re.sub(r"([A-Za-z]+)(?:\*\*|\^)2\.5", r"\1_\1_sqrt_\1", text)
    text = text.replace("**", "").replace("^", "")
    text = text.replace("/", "_per_").replace("*", "_")
    return re.sub(r"\W", "_", text).lower()


@lru_cache(maxsize=1)
def _unit_table() -> dict[str, str]:
    """Return the SI unit by the end of a column's name."""
    unit_by_suffix = {unit_suffix(unit): unit for unit in (*EXAMPLES, *SI_SUFFIX) if unit}
    unit_by_suffix["ratio"] = "dimensionless"
    return unit_by_suffix


def unit_at_end(column: str) -> tuple[str, str]:
    """Return the name of a column without its unit, and that SI unit; no unit if the name ends with none."""
    units = _unit_table()
    suffixes = [suffix for suffix in units if column.endswith(f"_{suffix}")]
    if not suffixes:
        return column, ""
    longest = max(suffixes, key=len)
    return column.removesuffix(f"_{longest}"), units[longest]


def error_column(quantity: str, axis: str, unit: str) -> str:
    """Return the column of the table `runs` with an error, such as ``velocity_3d_error_m_per_s``."""
    return f"{quantity}_{axis}_error_{SI_SUFFIX[unit]}"


def rms_column(quantity: str, axis: str, unit: str) -> str:
    """Return the column of the table `interval_errors` with the root mean square of an error over an interval."""
    return f"{quantity}_{axis}_rms_{SI_SUFFIX[unit]}"


# Columns of errors that tables have further, one for each output
OF_OUTPUTS = {"runs": (error_column,), "spot_runs": (error_column,), "interval_errors": (error_column, rms_column)}


def column_type(column: str) -> pa.DataType:
    """Return the type of a column by its name: numbers end with their unit, counts and numbers are integers."""
    if column in ("logic", "integrity", "tracked"):
        return pa.bool_()
    if column.endswith(("_count", "_number")):
        return pa.int64()
    if column.endswith(tuple(f"_{suffix}" for suffix in SUFFIXES)):
        return pa.float64()
    return pa.string()


@lru_cache(maxsize=128)
def arrow_schema(table: str, extra: tuple[str, ...] = ()) -> pa.Schema:
    """Return the Arrow schema of a table; `extra` names more columns of real numbers at its end."""
    meanings = {"case": _STATED["shared"]["case"], **TABLES[table]}
    fields = [pa.field(name, column_type(name), metadata={"meaning": meaning}) for name, meaning in meanings.items()]
    fields += [pa.field(name, pa.float64()) for name in extra]
    return pa.schema(fields)
