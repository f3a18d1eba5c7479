"""Progress of a campaign, read from its folder alone; nothing is run or changed."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from lvnav_trade.campaign.running.lock import holder
from lvnav_trade.campaign.text import table
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.input_files import refuse_irregular
from lvnav_trade.results.tables import parts as part_files
from lvnav_trade.results.tables.contents import MANIFEST
from lvnav_trade.results.tables.manifest import read_manifest
from lvnav_trade.results.tables.read import read_table, stored_table
from lvnav_trade.results.tables.schema import TABLES
from lvnav_trade.results.tables.versions import environment
from lvnav_trade.results.tables.write import difference, identity_of


class CaseStatus(NamedTuple):
    """Progress of one case."""

    id: str  # digest
    label: str
    asked: int  # runs required; the largest number if the case stops early
    stored: int  # runs stored in undamaged blocks
    failed: int  # stored runs that failed


class Status(NamedTuple):
    """Progress of a campaign.

    folder : Folder of its results.
    state : running, unfinished, damaged (the same command repairs it) or finished.
    holder : Process that works on it, if any.
    asked : Number of runs required, all cases.
    stored : Number of runs stored, all cases.
    failed : Number of stored runs that failed.
    cases : Progress of each case.
    damaged : One line per damaged file.
    lost : One line per work item that an error ended.
    workers_died : Number of workers that died.
    resumable : Reason why this version of the tool cannot resume the campaign; empty if it can.
    """

    folder: str
    state: str
    holder: str
    asked: int
    stored: int
    failed: int
    cases: tuple[CaseStatus, ...]
    damaged: tuple[str, ...]
    lost: tuple[str, ...]
    workers_died: int
    resumable: str

    @property
    def text(self) -> str:
        """The progress as text for printing; the first line is the summary."""
        what = {
            "running": f"running, {self.holder}",
            "unfinished": self.resumable or "unfinished; the same command resumes",
            "damaged": f"damaged; {self.resumable or 'the same command mends it'}",
            "finished": "finished" if not self.lost else "finished, but for what was lost; the same command goes on",
        }[self.state]
        failed = f", {self.failed} of them failed" if self.failed else ""
        lines = [f"{self.folder}: {what}: {self.stored} of {self.asked} runs are stored{failed}"]
        if self.workers_died:
            lines.append(f"workers that died: {self.workers_died}")
        lines += [f"damaged: {line}" for line in self.damaged] + [f"lost: {line}" for line in self.lost]
        return "\n".join([*lines, table(CaseStatus._fields, self.cases)])


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
    who, damaged = holder(folder), list[str]()
    is_finished = "finished" in manifest and not who
    finished = _finished_runs(folder) if is_finished else {}
    asked = manifest.get("asked_runs_of", {}) | {case: count for case, (count, _) in finished.items()}
    is_merged = is_finished and bool(manifest.get("blocks_removed"))
    cases = tuple(
        CaseStatus(case, label, finished[case][0], *finished[case])
        if is_merged and case in finished
        else _case(folder, manifest, case, label, asked.get(case, manifest.get("asked_runs", 0)), damaged)
        for case, label in manifest.get("asked_cases", {}).items()
    )
    for name in TABLES if is_finished else ():
        try:
            stored_table(folder, name)
        except InputError as error:
            damaged.append(str(error))
    sums = (sum(case.asked for case in cases), sum(case.stored for case in cases), sum(case.failed for case in cases))
    state = "running" if who else "unfinished" if not is_finished else "damaged" if damaged else "finished"
    other = difference(manifest, environment())
    why = f"was computed {other}; it goes on with that, or again with --fresh" if other else ""
    lost, died = tuple(manifest.get("lost", ())), manifest.get("workers_died", 0)
    return Status(str(folder), state, who, *sums, cases, tuple(damaged), lost, died, why)


def _case(
    folder: Path, manifest: Mapping[str, Any], case: str, label: str, asked: int, damaged: list[str]
) -> CaseStatus:
    """Count the runs in the blocks that a resumed campaign uses.

    Not counted are an incomplete last block of an earlier campaign with fewer runs, and runs beyond a decision.
    """
    stored = failed = 0
    block, identity = manifest.get("asked_block", 1), identity_of(manifest, case)
    for path in part_files.paths(folder / "parts" / case):
        first, count = part_files.span(path)
        if first % block or count != min(block, asked - first):
            continue
        try:
            summary = part_files.read(path, identity)
        except FileNotFoundError:  # replaced at this moment
            continue
        except (OSError, ValueError) as error:
            damaged.append(str(error))
            continue
        stored += count
        failed += int((summary.failed != 0).sum())
    return CaseStatus(case, label, asked, stored, failed)


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
