"""Cache files of compiled kernels: verified when read, written by one process at a time; failures are not fatal."""

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
    """Index of the compiled versions of a function and a file for each version, with a digest of their content.

    A file counts as missing if it is damaged, from another version of numba, or compiled for other arguments than in
    the index. The kernel is then compiled again and the file replaced.
    """

    def load(self, key: Any) -> Any:
        """Return the version for a key (argument types, processor, byte code); None if there is none."""
        name = self._load_index().get(key)
        entry = None if name is None else self._read(name)
        return entry[1] if entry is not None and entry[0] == key else None

    def save(self, key: Any, data: Any) -> None:
        """Write a version. A lock on the index prevents two processes from using one file name for two versions."""
        with self._lock_files():
            super().save(key, (key, data))

    def _load_index(self) -> dict[Any, str]:
        return self._read(self._index_name) or {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_name, overloads)

    def _save_data(self, name: str, data: Any) -> None:
        self._write(name, data)

    def _read(self, name: str) -> Any:
        try:
            content = Path(self._cache_path, name).read_bytes()
        except OSError:
            return None
        digest = content[:_DIGEST]
        data = content[_DIGEST:]
        return pickle.loads(data) if self._digest(data) == digest else None

    def _write(self, name: str, value: Any) -> None:
        content = self._dump(value)
        with self._open_for_write(os.path.join(self._cache_path, name)) as file:
            file.write(self._digest(content) + content)

    def _digest(self, content: bytes) -> bytes:
        return hashlib.sha256(repr((numba.__version__, self._source_stamp)).encode() + content).digest()

    @contextmanager
    def _lock_files(self) -> Iterator[None]:
        """Lock the files of this folder, if the file system supports it; otherwise `load` detects inconsistencies."""
        from filelock import FileLock, Timeout  # imported by the few processes that compile

        lock = FileLock(Path(self._cache_path, _LOCK))
        with suppress(Timeout, NotImplementedError, OSError):
            lock.acquire(timeout=_LOCK_S)
        try:
            yield
        finally:
            lock.release()


class _CacheLocator(CompileResultCacheImpl._locator_classes[0]):  # type: ignore[misc]
    """Locator of the cache folder of this version of the kernels. A failure to write appears when a kernel is saved."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        return cls(py_func, py_file) if os.path.exists(py_file) else None


class _StoredFunction(CompileResultCacheImpl):  # type: ignore[misc]
    """Stored form of a function, without the listing of its types, which would take a fifth of the folder."""

    _locator_classes = (_CacheLocator,)

    def reduce(self, cres: Any) -> Any:
        cres.library.is_entry = not cres.library.is_part
        return cres._replace(type_annotation="")._reduce()


class KernelCache(FunctionCache):  # type: ignore[misc]
    """Compiled versions of a kernel on disk. A version that cannot be saved is used nevertheless."""

    _impl_class = _StoredFunction

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = CheckedFiles(self._cache_path, self._impl.filename_base, stamp)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a version; if the system does not permit it, log a warning."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _warn_not_stored(os.strerror(error.errno) if error.errno else str(error))


@cache
def _warn_not_stored(reason: str) -> None:
    """Log once per process that kernels cannot be stored."""
    _LOG.warning(
        "compiled kernels cannot be stored in %s (%s); every command compiles them again until NUMBA_CACHE_DIR is a "
        "folder that can be written",
        Path(numba.config.CACHE_DIR).parent,
        reason,
    )
