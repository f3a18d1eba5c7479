"""Files of compiled kernels: checked when they are read, written by one process at a time, never a reason to stop."""

import hashlib
import logging
import os
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile

_LOG = logging.getLogger("lvnav_trade.kernels")
_DIGEST = hashlib.sha256().digest_size
_LOCK, _LOCK_S = ".lock", 10.0  # longer than a file takes to be written; a stopped process delays the others no more


class CheckedFiles(IndexDataCacheFile):  # type: ignore[misc]  # numba publishes no types
    """The index of a function's compiled versions and a file for each, all with a digest of their content.

    A file that is damaged, of another version of numba or compiled for other arguments than the index says counts as
    missing: the kernel is compiled again and the file replaced.
    """

    def load(self, key: Any) -> Any:
        """Return the version of a key (types of arguments, processor, byte code); None where there is none."""
        name = self._load_index().get(key)
        found = None if name is None else self._read(name)
        return found[1] if found is not None and found[0] == key else None

    def save(self, key: Any, data: Any) -> None:
        """Write a version. The index is read and written under a lock: else two processes could take one file name for
        two versions.
        """
        with self._locked():
            super().save(key, (key, data))

    def _load_index(self) -> dict[Any, str]:
        return self._read(self._index_name) or {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_name, overloads)

    def _save_data(self, name: str, data: Any) -> None:
        self._write(name, data)

    def _read(self, name: str) -> Any:
        try:
            found = Path(self._cache_path, name).read_bytes()
        except OSError:
            return None
        return pickle.loads(found[_DIGEST:]) if self._digest(found[_DIGEST:]) == found[:_DIGEST] else None

    def _write(self, name: str, value: Any) -> None:
        content = self._dump(value)
        with self._open_for_write(os.path.join(self._cache_path, name)) as file:
            file.write(self._digest(content) + content)

    def _digest(self, content: bytes) -> bytes:
        return hashlib.sha256(repr((numba.__version__, self._source_stamp)).encode() + content).digest()

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Work alone on the files of this folder, if its file system has locks: without, `load` finds what is wrong."""
        from filelock import FileLock, Timeout  # imported by the few processes that compile

        lock = FileLock(Path(self._cache_path, _LOCK))
        with suppress(Timeout, NotImplementedError, OSError):
            lock.acquire(timeout=_LOCK_S)
        try:
            yield
        finally:
            lock.release()


class _Place(CompileResultCacheImpl._locator_classes[0]):  # type: ignore[misc]
    """The folder of this version of the kernels. Whether it can be written shows when a kernel is saved."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        return cls(py_func, py_file) if os.path.exists(py_file) else None


class _Stored(CompileResultCacheImpl):  # type: ignore[misc]
    """What is stored of a function: without the listing of its types, a fifth of the folder that nobody reads."""

    _locator_classes = (_Place,)

    def reduce(self, cres: Any) -> Any:
        cres.library.is_entry = not cres.library.is_part
        return cres._replace(type_annotation="")._reduce()


class KernelCache(FunctionCache):  # type: ignore[misc]
    """The compiled versions of a kernel on disk. One that cannot be saved is used all the same."""

    _impl_class = _Stored

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = CheckedFiles(self._cache_path, self._impl.filename_base, stamp)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a version where the system permits it."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _warn_of_refusal(os.strerror(error.errno) if error.errno else str(error))


@cache
def _warn_of_refusal(why: str) -> None:
    """Say once in a process that kernels are not stored."""
    _LOG.warning(
        "compiled kernels cannot be stored in %s (%s); every command compiles them again until NUMBA_CACHE_DIR is a "
        "folder that can be written",
        Path(numba.config.CACHE_DIR).parent,
        why,
    )
