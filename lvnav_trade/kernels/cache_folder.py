"""Folder of compiled kernels: one per version of the sources; temporary if the usual folder is read-only."""

import atexit
import hashlib
import logging
import os
import shutil
import stat
import tempfile
from pathlib import Path

_LOG = logging.getLogger("lvnav_trade.kernels")
_VARIABLE, _MARK = "NUMBA_CACHE_DIR", "kernels-"
_PLAIN = "LVNAV_TRADE_PLAIN_NUMBA"


def source_digest(package: Path) -> str:
    """Return a digest of every module that has or registers a kernel; numba's cache does not notice edits in called
    modules.
    """
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        text = path.read_bytes()
        if b"kernels.jit import" in text or b"Registration(" in text or path.parent.name == "kernels":
            digest.update(str(path.relative_to(package)).encode())
            digest.update(text)
    return digest.hexdigest()[:16]


def is_plain() -> bool:
    """Return whether kernels are compiled by unmodified numba (LVNAV_TRADE_PLAIN_NUMBA=1).

    The first run then takes twice as long to compile; results are the same.
    """
    return os.environ.get(_PLAIN, "0") != "0"


def set_cache_folder() -> None:
    """Set the cache folder of numba to that of this version of the kernels, before numba is first imported.

    The folder is below NUMBA_CACHE_DIR if set, else below XDG_CACHE_HOME or ``~/.cache``. If it is not writable, it is
    below a temporary folder that only this user can read, and a warning is logged. Worker processes inherit the choice.
    """
    root_setting = os.environ.get(_VARIABLE, "")
    if Path(root_setting).name.startswith(_MARK):
        return
    check_prefix = "checked-" if os.environ.get("NUMBA_BOUNDSCHECK", "0") != "0" else ""  # numba's files do not say
    plain_prefix = "plain-" if is_plain() else ""
    name = f"{_MARK}{plain_prefix}{check_prefix}{source_digest(Path(__file__).resolve().parents[1])}"
    root = _usual_root(root_setting)
    folder = root / name
    reason = _refusal(folder) if root.is_absolute() else "there is no home folder"
    if reason:
        folder = _temporary_root(name) / name
        _LOG.warning(
            "compiled kernels cannot be stored in %s (%s) and are in %s; set %s to a folder of yours that stays",
            root,
            reason,
            folder.parent,
            _VARIABLE,
        )
    os.environ[_VARIABLE] = str(folder)


def is_filled() -> bool:
    """Return whether a campaign starts without compilation: kernels are in the cache, or nothing is compiled."""
    is_interpreted = os.environ.get("NUMBA_DISABLE_JIT", "0") != "0"
    return is_interpreted or any(Path(os.environ.get(_VARIABLE, "")).glob("*/*.nbi"))


def _usual_root(root_setting: str) -> Path:
    """Return the folder for compiled kernels by the environment; relative if there is no home folder."""
    if root_setting:
        return Path(root_setting).absolute()
    caches = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(caches):
        caches = os.path.expanduser("~/.cache")
    return Path(caches, "lvnav_trade")


def _temporary_root(name: str) -> Path:
    """Return a temporary folder for compiled kernels: a shared one of this user, or a private one of this process.

    The shared folder is found again by the next command. It is not used if another user could write to it, because
    compiled kernels are executed.
    """
    user = os.getuid() if hasattr(os, "getuid") else 0
    shared_folder = Path(tempfile.gettempdir(), f"lvnav_trade-{user}")
    try:
        shared_folder.mkdir(mode=0o700, exist_ok=True)
        status = shared_folder.lstat()
    except OSError:
        status = None
    is_private = status is not None and status.st_uid == user and not status.st_mode & 0o077
    if is_private and status is not None and stat.S_ISDIR(status.st_mode) and not _refusal(shared_folder / name):
        return shared_folder
    private_folder, owner = tempfile.mkdtemp(prefix="lvnav_trade-"), os.getpid()

    def remove() -> None:
        if os.getpid() == owner:
            shutil.rmtree(private_folder, ignore_errors=True)

    atexit.register(remove)
    return Path(private_folder)


def _refusal(folder: Path) -> str:
    """Return the reason why a folder is not writable; empty if it is. A missing folder is created."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        return os.strerror(error.errno) if error.errno else str(error)
    return ""
