"""Export of a trajectory to a CSV file, with the card that names the file."""

import os
from pathlib import Path
from typing import NamedTuple

from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.cards import Shelf
from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.trajectory.export import difference, exported
from lvnav_trade.trajectory.files.columns import TableTrajectory
from lvnav_trade.trajectory.flight import TrajectoryCard, build


class Written(NamedTuple):
    """An exported trajectory."""

    file: Path  # table, CSV
    card: Path  # card that names the table
    events: dict[str, float]  # times of the events, s
    difference: dict[str, float]  # largest differences of the trajectory read from the file, SI


def write_flight(card: TrajectoryCard, file: Path, rate: float) -> Written:
    """Write a trajectory as a CSV table and its card next to it, then read the table and compare.

    Parameters
    ----------
    card : TrajectoryCard
        The trajectory.
    file : Path
        CSV file to write.
    rate : float
        Rows per second (Hz).

    Returns
    -------
    Written
        Files, events, largest differences.

    Raises
    ------
    InputError
        One of the two files exists or cannot be written, or the trajectory is invalid.
    """
    card_file = file.with_suffix(".yaml")
    if file.suffix.lower() in (".yaml", ".yml", ".parquet", ".pq"):
        raise InputError(
            f"{file}: the rows are written as CSV, the card beside them as {card_file.name}; end it in .csv"
        )
    refuse_existing(file, card_file)
    export = exported(card, file.name, file.stem, rate)
    with writing(file, "the trajectory cannot be written there"):
        write_new(file, export.text)
        write_new(card_file, tree.dump(export.card))
    # a superposed oscillation is not exported, so the comparison is made without it
    smooth = export.card | {"file": os.fspath(file), "oscillation": (), "named_times": {}}
    rebuilt = build(TableTrajectory.model_validate(smooth))
    named = {name: time for name, time in rebuilt.events.items() if name in export.card["events"]}
    return Written(file, card_file, named, difference(export.flight, rebuilt))


def refuse_existing(*files: Path) -> None:
    """Raise an InputError if one of the files exists."""
    for file in files:
        if os.path.lexists(file):
            raise InputError(f"{file}: exists already; nothing was written: move it, or give another name")


def write_new(file: Path, text: str) -> None:
    """Write a new file; FileExistsError if it exists."""
    with file.open("x", encoding="utf-8", newline="\n") as stream:
        stream.write(text)


def is_card(name: str, folder: Path) -> bool:
    """Whether a name refers to a trajectory card: its file has a `kind`, which no campaign has."""
    file = Shelf.of(folder).find(name, folder)
    return file is not None and "kind" in tree.read_mapping(file).value
