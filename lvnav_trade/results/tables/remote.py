"""Results at a place that fsspec knows (``s3://bucket/demo``, ``memory://demo``): copied there whole, and fetched.

A campaign is computed in a folder of this machine, whose files appear whole or not at all; a store of objects has no
such thing. So results are copied when they are there, the list of files and the manifest last.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lvnav_trade.quantities.errors import InputError, credentials
from lvnav_trade.results.tables.contents import CONTENTS, MANIFEST, owned

_LAST = (CONTENTS, MANIFEST)  # what says that results are there is copied behind them
_kept: list[TemporaryDirectory[str]] = []  # what was fetched without a folder, until this process ends


def is_remote(place: str | Path) -> bool:
    """Whether a place is one for fsspec: it begins with a protocol."""
    return "://" in str(place)


def refuse_foreign_place(url: str) -> None:
    """InputError where a place cannot be reached, or holds what this tool did not copy there."""
    with _reached(url) as (files, place):
        if not files.exists(place) or not files.ls(place, detail=False):
            return
        _listed_at(files, place, url)


def copy_to(folder: Path, url: str) -> int:
    """Copy results (tables, manifest, report; no blocks of runs) to a place, and return how many files.

    What an earlier copy left there and these results lack is removed, no other file. InputError as of
    `refuse_foreign_place`.
    """
    refuse_foreign_place(url)
    here = owned(folder, "results")
    names = sorted(name for name in here.names if here.place(name).is_file() and name not in _LAST)
    with _reached(url) as (files, place):
        before = _listed_at(files, place, url) if files.exists(f"{place}/{CONTENTS}") else []
        for name in (*names, *_LAST):
            files.makedirs(f"{place}/{name}".rpartition("/")[0], exist_ok=True)
            files.put_file(str(folder / name), f"{place}/{name}")
        for name in set(before) - {*names, *_LAST}:
            if files.exists(f"{place}/{name}"):
                files.rm_file(f"{place}/{name}")
    return len(names) + len(_LAST)


def fetched(url: str, folder: Path | None = None) -> Path:
    """Copy results from a place into a folder that is new or empty, without one into one of this process's own; return
    it. InputError where there are none.
    """
    if folder is None:
        _kept.append(TemporaryDirectory(prefix="lvnav-trade-", ignore_cleanup_errors=True))
        folder = Path(_kept[-1].name)
    elif folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder}: is not empty; give another folder")
    here = owned(folder, "results")
    with _reached(url) as (files, place):
        if not files.exists(f"{place}/{MANIFEST}"):
            raise InputError(f"{url}: no results here (no {MANIFEST})")
        for name in (*_listed_at(files, place, url), CONTENTS):
            if files.exists(f"{place}/{name}"):
                target = here.place(name)
                target.parent.mkdir(parents=True, exist_ok=True)
                files.get_file(f"{place}/{name}", str(target))
    return folder


def _listed_at(files: Any, place: str, url: str) -> list[str]:
    """Return the names that the list of files at a place has; InputError where it has none of this tool's."""
    foreign = InputError(f"{url}: holds what lvnav-trade did not copy there; nothing was changed; give another place")
    if not files.exists(f"{place}/{CONTENTS}"):
        raise foreign
    with TemporaryDirectory() as checked:  # read as that of a folder is, with the same refusals
        Path(checked, CONTENTS).write_bytes(files.cat_file(f"{place}/{CONTENTS}"))
        try:
            return sorted(owned(checked, "results").names)
        except InputError:
            raise foreign from None


@contextmanager
def _reached(url: str) -> Iterator[tuple[Any, str]]:
    """Give the file system of a place, and its path there; what goes wrong with it is an InputError of one line."""
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        raise InputError(f"{url}: needs fsspec; pip install 'lvnav-trade[remote]'") from None
    try:
        files, place = url_to_fs(url)
        files.invalidate_cache()
        yield files, place.rstrip("/")
    except InputError:
        raise
    except ImportError as error:
        raise InputError(f"{url}: {_without_secrets(error, url)}") from None
    except Exception as error:  # every file system has errors of its own
        raise InputError(f"{url}: cannot be reached: {_without_secrets(error, url)}") from None


def _without_secrets(error: Exception, url: str) -> str:
    """Return the first line of an error, which may quote parts of the address in a form of its own."""
    why = str(error).strip().partition("\n")[0] or type(error).__name__
    for secret in credentials(url):
        why = why.replace(secret, "***")
    return why
