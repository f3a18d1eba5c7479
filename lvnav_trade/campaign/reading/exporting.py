"""Export of a trajectory to a file of the user's format, with the card that names the file."""

import os
from pathlib import Path
from typing import NamedTuple

from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.cards import Shelf
from lvnav_trade.errors import InputError, writing
from lvnav_trade.world.flight.export import difference, exported
from lvnav_trade.world.flight.trajectory import TrajectoryCard, build
from lvnav_trade.world.user_file.columns import TableTrajectory


class Written(NamedTuple):
    """The files, times (s) of the events, and the largest differences of the export, flown, from the flight (SI)."""

    file: Path
    card: Path
    events: dict[str, float]
    difference: dict[str, float]


def write_flight(card: TrajectoryCard, file: Path, rate: float) -> Written:
    """Write the flight of a card as CSV rows at `rate` (Hz), and beside it the card that names them; fly that again.

    InputError where one of the two files exists, cannot be written, or the flight cannot be flown.
    """
    beside = file.with_suffix(".yaml")
    if file.suffix.lower() in (".yaml", ".yml", ".parquet", ".pq"):
        raise InputError(f"{file}: the rows are written as CSV, the card beside them as {beside.name}; end it in .csv")
    refuse_existing(file, beside)
    found = exported(card, file.name, file.stem, rate)
    with writing(file, "the trajectory cannot be written there"):
        write_new(file, found.text)
        write_new(beside, tree.dump(found.card))
    still = found.card | {"file": os.fspath(file), "oscillation": (), "named_times": {}}
    again = build(TableTrajectory.model_validate(still))
    named = {name: time for name, time in again.events.items() if name in found.card["events"]}
    return Written(file, beside, named, difference(found.flight, again))


def refuse_existing(*files: Path) -> None:
    """InputError where one of the files is there already."""
    for file in files:
        if os.path.lexists(file):
            raise InputError(f"{file}: exists already; nothing was written: move it, or give another name")


def write_new(file: Path, text: str) -> None:
    """Write a file that is not there; FileExistsError where it is."""
    with file.open("x", encoding="utf-8", newline="\n") as stream:
        stream.write(text)


def is_card(name: str, folder: Path) -> bool:
    """Whether a name is that of a trajectory card: its file states a kind, as no campaign does."""
    file = Shelf.of(folder).find(name, folder)
    return file is not None and "kind" in tree.read_mapping(file).value
