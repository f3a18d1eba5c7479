"""Cases of results as a table that can be filtered, sorted and written to a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lvnav_trade.api.display import DisplayBase, DisplayContent
from lvnav_trade.api.reports import load
from lvnav_trade.quantities.errors import InputError, writing

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Designs(DisplayBase):
    """Designs of a campaign, one row each.

    Attributes
    ----------
    rows : pandas.DataFrame
        One row per case: axes, errors, requirements, cost; numbers in SI.
    columns : pandas.DataFrame
        Description of the columns of `rows`: column, unit, meaning.
    total : int
        Number of cases of the campaign.
    """

    rows: pd.DataFrame
    columns: pd.DataFrame
    total: int

    def write(self, file: str | Path) -> Path:
        """Write the rows as CSV or Parquet, according to the extension of the file.

        Parameters
        ----------
        file : str or Path
            File to write, such as ``designs.csv`` or ``designs.parquet``; an existing file is replaced.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        InputError
            The extension is another, or the file cannot be written.
        """
        place = Path(file)
        kinds = {".csv": self._write_csv, ".parquet": self._write_parquet}
        if place.suffix not in kinds:
            raise InputError(f"{place}: should end in {' or '.join(kinds)}")
        with writing(place, "the file cannot be written"):
            place.parent.mkdir(parents=True, exist_ok=True)
            kinds[place.suffix](place)
        return place

    def _write_csv(self, place: Path) -> None:
        self.rows.to_csv(place, index=False, lineterminator="\n")

    def _write_parquet(self, place: Path) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        descriptions = self.columns.set_index("column")
        table = pa.Table.from_pandas(self.rows, preserve_index=False).replace_schema_metadata(None)
        fields = []
        for field in table.schema:
            unit = descriptions.unit[field.name]
            meaning = descriptions.meaning[field.name]
            fields.append(field.with_metadata({"unit": unit, "meaning": meaning}))
        pq.write_table(table.cast(pa.schema(fields)), place)

    def _display_content(self) -> DisplayContent:
        return DisplayContent(
            title=f"{len(self.rows)} of {self.total} cases",
            tables={"": self.rows, "Columns": self.columns},
        )


def cases(
    folder: str | Path,
    where: Sequence[str] = (),
    sort: Sequence[str] = (),
    columns: Sequence[str] = (),
) -> Designs:
    """Return the cases of results as a table: one row each, numbers in SI.

    In the arguments ``axis_`` at the beginning of a column's name and the unit at its end may be omitted.

    Parameters
    ----------
    folder : str or Path
        Folder of results.
    where : sequence of str
        Conditions that every returned row satisfies, such as ``velocity < 0.1 m/s and imu == tactical_fog``.
    sort : sequence of str
        Columns to sort by, smallest first; ``-velocity``: largest first.
    columns : sequence of str
        Columns to return; all if empty.

    Returns
    -------
    Designs
        The rows, and the unit and meaning of their columns.

    Raises
    ------
    InputError
        The folder has no results, a column does not exist, or a text is not a condition.
    """
    from lvnav_trade.api.selecting import column_named, select_rows, sort_rows
    from lvnav_trade.results.evaluation.designs import meanings

    results = load(folder)
    all_rows = results.cases
    rows = sort_rows(select_rows(all_rows, where), sort)
    if columns:
        rows = rows[[column_named(name, all_rows) for name in columns]]
    requirements = results.tables.campaign.get("requirements") or ()
    return Designs(rows, meanings(rows, requirements), len(all_rows))
