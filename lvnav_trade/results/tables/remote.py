"""Results at an address of fsspec (``s3://bucket/demo``, ``memory://demo``): copied there, and fetched.

A campaign is computed in a local folder, whose files are replaced atomically; object stores cannot do this. Results are
therefore copied when they are complete, the list of files and the manifest last.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lvnav_trade.quantities.errors import InputError, credentials
from lvnav_trade.results.tables.contents import CONTENTS, MANIFEST, owned_folder

_LAST = (CONTENTS, MANIFEST)  # copied last, since these files say that results are there
_temporary: list[TemporaryDirectory[str]] = []  # folders of fetched results, until this process ends


def is_remote(place: str | Path) -> bool:
    """Whether a place is an address of fsspec, which begins with a protocol."""
    return "://" in str(place)


def refuse_foreign_place(url: str) -> None:
    """Raise an InputError if a place cannot be reached, or contains files that this tool did not copy there."""
    with _file_system(url) as (files, place):
        if files.exists(place) and files.ls(place, detail=False):
            _read_names(files, place, url)


def copy_to(folder: Path, url: str) -> int:
    """Copy results (tables, manifest, report; no blocks of runs) to a place, and return the number of files.

    Files of an earlier copy that these results lack are removed, and no other file. Raises an InputError as
    `refuse_foreign_place`.
    """
    refuse_foreign_place(url)
    local = owned_folder(folder, "results")
    names = sorted(name for name in local.names if local.place(name).is_file() and name not in _LAST)
    with _file_system(url) as (files, place):
        earlier_names: list[str] = []
        if files.exists(f"{place}/{CONTENTS}"):
            earlier_names = _read_names(files, place, url)
        for name in (*names, *_LAST):
            target = f"{place}/{name}"
            files.makedirs(target.rpartition("/")[0], exist_ok=True)
            files.put_file(str(folder / name), target)
        stale_names = set(earlier_names) - {*names, *_LAST}
        for name in stale_names:
            if files.exists(f"{place}/{name}"):
                files.rm_file(f"{place}/{name}")
    return len(names) + len(_LAST)


def fetch_results(url: str, folder: Path | None = None) -> Path:
    """Copy results from a place into a folder, and return the folder.

    Parameters
    ----------
    url : str
        Address of the results.
    folder : Path, optional
        New or empty folder; by default a temporary folder of this process.

    Raises
    ------
    InputError
        There are no results at the place, or the folder is not empty.
    """
    if folder is None:
        _temporary.append(TemporaryDirectory(prefix="lvnav-trade-", ignore_cleanup_errors=True))
        folder = Path(_temporary[-1].name)
    elif folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder}: is not empty; give another folder")
    local = owned_folder(folder, "results")
    with _file_system(url) as (files, place):
        if not files.exists(f"{place}/{MANIFEST}"):
            raise InputError(f"{url}: no results here (no {MANIFEST})")
        for name in (*_read_names(files, place, url), CONTENTS):
            if files.exists(f"{place}/{name}"):
                target = local.place(name)
                target.parent.mkdir(parents=True, exist_ok=True)
                files.get_file(f"{place}/{name}", str(target))
    return folder


def _read_names(files: Any, place: str, url: str) -> list[str]:
    """Return the names in the list of files at a place; InputError if there is no list of this tool."""
    foreign = InputError(f"{url}: holds what lvnav-trade did not copy there; nothing was changed; give another place")
    if not files.exists(f"{place}/{CONTENTS}"):
        raise foreign
    with TemporaryDirectory() as folder:  # read and checked as the list of a local folder
        Path(folder, CONTENTS).write_bytes(files.cat_file(f"{place}/{CONTENTS}"))
        try:
            return sorted(owned_folder(folder, "results").names)
        except InputError:
            raise foreign from None


@contextmanager
def _file_system(url: str) -> Iterator[tuple[Any, str]]:
    """Yield the file system of a place, and the path in it; errors of the file system become an InputError."""
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
        raise InputError(f"{url}: {_mask_credentials(error, url)}") from None
    except Exception as error:  # every file system has errors of its own
        raise InputError(f"{url}: cannot be reached: {_mask_credentials(error, url)}") from None


def _mask_credentials(error: Exception, url: str) -> str:
    """Return the first line of an error, without the credentials of the address, which it may quote."""
    line = str(error).strip().partition("\n")[0] or type(error).__name__
    for secret in credentials(url):
        line = line.replace(secret, "***")
    return line
