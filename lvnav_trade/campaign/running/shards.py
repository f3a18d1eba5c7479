"""Campaigns in shards: each shard computes some of the blocks in its own folder; merging gives the whole campaign."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.input_files import refuse_irregular
from lvnav_trade.results.tables.contents import MANIFEST, refuse_foreign
from lvnav_trade.results.tables.versions import environment
from lvnav_trade.results.tables.write import difference

_NUMBER_OF_TOTAL = re.compile(r"([0-9]+)/([0-9]+)")
_FOLDER = re.compile(r"shard-([0-9]+)-of-([0-9]+)")
_COMPARED_KEYS = ("asked_runs", "asked_block", "seed")  # compared in addition to the digest, which does not cover them
_Item = TypeVar("_Item")


class Shard(NamedTuple):
    """A shard of a campaign."""

    number: int  # from 1
    total: int  # number of shards

    @property
    def folder(self) -> str:
        """Name of the folder of the shard."""
        return f"shard-{self.number}-of-{self.total}"

    def select(self, items: Sequence[_Item]) -> Sequence[_Item]:
        """Return the work items of this shard: adjacent items, since items of one case share its preparation."""
        first = (self.number - 1) * len(items) // self.total
        end = self.number * len(items) // self.total
        return items[first:end]


def parse(text: str) -> Shard:
    """Return the shard of a text such as ``2/8``.

    Raises
    ------
    InputError
        The text is not of this form, or the number is not from 1 to the total.
    """
    match = _NUMBER_OF_TOTAL.fullmatch(text)
    if match:
        shard = _shard_from(match)
        if 1 <= shard.number <= shard.total:
            return shard
    raise InputError(f"--shard {text}: should be NUMBER/TOTAL, such as 1/4, with a number from 1 to the total")


def _shard_from(match: re.Match[str]) -> Shard:
    number, total = match.groups()
    return Shard(int(number), int(total))


def all_shard_folders(place: Path) -> list[Path]:
    """Return the folders of all shards of a campaign, in order.

    Parameters
    ----------
    place : Path
        Folder that contains the folders of the shards.

    Returns
    -------
    list of Path
        One folder per shard.

    Raises
    ------
    InputError
        A shard is missing, unfinished, of another campaign, or computed by another version of the code.
    """
    folders = _shard_folders(place)
    counts = sorted({shard.total for shard in folders})
    if not counts:
        raise InputError(f"{place}: no shards here (no folder {Shard(1, 2).folder} or the like)")
    if len(counts) > 1:
        divisions = " and of ".join(map(str, counts))
        raise InputError(f"{place}: holds shards of {divisions}; keep those of one division")
    (total,) = counts
    shards = [Shard(number, total) for number in range(1, total + 1)]
    missing = [str(shard.number) for shard in shards if shard not in folders]
    if missing:
        raise InputError(f"{place}: of {total} shards these are missing: {', '.join(missing)}")
    in_order = [folders[shard] for shard in shards]
    manifests = [_read_manifest(shard, folders[shard]) for shard in shards]
    for folder, manifest in zip(in_order, manifests, strict=True):
        _refuse_difference(folder, manifest, in_order[0], manifests[0])
    return in_order


def _shard_folders(place: Path) -> dict[Shard, Path]:
    folders = {}
    for path in sorted(place.glob("shard-*")):
        match = _FOLDER.fullmatch(path.name)
        if match and path.is_dir():
            folders[_shard_from(match)] = path
    return folders


def _read_manifest(shard: Shard, folder: Path) -> dict[str, Any]:
    """Return the manifest of a finished shard."""
    path = folder / MANIFEST
    refuse_irregular(folder)
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    refuse_foreign(path, content)
    if content.get("shard") != [*shard]:
        raise InputError(f"{folder}: does not hold shard {shard.number} of {shard.total}")
    if not content.get("shard_finished"):
        command = f"lvnav-trade run with --shard {shard.number}/{shard.total}"
        raise InputError(f"{folder}: not finished; the same {command} goes on with it")
    return content


def _refuse_difference(folder: Path, manifest: dict[str, Any], first: Path, first_manifest: dict[str, Any]) -> None:
    """Refuse a shard whose campaign, settings or versions differ from those of the first shard.

    Parameters
    ----------
    folder : Path
        Folder of the shard.
    manifest : dict
        Manifest of the shard.
    first : Path
        Folder of the first shard.
    first_manifest : dict
        Manifest of the first shard.

    Raises
    ------
    InputError
        The shards differ, or the code differs from that of the shards.
    """
    if manifest["campaign_digest"] != first_manifest["campaign_digest"]:
        raise InputError(f"{folder}: holds another campaign than {first}")
    for key in _COMPARED_KEYS:
        if manifest.get(key) != first_manifest.get(key):
            name = key.removeprefix("asked_")
            raise InputError(f"{folder}: {name} {manifest.get(key)}, but {first} has {first_manifest.get(key)}")
    difference_text = difference(manifest, environment())
    if difference_text:
        raise InputError(f"{folder}: was computed {difference_text}; merge with the code of the shards")
