"""Lookup of cards: next to the campaign, in its folder `configs`, then among the cards of the tool."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from pydantic import BaseModel

from lvnav_trade.campaign.syntax import tree
from lvnav_trade.quantities.errors import InputError, quoted, writing

_PACKAGE = Path(__file__).resolve().parents[2]


def tool_folder(folder: str) -> Path:
    """Return a folder of the tool (`configs` or `campaigns`): in the installed package, or else in the repository."""
    package_folder = _PACKAGE / "_data" / folder
    return package_folder if package_folder.is_dir() else _PACKAGE.parent / folder


_LIST_LENGTH = 12  # largest number of cards that a message lists


class Shelf(NamedTuple):
    """Folders in which cards are looked up by name."""

    folders: tuple[Path, ...]  # in this order, after the folder of the file that names the card

    @classmethod
    def from_folder(cls, campaign_folder: Path) -> Shelf:
        """Return the shelf of a campaign: its own folder `configs`, then that of the tool."""
        return cls((campaign_folder / "configs", tool_folder("configs")))

    def find(self, name: str, folder: Path) -> Path | None:
        """Return the file of the card `name` as written in a file of `folder`, or None."""
        for start in (folder, *self.folders):
            for file_name in (name, f"{name}.yaml", f"{name}.yml"):
                candidate = start / file_name
                if os.path.isfile(candidate):
                    return candidate.resolve()
        return None

    def card_names(self) -> list[str]:
        """Return the names of all cards in the folders of the shelf."""
        return sorted({name for folder in self.folders for name, _ in _cards(folder)})

    def read(self, node: tree.Node, path: str, words: Iterable[str] = ()) -> tree.Node:
        """Return the tree of the card named by a scalar node.

        Parameters
        ----------
        node : tree.Node
            Name of the card.
        path : str
            Dotted path of the field, for messages.
        words : iterable of str
            Literals that the field accepts in addition to cards; they are used for the suggestion only.

        Raises
        ------
        InputError
            There is no such card (the message suggests similar names), or the card cannot be read.
        """
        name = str(node.value)
        file = self.find(name, node.place.folder) if name.strip() else None
        if file is None:
            neighbours = _neighbours(name, node.place.folder)
            candidates = [*self.card_names(), *neighbours, *map(str, words)]
            suggestion = _suggestion(name, candidates)
            raise tree.refuse(node.place, path, f"no card {quoted(name)}{suggestion}")
        return tree.read_mapping(file)


def _suggestion(name: str, card_names: Sequence[str]) -> str:
    """Return the suggestion of a similar card, or else the cards of the folder in the name."""
    folder, _, last = name.rpartition("/")
    folder_cards = [card for card in card_names if card.rpartition("/")[0] == folder]
    if not folder or not folder_cards:
        return tree.hint(name, card_names)
    names = [card.rpartition("/")[2] for card in folder_cards]
    if tree.hint(last, names):
        return tree.hint(name, folder_cards)
    card_list = ", ".join(names[:_LIST_LENGTH])
    ellipsis = ", ..." if len(names) > _LIST_LENGTH else ""
    return f" ({folder}/ has {card_list}{ellipsis})"


def _neighbours(name: str, folder: Path) -> list[str]:
    """Return the names of the cards in the folder of the path `name`, written in the same way."""
    place = (folder / name).parent
    if not os.path.exists(place):
        return []
    has_suffix = bool(Path(name).suffix)
    names = []
    for file in (*place.glob("*.yaml"), *place.glob("*.yml")):
        file_name = file.name if has_suffix else file.stem
        names.append(str(Path(name).with_name(file_name)))
    return names


def _cards(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield name (path below the folder without extension) and file of each card of a folder."""
    files = [*folder.rglob("*.yaml"), *folder.rglob("*.yml")]
    for file in sorted(files):
        name = file.relative_to(folder).with_suffix("")
        yield str(name), file


class CardInfo(NamedTuple):
    """Entry in the list of cards."""

    name: str  # by which a campaign names it, such as imu/tactical_fog
    title: str  # name of the card in words
    source: str  # origin of its numbers
    file: str


def catalogue(folder: Path, prefix: str = "") -> list[CardInfo]:
    """Return the cards that a campaign in `folder` can name; a card of the user hides one of the tool.

    Only cards whose name begins with `prefix` are read.
    """
    files_by_name: dict[str, Path] = {}
    for start in Shelf.from_folder(folder).folders:
        for name, file in _cards(start):
            if name.startswith(prefix):
                files_by_name.setdefault(name, file)
    return [_card_info(name, file) for name, file in sorted(files_by_name.items())]


def _card_info(name: str, file: Path) -> CardInfo:
    try:
        card = tree.read_mapping(file).value
    except InputError as error:
        return CardInfo(name, "(cannot be read)", str(error), tree.show(file))

    def text(key: str) -> str:
        return " ".join(str(card[key].value).split()) if key in card else ""

    return CardInfo(name, text("name"), text("source"), tree.show(file))


def card_text(name: str, folder: Path) -> str:
    """Return the text of a card's file with its comments; InputError if there is no such card."""
    shelf = Shelf.from_folder(folder)
    file = shelf.find(name, folder)
    if file is None:
        raise InputError(f"no card {quoted(name)}{_suggestion(name, shelf.card_names())}")
    tree.read_mapping(file)
    return file.read_text(encoding="utf-8-sig")


MARK = "# Written by lvnav-trade"


def write_card(file: Path, card: BaseModel) -> None:
    """Write a computed card without fields at their default; InputError if the file cannot be written."""
    write_text(file, f"{MARK}\n{tree.dump(card.model_dump(mode='json', exclude_defaults=True))}")


def write_text(file: Path, text: str) -> None:
    """Write the text of a card, which begins with `MARK`; InputError if a file without the mark exists."""
    with writing(file, "the card cannot be written there"):
        if file.exists() and not file.read_bytes().startswith(MARK.encode()):
            raise InputError(f"{file}: exists and was not written by lvnav-trade; give another name")
        file.write_text(text, encoding="utf-8")


def campaign_file(name: str) -> Path:
    """Return the campaign file of a name: a path, or else a campaign that comes with the tool."""
    path = Path(name)
    if os.path.exists(path) or path.is_absolute() or not path.name:
        return path
    relative_path = path
    if path.parts[0] == "campaigns" and len(path.parts) > 1:
        relative_path = Path(*path.parts[1:])
    for candidate in (relative_path, relative_path.with_name(f"{relative_path.name}.yaml")):
        file = tool_folder("campaigns") / candidate
        if os.path.isfile(file):
            return file
    return path


def command_line_place(label: str) -> tree.Place:
    """Return the place of a value given on the command line; relative paths start from the working folder."""
    return tree.Place(label, 0, 0, Path.cwd())
