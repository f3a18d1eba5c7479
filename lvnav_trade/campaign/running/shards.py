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

_ASKED = re.compile(r"([0-9]+)/([0-9]+)")
_FOLDER = re.compile(r"shard-([0-9]+)-of-([0-9]+)")
_SAME = ("asked_runs", "asked_block", "seed")  # compared in addition to the digest, which does not cover them
_Unit = TypeVar("_Unit")


class Shard(NamedTuple):
    """A shard of a campaign."""

    number: int  # from 1
    total: int  # number of shards

    @property
    def folder(self) -> str:
        """Name of the folder of the shard."""
        return f"shard-{self.number}-of-{self.total}"

    def of(self, units: Sequence[_Unit]) -> Sequence[_Unit]:
        """Return the work items of this shard: adjacent items, since items of one case share its preparation."""
        first, last = ((self.number - less) * len(units) // self.total for less in (1, 0))
        return units[first:last]


def parse(text: str) -> Shard:
    """Return the shard of a text such as ``2/8``."""
    match = _ASKED.fullmatch(text)
    shard = Shard(*map(int, match.groups())) if match else Shard(0, 0)
    if not 1 <= shard.number <= shard.total:
        raise InputError(f"--shard {text}: should be NUMBER/TOTAL, such as 1/4, with a number from 1 to the total")
    return shard


def complete(place: Path) -> list[Path]:
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
    names = [(_FOLDER.fullmatch(path.name), path) for path in sorted(place.glob("shard-*")) if path.is_dir()]
    folders = {Shard(*map(int, name.groups())): path for name, path in names if name}
    counts = sorted({shard.total for shard in folders})
    if not counts:
        raise InputError(f"{place}: no shards here (no folder {Shard(1, 2).folder} or the like)")
    if len(counts) > 1:
        raise InputError(f"{place}: holds shards of {' and of '.join(map(str, counts))}; keep those of one division")
    shards = [Shard(number, counts[0]) for number in range(1, counts[0] + 1)]
    missing = [str(shard.number) for shard in shards if shard not in folders]
    if missing:
        raise InputError(f"{place}: of {counts[0]} shards these are missing: {', '.join(missing)}")
    manifests = [_manifest(shard, folders[shard]) for shard in shards]
    for shard, manifest in zip(shards, manifests, strict=True):
        _refuse_other(folders[shard], manifest, folders[shards[0]], manifests[0])
    return [folders[shard] for shard in shards]


def _manifest(shard: Shard, folder: Path) -> dict[str, Any]:
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


def _refuse_other(folder: Path, manifest: dict[str, Any], first: Path, wanted: dict[str, Any]) -> None:
    if manifest["campaign_digest"] != wanted["campaign_digest"]:
        raise InputError(f"{folder}: holds another campaign than {first}")
    for key in _SAME:
        if manifest.get(key) != wanted.get(key):
            what = key.removeprefix("asked_")
            raise InputError(f"{folder}: {what} {manifest.get(key)}, but {first} has {wanted.get(key)}")
    other = difference(manifest, environment())
    if other:
        raise InputError(f"{folder}: was computed {other}; merge with the code of the shards")
