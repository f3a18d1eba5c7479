"""Scratch files of a running campaign: named tuples of arrays as npz and JSON, checked when read, never executed."""

import io
import json
import logging
import re
import zipfile
import zlib
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np

from lvnav_trade.store.files import replace_file, replacing

_LOG = logging.getLogger("lvnav_trade.store")
FOLDER = ".scratch"
_TREE = "tree"
_NUMERIC = "biuf"  # kinds of numpy types
_DAMAGE = (
    ValueError,
    KeyError,
    TypeError,
    IndexError,
    EOFError,
    OverflowError,
    NotImplementedError,
    RecursionError,
    MemoryError,
    zipfile.BadZipFile,
    zlib.error,
)


def write(file: Path, value: Any, identity: str) -> None:
    """Write a value in one step; each array of the archive has its checksum.

    value : nested named tuples, tuples, sets and mappings of texts, numeric arrays, numbers, texts and None; TypeError
        for anything else
    identity : what it was computed from; `read` asks for the same
    """
    arrays: list[Any] = []
    text = json.dumps({"identity": identity, "value": _encode(value, arrays)})
    members: dict[str, Any] = {f"a{number}": array for number, array in enumerate(arrays)}
    members[_TREE] = np.frombuffer(text.encode(), dtype=np.uint8)
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file) as temporary, temporary.open("xb") as archive:
        np.savez(archive, **members)


def read(file: Path, root: type, identity: str) -> Any:
    """Return what was written; ValueError where the file is damaged, foreign or of another identity.

    root : the named tuple that is expected; only it and the named tuples of its fields are made
    """
    content = io.BytesIO(file.read_bytes())
    try:
        with np.load(content, allow_pickle=False) as arrays:
            found = json.loads(arrays[_TREE].tobytes().decode())
            if found["identity"] != identity:
                raise ValueError("computed from another campaign, case or code")
            value = _decode(found["value"], arrays, record_types(root))
        if type(value) is not root:
            raise ValueError(f"not a {root.__name__}")
    except _DAMAGE as error:
        raise ValueError(f"{file}: not usable: {str(error).partition(chr(10))[0]}") from None
    return value


def is_sound(file: Path, root: type, identity: str) -> bool:
    """Whether `read` would return a value; a file that it would not is named in the log."""
    if not file.exists():
        return False
    try:
        read(file, root, identity)
    except ValueError as error:
        _LOG.warning("%s; computed again", error)
        return False
    return True


_at_hand: OrderedDict[tuple[Path, str], Any] = OrderedDict()  # what this process had last, by file and identity


def leave(file: Path, value: Any, identity: str) -> None:
    """Write a value as `write` does, and keep it at hand."""
    write(file, value, identity)
    _keep(file, identity, value)


def left(file: Path, root: type, identity: str) -> Any:
    """Return what was left, by this process or another one; ValueError as of `read`."""
    if (file, identity) not in _at_hand:
        _keep(file, identity, read(file, root, identity))
    return _at_hand[file, identity]


def hold(file: Path, value: Any, identity: str) -> None:
    """Keep a value at hand as `leave` does, without the file: it is of use to this work item alone."""
    _keep(file, identity, value)


def is_left(file: Path, identity: str) -> bool:
    """Whether `left` has something to return."""
    return (file, identity) in _at_hand or file.exists()


def forget() -> None:
    """Keep nothing at hand."""
    _at_hand.clear()


def _keep(file: Path, identity: str, value: Any) -> None:
    _at_hand[file, identity] = value
    while len(_at_hand) > 4:
        _at_hand.popitem(last=False)


def remove(folder: Path, cases: Iterable[str]) -> None:
    """Remove the scratch files of cases, and the folder where it is empty then."""
    if folder.is_symlink() or not folder.is_dir():
        return
    for case in cases:
        own = re.compile(
            rf"\.?{re.escape(case)}(\..*)?\.(covariance|explained|whole|designs)(\.\d+)?"
        )  # half written ones too
        for path in [path for path in folder.iterdir() if own.fullmatch(path.name)]:
            path.unlink(missing_ok=True)
    with suppress(OSError):  # a file of the user's own is left in it
        folder.rmdir()


def copy(source: Path, target: Path, case: str) -> None:
    """Copy the scratch files of a case, or of a part of many designs, from one folder to another."""
    for path in [path for kind in ("covariance", "explained", "designs") for path in source.glob(f"{case}.*.{kind}")]:
        target.mkdir(parents=True, exist_ok=True)
        replace_file(target / path.name, path.read_bytes())


@lru_cache(maxsize=8)
def record_types(root: type) -> dict[str, type]:
    """Return the named tuples that a named tuple's fields can hold, itself among them, by name."""
    found: dict[str, type] = {}
    waiting: list[Any] = [root]
    while waiting:
        kind = waiting.pop()
        waiting += get_args(kind)
        if isinstance(kind, type) and hasattr(kind, "_fields") and kind.__name__ not in found:
            found[kind.__name__] = kind
            waiting += get_type_hints(kind).values()
    return found


def _encode(value: Any, arrays: list[Any]) -> Any:
    """Return JSON of a value, its arrays put into a list."""
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in _NUMERIC:
        arrays.append(np.asarray(value))
        return {"scalar" if isinstance(value, np.generic) else "array": len(arrays) - 1}
    if isinstance(value, tuple):
        fields = [_encode(one, arrays) for one in value]
        return {"record": type(value).__name__, "fields": fields} if hasattr(value, "_fields") else {"tuple": fields}
    if isinstance(value, frozenset):
        return {"set": sorted(value)}
    if isinstance(value, Mapping):
        return {"mapping": [[key, _encode(one, arrays)] for key, one in value.items()]}
    raise TypeError(f"a scratch file holds no {type(value).__name__}")


def _decode(tree: Any, arrays: Any, types: dict[str, type]) -> Any:
    if not isinstance(tree, dict):
        return tree
    if "record" in tree:
        return types[tree["record"]](*(_decode(one, arrays, types) for one in tree["fields"]))
    if "tuple" in tree:
        return tuple(_decode(one, arrays, types) for one in tree["tuple"])
    if "set" in tree:
        return frozenset(tree["set"])
    if "mapping" in tree:
        return {key: _decode(one, arrays, types) for key, one in tree["mapping"]}
    number = tree["scalar"] if "scalar" in tree else tree["array"]
    array = arrays[f"a{int(number)}"]
    if array.dtype.kind not in _NUMERIC:
        raise ValueError(f"an array of type {array.dtype}")
    return array[()] if "scalar" in tree else array
