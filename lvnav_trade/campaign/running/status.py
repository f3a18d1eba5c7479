"""Progress of a campaign, read from its folder alone, and the lock by which one process at a time works on it."""

import errno
import os
import platform
import re
import stat
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from filelock import FileLock, Timeout

from lvnav_trade.campaign.text import table
from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.quantities.input_files import refuse_irregular
from lvnav_trade.results.tables import parts as part_files
from lvnav_trade.results.tables.contents import MANIFEST, read_manifest
from lvnav_trade.results.tables.dictionary import TABLES
from lvnav_trade.results.tables.read import read_table, stored_table
from lvnav_trade.results.tables.table_files import replace_file
from lvnav_trade.results.tables.versions import environment
from lvnav_trade.results.tables.write import difference, identity_of

_NAME, _HOLDER = ".lock", ".lock-holder"
_LONGEST = 300
_CONTENT = re.compile(rb"(\d+ on [^\n]*)?")  # earlier versions wrote the holder into the lock itself
# Links are not followed, and opening a pipe does not block
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
_GLANCE_S = 0.1  # s, longer than `holder` keeps the lock to test it


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Lock a folder of results within a ``with`` block; InputError if another process has the lock.

    The operating system releases the lock of a killed process. A second file names the process that has the lock, since
    some systems do not permit reading a locked file. A folder that cannot be written raises an InputError as well.
    """
    with writing(folder, "cannot be written", resumes=True):
        folder.mkdir(parents=True, exist_ok=True)
        refuse_irregular(folder)
        for name in (_NAME, _HOLDER):
            if not _is_tool_file(folder / name):
                raise InputError(f"{folder / name}: is no lock of lvnav-trade; move it, or give another folder")
        (folder / _NAME).touch()
    lock = FileLock(folder / _NAME)
    with writing(folder, "cannot be locked"):
        if not _acquire(lock):
            time.sleep(_GLANCE_S)
            if not _acquire(lock):
                raise InputError(
                    f"{folder}: {_holder_text(folder)} is working on these results; wait, or give another folder"
                )
    try:
        replace_file(folder / _HOLDER, f"{os.getpid()} on {platform.node()}")
        yield
    finally:
        with suppress(OSError):
            (folder / _HOLDER).unlink(missing_ok=True)  # the name of the machine stays no longer than the lock
        lock.release()


def _is_tool_file(path: Path) -> bool:
    """Whether a file is missing or was written by this tool: no link, no file of the user."""
    try:
        handle = os.open(path, os.O_RDONLY | _NO_LINK)
    except FileNotFoundError:
        return True
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EMLINK, errno.ENXIO):  # a link; a socket
            return False
        raise
    try:
        is_file = stat.S_ISREG(os.fstat(handle).st_mode)
        return is_file and bool(_CONTENT.fullmatch(os.read(handle, _LONGEST + 1)))
    finally:
        os.close(handle)


def holder(folder: Path) -> str:
    """Return the process that works on a folder of results, such as "process 12 on host"; empty if there is none."""
    if not (folder / _NAME).is_file():
        return ""
    lock = FileLock(folder / _NAME)
    try:
        is_free = _acquire(lock)
        lock.release()
    except (OSError, NotImplementedError):  # not ours to lock, or a file system without locks
        return ""
    return "" if is_free else _holder_text(folder)


def _acquire(lock: FileLock) -> bool:
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return False
    except NotImplementedError as error:
        raise OSError(38, "the file system has no locks") from error
    return True


def _holder_text(folder: Path) -> str:
    try:
        text = (folder / _HOLDER).read_text(errors="replace")[:200] if _is_tool_file(folder / _HOLDER) else ""
    except OSError:
        text = ""
    return f"process {text}" if text else "another process"


class CaseStatus(NamedTuple):
    """Progress of one case."""

    id: str  # digest
    label: str  # label of the case
    required_runs: int  # runs required; the largest number if the case stops early
    stored_runs: int  # runs stored in undamaged blocks
    failed_runs: int  # stored runs that failed


class Status(NamedTuple):
    """Progress of a campaign.

    folder : Folder of its results.
    state : running, unfinished, damaged (the same command repairs it) or finished.
    holder : Process that works on it, if any.
    required_runs : Number of runs required, all cases.
    stored_runs : Number of runs stored, all cases.
    failed_runs : Number of stored runs that failed.
    cases : Progress of each case.
    damaged_files : One line per damaged file.
    lost_items : One line per work item that an error ended.
    workers_died : Number of workers that died.
    resume_obstacle : Reason why this version of the tool cannot resume the campaign; empty if it can.
    """

    folder: str
    state: str
    holder: str
    required_runs: int
    stored_runs: int
    failed_runs: int
    cases: tuple[CaseStatus, ...]
    damaged_files: tuple[str, ...]
    lost_items: tuple[str, ...]
    workers_died: int
    resume_obstacle: str

    @property
    def text(self) -> str:
        """The progress as text for printing; the first line is the summary."""
        state = {
            "running": f"running, {self.holder}",
            "unfinished": self.resume_obstacle or "unfinished; the same command resumes",
            "damaged": f"damaged; {self.resume_obstacle or 'the same command mends it'}",
            "finished": "finished",
        }[self.state]
        if self.state == "finished" and self.lost_items:
            state = "finished, except for lost work items; the same command computes them"
        summary = f"{self.folder}: {state}: {self.stored_runs} of {self.required_runs} runs are stored"
        if self.failed_runs:
            summary += f", {self.failed_runs} of them failed"
        lines = [summary]
        if self.workers_died:
            lines.append(f"workers that died: {self.workers_died}")
        lines += [f"damaged: {line}" for line in self.damaged_files]
        lines += [f"lost: {line}" for line in self.lost_items]
        lines.append(table(CaseStatus._fields, self.cases))
        return "\n".join(lines)


def status(folder: Path) -> Status:
    """Return the progress of a campaign; InputError if the folder has no results.

    Every block of runs is read and its checksum verified, and so is every table of a finished campaign.
    """
    path = folder / MANIFEST
    refuse_irregular(folder)
    if not path.exists():
        raise InputError(f"{folder}: no results here (no {MANIFEST})")
    manifest = read_manifest(path)
    if "created" not in manifest:
        raise InputError(f"{folder}: is a kept base, which has no blocks; give a folder of results")
    working_process = holder(folder)
    is_finished = "finished" in manifest and not working_process
    damage_messages: list[str] = []
    cases = _case_statuses(folder, manifest, is_finished, damage_messages)
    if is_finished:
        for name in TABLES:
            try:
                stored_table(folder, name)
            except InputError as error:
                damage_messages.append(str(error))
    if working_process:
        state = "running"
    elif not is_finished:
        state = "unfinished"
    else:
        state = "damaged" if damage_messages else "finished"
    version = difference(manifest, environment())
    return Status(
        folder=str(folder),
        state=state,
        holder=working_process,
        required_runs=sum(case.required_runs for case in cases),
        stored_runs=sum(case.stored_runs for case in cases),
        failed_runs=sum(case.failed_runs for case in cases),
        cases=cases,
        damaged_files=tuple(damage_messages),
        lost_items=tuple(manifest.get("lost", ())),
        workers_died=manifest.get("workers_died", 0),
        resume_obstacle=f"was computed {version}; it goes on with that, or again with --fresh" if version else "",
    )


def _case_statuses(
    folder: Path, manifest: Mapping[str, Any], is_finished: bool, damage_messages: list[str]
) -> tuple[CaseStatus, ...]:
    """Return the progress of every case.

    Parameters
    ----------
    folder : Path
        Folder of results.
    manifest : mapping
        Manifest of the results.
    is_finished : bool
        Whether the campaign is finished.
    damage_messages : list of str
        List to which a message is added for each damaged block.
    """
    finished_runs = _finished_runs(folder) if is_finished else {}
    are_blocks_removed = is_finished and bool(manifest.get("blocks_removed"))
    statuses = []
    for case, label in manifest.get("asked_cases", {}).items():
        required_runs = manifest.get("asked_runs_of", {}).get(case, manifest.get("asked_runs", 0))
        if case in finished_runs:
            required_runs, failed_runs = finished_runs[case]
            if are_blocks_removed:
                statuses.append(CaseStatus(case, label, required_runs, required_runs, failed_runs))
                continue
        statuses.append(_case_status(folder, manifest, case, label, required_runs, damage_messages))
    return tuple(statuses)


def _case_status(
    folder: Path, manifest: Mapping[str, Any], case: str, label: str, required_runs: int, damage_messages: list[str]
) -> CaseStatus:
    """Count the runs in the blocks that a resumed campaign uses.

    Not counted are an incomplete last block of an earlier campaign with fewer runs, and runs beyond a decision.

    Parameters
    ----------
    folder : Path
        Folder of results.
    manifest : mapping
        Manifest of the results.
    case, label : str
        Digest and label of the case.
    required_runs : int
        Runs that the campaign requires of the case.
    damage_messages : list of str
        List to which a message is added for each damaged block.
    """
    stored_runs = failed_runs = 0
    block, identity = manifest.get("asked_block", 1), identity_of(manifest, case)
    for path in part_files.paths(folder / "parts" / case):
        first, count = part_files.span(path)
        if first % block or count != min(block, required_runs - first):
            continue
        try:
            summary = part_files.read(path, identity)
        except FileNotFoundError:  # replaced at this moment
            continue
        except (OSError, ValueError) as error:
            damage_messages.append(str(error))
            continue
        stored_runs += count
        failed_runs += int((summary.failed != 0).sum())
    return CaseStatus(case, label, required_runs, stored_runs, failed_runs)


def _finished_runs(folder: Path) -> Mapping[str, tuple[int, int]]:
    """Return the number of runs and of failed runs of each case of a finished campaign, by digest.

    A case that was decided early has fewer runs than required.
    """
    try:
        cases = read_table(folder / "cases.parquet")
    except InputError:
        return {}
    counts = zip(cases["run_count"].to_pylist(), cases["failed_count"].to_pylist(), strict=True)
    return dict(zip(cases["case"].to_pylist(), counts, strict=True))
