"""Replay of one run, bit for bit, with every covariance step recorded."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.running.work import FAILURE_REASONS, Job, WorkOutcome, message_of, navigation, prepared_of
from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.results.tables.table_files import replacing

if TYPE_CHECKING:
    import pandas as pd


class RunReplay(NamedTuple):
    """A replayed run.

    trace : One row per covariance step: errors and formal sigmas, SI, units at the end of column names.
    event_errors : In order of time: event, time (s), magnitude of the error by quantity, display unit by quantity.
    failure : Reason why the run failed; empty if it succeeded.
    """

    trace: pd.DataFrame
    event_errors: tuple[tuple[str, float, dict[str, float], dict[str, str]], ...]
    failure: str


def find(cases: Sequence[Case], identifier: str) -> Case:
    """Return the case with a label, a digest or the first digits of a digest.

    Raises
    ------
    InputError
        No case, or more than one case, fits.
    """
    fitting = [case for case in cases if case.label == identifier or case.id.startswith(identifier)]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        fitting_ids = ", ".join(case.id for case in fitting)
        raise InputError(f"{identifier!r} fits several cases, give more of one: {fitting_ids}")
    names = [name for case in cases for name in (case.id, case.label)]
    all_ids = ", ".join(case.id for case in cases)
    raise InputError(f"no case {identifier!r}{hint(identifier, names)}; the cases are {all_ids}")


def replay(campaign: Campaign, case: Case, run: int) -> RunReplay:
    """Repeat a run of a case.

    Parameters
    ----------
    campaign : Campaign
        Campaign with the seed.
    case : Case
        One of its cases.
    run : int
        Number of the run, from 0.

    Raises
    ------
    InputError
        The number is negative.
    """
    from lvnav_trade.simulation import montecarlo
    from lvnav_trade.simulation.preparation.prepare import prepare

    if run < 0:
        raise InputError(f"run {run}: runs are counted from 0")
    prepared_case = prepare(case.scenario, campaign.keep.history)
    block = montecarlo.replay(prepared_case, campaign.seed, run)
    failure = FAILURE_REASONS.get(int(block.failed[0]), "")  # code 0 is success
    return RunReplay(_trace(block, prepared_case.outputs), _event_errors(block, prepared_case), failure)


def trace(job: Job, case: Case, runs: Sequence[int]) -> WorkOutcome:
    """Repeat runs of a case and write their errors over time to its tables, as one work item."""
    try:
        prepared_case = prepared_of(job, case)
        blocks = (job.engine.run_block(prepared_case, job.seed, run, 1) for run in runs)
        job.results.write_traces(case.id, prepared_case, blocks)
        return WorkOutcome(case.id, 0, 0)
    except Exception as error:
        return WorkOutcome(case.id, 0, 0, error=message_of(error))


def write_trace(run_replay: RunReplay, folder: Path, case: Case, run: int) -> Path:
    """Write the trace of a replayed run as a Parquet file.

    Parameters
    ----------
    run_replay : RunReplay
        The replayed run.
    folder : Path
        Folder of results; the file is written to its folder `traces`.
    case : Case
        The case.
    run : int
        Number of the run, from 0.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    InputError
        A file with this name is not a trace, or cannot be replaced.
    """
    place = folder / "traces"
    path = place / f"{case.id}-{run}.parquet"
    with writing(path, "cannot be written", resumes=True):
        if place.is_symlink() or (os.path.lexists(path) and not _is_trace(path)):
            raise InputError(f"{path}: was not written by lvnav-trade; move it, or give another folder")
        place.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            run_replay.trace.to_parquet(temporary, compression="zstd", index=False)
    return path


def _is_trace(path: Path) -> bool:
    """Whether a file is regular and has the columns of a trace."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if path.is_symlink() or not path.is_file():
        return False
    try:
        return {"t_s", "nees_ratio"} <= set(pq.read_schema(path).names)
    except (OSError, pa.ArrowException):
        return False


def _trace(block: Any, outputs: Sequence[Any]) -> pd.DataFrame:
    import pandas as pd

    from lvnav_trade.results.tables.dictionary import SI_SUFFIX, error_column

    columns = {"t_s": block.t}
    for index, output in enumerate(outputs):
        error_name = error_column(output.quantity, output.axis, output.unit)
        sigma_name = f"{output.quantity}_{output.axis}_sigma_{SI_SUFFIX[output.unit]}"
        columns[error_name] = block.err[0, :, index]
        columns[sigma_name] = block.sigma[0, :, index]
    columns["nees_ratio"] = block.nees[0]
    return pd.DataFrame(columns)


def _event_errors(block: Any, prepared_case: Any) -> tuple[tuple[str, float, dict[str, float], dict[str, str]], ...]:
    """Return `RunReplay.event_errors` of a block of one run."""
    events = prepared_case.trajectory.events
    rows = []
    for name in sorted(events, key=lambda name: float(events[name])):
        t = float(events[name])
        step = int(np.argmin(np.abs(block.t - t)))
        sizes = {}
        units = {}
        for label, components in navigation(prepared_case.outputs):
            error = block.err[0, step, components]
            error_norm = float(np.linalg.norm(error))
            sizes[label.quantity] = error_norm * label.label_factor
            units[label.quantity] = label.label_unit
        rows.append((name, t, sizes, units))
    return tuple(rows)
