"""A small engine and a small store, so that execution is tested without flying and without Parquet."""

from __future__ import annotations

import os
import pickle
import signal
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.campaign.running.conduct import Store
from lvnav_trade.campaign.running.work import Engine
from lvnav_trade.covariance.diagnostics.case_diagnostics import CaseDiagnostics
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import CovHistory, Output

OUTPUTS = tuple(
    Output(quantity, axis, unit, label, factor)
    for quantity, unit, label, factor in (
        ("attitude", "rad", "mrad", 1e3),
        ("velocity", "m/s", "m/s", 1.0),
        ("position", "m", "m", 1.0),
    )
    for axis in "xyz"
)
EVENTS = {"liftoff": 0.0, "stage1_cutoff": 1.0, "injection": 2.0}


class Call(NamedTuple):
    """A unit of work that the engine was asked for."""

    what: str
    case: str
    first: int = 0
    n: int = 0


class Fake:
    """The engine's functions, and a record of the calls; `on_block` may raise, or return the numbers of failed runs."""

    def __init__(self, on_block: Any = None, on_covariance: Any = None, mean: float = 0.0) -> None:
        self.calls: list[Call] = []
        self.on_block, self.on_covariance, self.mean = on_block, on_covariance, mean

    def engine(self) -> Engine:
        return Engine(
            self.events, self.prepare, self.run_block, self.covariance, self.summarise, self.nothing, self.explain,
            self.beyond, self.nothing, self.nothing, self.effective_settings,
        )  # fmt: skip

    def nothing(self, *_: Any) -> None:
        """Compile nothing, draw nothing."""

    def effective_settings(self, prepared_case: Any, read: Any) -> None:
        """Know of no effect."""

    def beyond(self, requirements: Any, case: str, prepared_case: Any, covariance: CovHistory, summary: Any) -> Any:
        """Every fourth run of the unit called poor is beyond its bounds, none of the good one."""
        bad = sum(number % 4 == 0 for number in summary.numbers) if "poor" in prepared_case.name else 0
        return tuple(bad for _ in requirements)

    def events(self, scenario: Any) -> dict[str, float]:
        return dict(EVENTS)

    def prepare(self, scenario: Any, history: float) -> Any:
        return SimpleNamespace(
            name=f"{scenario.imu.name} {scenario.filter.name}",
            outputs=OUTPUTS,
            t_hist=np.array([0.0, 1.0, 2.0]),
            trajectory=SimpleNamespace(events=dict(EVENTS)),
        )

    def covariance(self, prepared_case: Any) -> CovHistory:
        self.calls.append(Call("covariance", prepared_case.name))
        if self.on_covariance:
            self.on_covariance(prepared_case)
        n, ones = len(OUTPUTS), np.ones((3, len(OUTPUTS)))
        full = np.zeros((3, n, n))
        return CovHistory(
            np.array([0.0, 1.0, 2.0]), ones, 2 * ones, self.mean * ones, ("a", "b"), np.ones((3, 2, n)), full, full,
            np.array([1.0]), np.array([8]), np.ones(3), np.ones(1), np.zeros(1), np.zeros((1, 8)),
        )  # fmt: skip

    def explain(self, scenario: Any, prepared_case: Any, covariance: CovHistory, asked: Any) -> Any:
        self.calls.append(Call("explain", prepared_case.name))
        return CaseDiagnostics("explained", weakest_direction=prepared_case.name)

    def run_block(self, prepared_case: Any, seed: int, first: int, n: int) -> Any:
        self.calls.append(Call("block", prepared_case.name, first, n))
        failed = np.zeros(n, dtype=np.int8)
        bad = self.on_block(first, n) if self.on_block else None
        failed[[run - first for run in bad or []]] = 2
        numbers = np.array([seed * 1000 + run for run in range(first, first + n)])
        return SimpleNamespace(first=first, numbers=numbers, failed=failed, t_failed=np.where(failed, 1.5, np.nan))

    def summarise(self, runs: Any, events: Any, scale: Any, outputs: Any) -> Any:
        assert events == EVENTS
        assert scale.shape == (3, len(OUTPUTS))
        return SimpleNamespace(first=runs.first, numbers=runs.numbers, first_run=runs.first, n_run=len(runs.numbers))


class Held:
    """Computes the first three blocks of a case and then waits for a file, so that something can happen meanwhile."""

    def __init__(self, gate: str) -> None:
        self.gate = Path(gate)

    def __call__(self, first: int, n: int) -> None:
        while first >= 120 and not self.gate.exists():
            time.sleep(0.05)


class Dies:
    """Ends the worker process at the second block, as the kernel does when memory is short."""

    def __call__(self, first: int, n: int) -> None:
        if first == 40:
            os._exit(9)


class DiesOnce:
    """Ends the worker process at the first block that comes after a mark was set, by the signal of a short memory."""

    def __init__(self, mark: str) -> None:
        self.mark = Path(mark)

    def __call__(self, first: int, n: int) -> None:
        try:
            self.mark.unlink()
        except FileNotFoundError:
            return
        os.kill(os.getpid(), signal.SIGKILL)


class Kept:
    """Results on disk: a pickle per block, one per case."""

    def __init__(self, folder: Path, resolved: str, mode: str, full_after: int | None) -> None:
        self.folder, self.resolved, self.full_after, self.written = folder, resolved, full_after, 0
        if mode == "fresh":
            for file in folder.glob("*.p*"):
                file.unlink()
        note = folder / "resolved.yaml"
        if (
            mode == "resume"
            and note.exists()
            and note.read_text().partition("runs:")[0] != resolved.partition("runs:")[0]
        ):
            raise InputError(f"{folder}: holds another campaign")
        note.write_text(resolved)

    def identity_of_case(self, case: str) -> str:
        return f"{self.resolved.partition('runs:')[0]} {case}"

    def write_block(self, case: str, summary: Any) -> None:
        if self.full_after is not None and self.written >= self.full_after:
            raise OSError(28, "No space left on device")
        self.written += 1
        name = f"{case}-{summary.first:06d}"
        (self.folder / f"{name}.part").write_bytes(pickle.dumps(summary))

    def _parts(self, case: str) -> list[Any]:
        return [pickle.loads(file.read_bytes()) for file in sorted(self.folder.glob(f"{case}-*.part"))]

    def block_summaries(self, case: str, n_run: int | None = None) -> list[Any]:
        return [part for part in self._parts(case) if n_run is None or part.first + len(part.numbers) <= n_run]

    def block_spans(self, case: str) -> list[tuple[int, int]]:
        return [(part.first, len(part.numbers)) for part in self._parts(case)]

    def write_case(
        self, info: Any, prepared_case: Any, covariance: CovHistory, parts: Any, explained: Any, *_: Any
    ) -> None:
        numbers = None if parts is None else np.concatenate([part.numbers for part in parts]).tolist()
        row = ((info.id, info.label, info.axes), covariance.sources, numbers, explained)
        (self.folder / f"{info.id}.pcase").write_bytes(pickle.dumps(row))

    def sizes(self, case: str) -> tuple[tuple[str, int], ...]:
        return tuple((file.name, file.stat().st_size) for file in self.folder.glob(f"{case}.pcase"))

    def finish_shard(self, extra: dict[str, Any]) -> None:
        (self.folder / "left").write_text(repr(extra["shard_finished"]))

    def finish(self, extra: dict[str, Any], *_: Any) -> None:
        (self.folder / "finished").write_text("\n".join(extra["cases"]))

    def remove_case_tables(self) -> None:
        (self.folder / "tidied").touch()


def store(full_after: int | None = None) -> Store:
    def open_results(folder: Path, name: str, resolved: str, manifest: dict[str, Any], mode: str) -> Kept:
        return Kept(folder, resolved, mode, full_after)

    return Store(open_results, lambda folder: None)


def tables(folder: Path) -> dict[str, Any]:
    """Return what each case's table holds, by label."""
    rows = [pickle.loads(file.read_bytes()) for file in sorted(folder.glob("*.pcase"))]
    return {row[0][1]: row for row in rows}
