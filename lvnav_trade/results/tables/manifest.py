"""Manifest of results: reading with verification of its content, and digests of the files of results."""

import hashlib
import json
from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.input_files import read_bytes
from lvnav_trade.results.tables.contents import MANIFEST, refuse_foreign

DIGESTS = "digests"
"""Key of the manifest: SHA-256 of each table and of the resolved campaign, by the name of its file."""
MANIFEST_BYTES = 2**26  # limit, far above the size for the largest campaign


def read_manifest(path: Path) -> dict[str, Any]:
    """Return the content of a manifest; InputError if it cannot be read, is damaged or of another tool."""
    try:
        content = json.loads(read_bytes(path, MANIFEST_BYTES).decode())
    except (ValueError, RecursionError) as error:
        raise damaged(path, error) from None
    refuse_foreign(path, content)
    for is_kind, keys in _KINDS_OF_FIELDS.items():
        for key in keys:
            if key in content and not is_kind(content[key]):
                raise damaged(path, f"{key} cannot be {quoted(content[key])}")
    return dict(content)


def digests(paths: Iterable[Path]) -> dict[str, str]:
    """Return the digests of existing files, by name."""
    return {path.name: digest(path.read_bytes()) for path in paths if path.is_file()}


def digest(content: bytes) -> str:
    """Return the SHA-256 of a file's content; line breaks of texts, which a repository may change, are normalised."""
    return hashlib.sha256(content if content[:4] == b"PAR1" else content.replace(b"\r\n", b"\n")).hexdigest()


def refuse_changed(path: Path) -> None:
    """Raise an InputError if a file of results does not have the digest in its manifest (earlier versions had none)."""
    manifest = path.parent / MANIFEST
    if not (manifest.is_file() and path.is_file()):
        return
    state = manifest.stat()
    wanted = _digests_in(manifest, state.st_mtime_ns, state.st_size).get(path.name)
    if wanted is not None and wanted != digest(path.read_bytes()):
        raise damaged(path, "its content is not what the campaign wrote")


@lru_cache(maxsize=8)
def _digests_in(manifest: Path, _changed_ns: int, _size: int) -> dict[str, str]:
    by_name: dict[str, str] = read_manifest(manifest).get(DIGESTS, {})
    return by_name


def damaged(path: Path, why: object) -> InputError:
    """Return the exception for a damaged file of results, one line with the remedy."""
    line = str(why).strip().partition("\n")[0] or type(why).__name__
    return InputError(f"{path}: damaged: {line}; the same lvnav-trade run makes it again")


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_list_of_texts(value: object) -> bool:
    return isinstance(value, list) and all(map(_is_text, value))


def _is_mapping_to_texts(value: object) -> bool:
    return isinstance(value, dict) and all(map(_is_text, value.values()))


def _is_count(value: object) -> bool:
    return type(value) is int and 0 <= value < 2**63


def _is_above_zero(value: object) -> bool:
    return _is_count(value) and value != 0


_KINDS_OF_FIELDS: dict[Callable[[object], bool], tuple[str, ...]] = {
    _is_text: ("campaign", "campaign_digest", "tool", "code_digest", "created", "finished", "cpu", "system"),
    _is_list_of_texts: ("cases", "lost", "warnings", "notes", "beyond_limits"),
    _is_mapping_to_texts: ("asked_cases", DIGESTS),
    _is_count: ("asked_runs", "workers_died"),
    _is_above_zero: ("asked_block",),
}
"""Type checks of the content of a manifest, with the keys to which they apply."""
