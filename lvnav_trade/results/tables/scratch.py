"""Scratch files of a running campaign: named tuples of arrays as npz and JSON, verified when read, never executed."""

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

from lvnav_trade.results.tables.table_files import replace_file, replacing

_LOG = logging.getLogger("lvnav_trade.results.tables")
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
    """Write a value in one step; each array of the archive has a checksum.

    Parameters
    ----------
    file : Path
        File to write.
    value : object
        Nested named tuples, tuples, sets and mappings of numeric arrays, numbers, texts and None.
    identity : str
        Origin of the value, which `read` verifies: campaign, case and code.

    Raises
    ------
    TypeError
        The value contains anything else.
    """
    arrays: list[Any] = []
    text = json.dumps({"identity": identity, "value": _encode(value, arrays)})
    members: dict[str, Any] = {f"a{number}": array for number, array in enumerate(arrays)}
    members[_TREE] = np.frombuffer(text.encode(), dtype=np.uint8)
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file) as temporary, temporary.open("xb") as archive:
        np.savez(archive, **members)


def read(file: Path, root: type, identity: str) -> Any:
    """Read a value.

    Parameters
    ----------
    file : Path
        File to read.
    root : type
        Expected named tuple; only it and the named tuples of its fields are created.
    identity : str
        Expected origin.

    Raises
    ------
    ValueError
        The file is damaged, or its content is of another type or origin.
    """
    archive = io.BytesIO(file.read_bytes())
    try:
        with np.load(archive, allow_pickle=False) as arrays:
            content = json.loads(arrays[_TREE].tobytes().decode())
            if content["identity"] != identity:
                raise ValueError("computed from another campaign, case or code")
            value = _decode(content["value"], arrays, record_types(root))
        if type(value) is not root:
            raise ValueError(f"not a {root.__name__}")
    except _DAMAGE as error:
        raise ValueError(f"{file}: not usable: {str(error).partition(chr(10))[0]}") from None
    return value


def is_sound(file: Path, root: type, identity: str) -> bool:
    """Whether `read` would succeed; an existing file that it refuses is reported in the log.

    Parameters
    ----------
    file : Path
        The scratch file.
    root : type
        Record that it should contain.
    identity : str
        Origin that it should have.
    """
    if not file.exists():
        return False
    try:
        read(file, root, identity)
    except ValueError as error:
        _LOG.warning("%s; computed again", error)
        return False
    return True


_cached: OrderedDict[tuple[Path, str], Any] = OrderedDict()  # last values of this process, by file and identity


def save(file: Path, value: Any, identity: str) -> None:
    """Write a value as `write` does, and cache it."""
    write(file, value, identity)
    cache(file, value, identity)


def load(file: Path, root: type, identity: str) -> Any:
    """Return a value from the cache, or else as `read` does."""
    if (file, identity) not in _cached:
        cache(file, read(file, root, identity), identity)
    return _cached[file, identity]


def cache(file: Path, value: Any, identity: str) -> None:
    """Cache a value without writing the file, for later use by the same work item; the last four are cached."""
    _cached[file, identity] = value
    while len(_cached) > 4:
        _cached.popitem(last=False)


def exists(file: Path, identity: str) -> bool:
    """Whether `load` finds a value in the cache or a file."""
    return (file, identity) in _cached or file.exists()


def clear_cache() -> None:
    """Remove all values from the cache."""
    _cached.clear()


def remove(folder: Path, cases: Iterable[str]) -> None:
    """Remove the scratch files of cases, and the folder if it becomes empty."""
    if folder.is_symlink() or not folder.is_dir():
        return
    for case in cases:
        # with temporary files of killed processes
        case_file = re.compile(rf"\.?{re.escape(case)}(\..*)?\.(covariance|explained|whole|designs)(\.\d+)?")
        for path in list(folder.iterdir()):
            if case_file.fullmatch(path.name):
                path.unlink(missing_ok=True)
    with suppress(OSError):  # the folder contains a file of the user
        folder.rmdir()


def copy(source: Path, target: Path, case: str) -> None:
    """Copy the scratch files of a case, or of a part of a design space, from one folder to another."""
    for extension in ("covariance", "explained", "designs"):
        for path in source.glob(f"{case}.*.{extension}"):
            target.mkdir(parents=True, exist_ok=True)
            replace_file(target / path.name, path.read_bytes())


@lru_cache(maxsize=8)
def record_types(root: type) -> dict[str, type]:
    """Return a named tuple and all named tuples among the types of its fields, by name."""
    type_by_name: dict[str, type] = {}
    pending: list[Any] = [root]
    while pending:
        annotation = pending.pop()
        pending += get_args(annotation)
        is_record = isinstance(annotation, type) and hasattr(annotation, "_fields")
        if is_record and annotation.__name__ not in type_by_name:
            type_by_name[annotation.__name__] = annotation
            pending += get_type_hints(annotation).values()
    return type_by_name


def _encode(value: Any, arrays: list[Any]) -> Any:
    """Return a value as JSON content; its arrays are appended to a list and referred to by their index."""
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in _NUMERIC:
        arrays.append(np.asarray(value))
        key = "scalar" if isinstance(value, np.generic) else "array"
        return {key: len(arrays) - 1}
    if isinstance(value, tuple):
        items = [_encode(item, arrays) for item in value]
        if hasattr(value, "_fields"):
            return {"record": type(value).__name__, "fields": items}
        return {"tuple": items}
    if isinstance(value, frozenset):
        return {"set": sorted(value)}
    if isinstance(value, Mapping):
        return {"mapping": [[key, _encode(item, arrays)] for key, item in value.items()]}
    raise TypeError(f"a scratch file holds no {type(value).__name__}")


def _decode(tree: Any, arrays: Any, types: dict[str, type]) -> Any:
    """Return the value of JSON content, the inverse of `_encode`."""
    if not isinstance(tree, dict):
        return tree
    if "record" in tree:
        record = types[tree["record"]]
        return record(*(_decode(item, arrays, types) for item in tree["fields"]))
    if "tuple" in tree:
        return tuple(_decode(item, arrays, types) for item in tree["tuple"])
    if "set" in tree:
        return frozenset(tree["set"])
    if "mapping" in tree:
        return {key: _decode(item, arrays, types) for key, item in tree["mapping"]}
    number = tree["scalar"] if "scalar" in tree else tree["array"]
    array = arrays[f"a{int(number)}"]
    if array.dtype.kind not in _NUMERIC:
        raise ValueError(f"an array of type {array.dtype}")
    return array[()] if "scalar" in tree else array
