"""Writing of results: blocks of runs while a campaign runs, tables and manifest at its end."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa

from lvnav_trade.covariance.diagnostics.case_diagnostics import CaseDiagnostics
from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.quantities.input_files import read_bytes
from lvnav_trade.quantities.records import CovHistory, RunBlock
from lvnav_trade.results.tables import design_tables, scratch
from lvnav_trade.results.tables import parts as part_files
from lvnav_trade.results.tables.contents import (
    DIGESTS,
    MANIFEST,
    MANIFEST_BYTES,
    RESOLVED,
    RUN_FILES,
    OwnedFolder,
    digests,
    owned_folder,
)
from lvnav_trade.results.tables.dictionary import TABLES, arrow_schema
from lvnav_trade.results.tables.engine_tables import CaseInfo, case_tables, row_tables, starts_table, traces_table
from lvnav_trade.results.tables.table_files import (
    CASE_TABLE,
    batches,
    case_schema,
    has_rows,
    merged_table,
    replace_file,
    replace_table,
    row_files,
    write_case_table,
)
from lvnav_trade.results.tables.versions import across_machines, campaign_digest, environment, results_version
from lvnav_trade.simulation.nozzle import NozzleStatistics
from lvnav_trade.simulation.preparation.initial_draws import InitialDraws
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.simulation.statistics import BlockSummary, merge

# Libraries whose version affects rounding
_LIBRARIES = ("numpy", "numba", "scipy")


TaskRunner = Callable[[Callable[..., Any], Sequence[tuple[Any, ...]]], Iterable[Any]]


def run_serially(function: Callable[..., Any], items: Sequence[tuple[Any, ...]]) -> Iterable[Any]:
    """Call a function for every work item, in this process."""
    return (function(*item) for item in items)


class ResultsWriter:
    """Folder of the results of a campaign, open for writing."""

    def __init__(self, folder: OwnedFolder, manifest: dict[str, Any]) -> None:
        self.folder, self.owned_folder, self.manifest = folder.folder, folder, manifest

    def case_folder(self, case_id: str) -> Path:
        """Return the folder of the parts of a case."""
        return self.folder / "parts" / case_id

    def identity_of_case(self, case_id: str) -> str:
        """Return the origin of a part or scratch file of a case, as text."""
        return identity_of(self.manifest, case_id)

    def write_block(self, case_id: str, summary: BlockSummary) -> Path:
        """Write the statistics of a block atomically; a shorter part with the same first run is replaced."""
        return part_files.write(self.case_folder(case_id), summary, self.identity_of_case(case_id))

    def block_spans(self, case_id: str) -> list[tuple[int, int]]:
        """Return first run and number of runs of each valid part.

        Parts that are damaged, or of another campaign, case or code, are deleted with a warning.
        """
        part_files.drop_damaged(self.case_folder(case_id), self.identity_of_case(case_id))
        return [part_files.span(path) for path in part_files.paths(self.case_folder(case_id))]

    def block_summaries(self, case_id: str, n_run: int | None = None) -> Iterator[BlockSummary]:
        """Return the statistics of the parts of a case (of its first `n_run` runs) in order, one in memory at a time.

        A ValueError is raised if such a run is missing or a part is damaged.
        """
        return part_files.stream(self.case_folder(case_id), self.identity_of_case(case_id), n_run)

    def write_case(
        self,
        case: CaseInfo,
        prepared_case: PreparedCase,
        cov: CovHistory,
        summaries: Iterable[BlockSummary] | None,
        diagnostics: CaseDiagnostics | None = None,
        starts: InitialDraws | None = None,
        control: NozzleStatistics | None = None,
    ) -> None:
        """Write the tables of one case; `finish` merges the cases.

        Parameters
        ----------
        case : CaseInfo
            Digest, label, axes.
        prepared_case : PreparedCase
            The prepared scenario.
        cov : CovHistory
            Its linear covariance.
        summaries : iterable of BlockSummary or None
            Statistics of its runs in their order, one in memory at a time; None without Monte Carlo.
        diagnostics : CaseDiagnostics, optional
            Covariance diagnostics.
        starts : InitialDraws, optional
            Initial and turn-on draws of the runs.
        control : NozzleStatistics, optional
            Simulation of the vehicle under attitude control.
        """
        folder = self.case_folder(case.id) / "tables"
        folder.mkdir(parents=True, exist_ok=True)
        summary = None
        with row_files(folder, row_tables(case.id, prepared_case.outputs, None)) as rows:
            if summaries is not None:
                tables = partial(row_tables, case.id, prepared_case.outputs, channels=prepared_case.channel_names)
                summary = merge(rows.record_tables(summaries, tables), rows=False)
        with row_files(folder, starts_table(case.id, None)) as rows:
            if starts is not None:
                for piece in starts.pieces():
                    rows.add(starts_table(case.id, piece))
        for name, table in case_tables(case, prepared_case, cov, summary, diagnostics, control).items():
            file = folder / f"{name}{CASE_TABLE}"
            has_output_columns = table.num_columns > len(TABLES[name]) + 1
            if table.num_rows or has_output_columns:
                write_case_table(table, file)
            else:
                file.unlink(missing_ok=True)

    def sizes(self, case_id: str) -> tuple[tuple[str, int], ...]:
        """Return name and size (bytes) of each existing table of a case."""
        files = (self.case_folder(case_id) / "tables").glob(f"*{CASE_TABLE}")
        return tuple(sorted((path.name, path.stat().st_size) for path in files))

    def write_traces(self, case_id: str, prepared_case: PreparedCase, blocks: Iterable[RunBlock]) -> None:
        """Write time histories of runs, given as blocks of one run each, to the tables of a case."""
        table = traces_table(case_id, prepared_case.outputs, blocks)
        write_case_table(table, self.case_folder(case_id) / "tables" / f"traces{CASE_TABLE}")

    def copy_cases(self, folder: Path, cases: Iterable[str]) -> None:
        """Copy the parts and scratch files of cases from the folder of a shard."""
        for case in cases:
            for path in part_files.paths(folder / "parts" / case):
                self.case_folder(case).mkdir(parents=True, exist_ok=True)
                replace_file(self.case_folder(case) / path.name, path.read_bytes())
            scratch.copy(folder / scratch.FOLDER, self.folder / scratch.FOLDER, case)

    def finish_shard(self, extra_manifest: dict[str, Any]) -> None:
        """Finish a shard: write its manifest; a shard has no tables."""
        self.manifest |= extra_manifest
        _write_json(self.folder / MANIFEST, self.manifest)

    def finish(
        self,
        extra_manifest: dict[str, Any],
        trace: Callable[[Path], None] | None = None,
        task_runner: TaskRunner = run_serially,
    ) -> None:
        """Write the tables of all cases, and the manifest, which is the only file with times of day.

        No row group has rows of two cases.

        Parameters
        ----------
        extra_manifest : dict
            Further entries of the manifest, among them "cases": digests in the order of the plan. Cases without tables
            are omitted.
        trace : callable, optional
            Called when all tables except the time histories of single runs exist; it may write these.
        task_runner : callable
            Calls a function for work items, one per table, possibly by worker processes.
        """
        cases_with_tables = [case for case in extra_manifest["cases"] if (self.case_folder(case) / "tables").is_dir()]
        merged_names = [name for name in TABLES if name not in ("traces", "designs")]
        self._merge_tables(merged_names, cases_with_tables, task_runner)
        if not (self.folder / design_tables.FILE).exists():
            self.owned_folder.remove("run", [design_tables.FILE])
        if trace is not None:
            trace(self.folder)
        self._merge_tables(["traces"], cases_with_tables, run_serially)
        self.manifest |= extra_manifest
        files = [self.folder / RESOLVED, *(self.folder / f"{name}.parquet" for name in TABLES)]
        self.manifest |= {
            DIGESTS: digests(files),
            "cases": cases_with_tables,
            "across_machines": across_machines(),
            "finished": _now(),
        }
        self.owned_folder.claim("run", (), cases_with_tables)
        _write_json(self.folder / MANIFEST, self.manifest)

    def add_cases(self, cases: Mapping[str, str], entries: Mapping[str, Any]) -> None:
        """Add cases (label by digest) and further entries to the manifest."""
        self.owned_folder.claim("run", (), cases)
        self.manifest |= {"asked_cases": dict(cases), **entries}
        _write_json(self.folder / MANIFEST, self.manifest)

    def write_designs(self, table: pa.Table) -> None:
        """Write the table of all designs of a design space."""
        metadata = {**(table.schema.metadata or {}), **self._metadata("designs")}
        replace_table(table.replace_schema_metadata(metadata), self.folder / design_tables.FILE)

    def _metadata(self, name: str) -> dict[str, str]:
        """Return the metadata of a table."""
        return {
            "lvnav_trade.table": name,
            "lvnav_trade.version": self.manifest["tool"],
            "lvnav_trade.campaign": self.manifest["campaign_digest"],
        }

    def remove_case_tables(self) -> None:
        """Remove the tables of single cases, whose rows are in the tables of all cases."""
        self.owned_folder.remove_case_tables()

    def remove_blocks(self) -> None:
        """Remove the blocks of runs. Their results are in the tables, but further runs then start again with run 0."""
        self.owned_folder.remove_blocks()

    def _merge_tables(self, names: Sequence[str], cases: Sequence[str], task_runner: TaskRunner) -> None:
        """Write the tables of all cases, and remove earlier files of tables without rows."""
        merged_tables = task_runner(self.merge_table, [(name, cases) for name in names])
        self.owned_folder.remove("run", [f"{name}.parquet" for name, rows in merged_tables if not rows])

    def merge_table(self, name: str, cases: Sequence[str]) -> tuple[str, bool]:
        """Merge a table of all cases unless it has no rows; return its name and whether it has rows."""
        files = [self.case_folder(case) / "tables" / f"{name}{CASE_TABLE}" for case in cases]
        files = [file for file in files if file.is_file()]  # empty tables are not written
        if not any(map(has_rows, files)):
            return name, False
        further_columns: dict[str, None] = {}  # in order of their first case
        for file in files:
            for column in case_schema(file).names[1:]:
                if column not in TABLES[name]:
                    further_columns[column] = None
        schema = arrow_schema(name, tuple(further_columns)).with_metadata(self._metadata(name))
        with merged_table(self.folder / f"{name}.parquet", schema) as write:
            for file in files:
                for table in batches(file):
                    write(_fill_columns(table, schema))
        return name, True


def _fill_columns(table: pa.Table, schema: pa.Schema) -> pa.Table:
    """Return the table with all columns of the schema; columns missing in this case are empty."""
    columns = []
    for field in schema:
        if field.name in table.schema.names:
            columns.append(table[field.name])
        else:
            columns.append(pa.nulls(table.num_rows, field.type))
    return pa.table(columns, schema=schema)


def open_results(
    folder: Path,
    campaign_name: str,
    resolved_yaml: str,
    manifest: dict[str, Any],
    mode: Literal["resume", "fresh"] = "resume",
) -> ResultsWriter:
    """Open the folder of a campaign's results for writing.

    Parameters
    ----------
    folder : Path
        Folder of results; created if missing.
    campaign_name : str
        Name of the campaign.
    resolved_yaml : str
        The resolved campaign.
    manifest : dict
        Entries of the manifest that describe the request.
    mode : {"resume", "fresh"}
        Whether existing parts are used, or all files that the tool wrote there are deleted.

    Returns
    -------
    ResultsWriter
        The folder, open for writing.

    Raises
    ------
    InputError
        The folder contains other files (see `contents.owned_folder`) or cannot be written. With "resume": its parts are
        of another version of the code or of another campaign; the number of runs, requirements, references and report
        may differ.
    """
    folder = Path(folder)
    results_folder = owned_folder(folder, "results")
    identity = {"campaign": campaign_name, "campaign_digest": campaign_digest(resolved_yaml), **environment()}
    with writing(folder, "the results folder cannot be written", resumes=True):
        if mode == "fresh":
            results_folder.clear()
        else:
            _refuse_other_results(results_folder, identity)
        results_folder.claim("run", RUN_FILES, manifest.get("asked_cases", ()))
        results_folder.sweep()
        replace_file(folder / RESOLVED, resolved_yaml)
        results = ResultsWriter(results_folder, {**manifest, **identity, "created": _now()})
        _write_json(folder / MANIFEST, results.manifest)
    return results


def _refuse_other_results(results_folder: OwnedFolder, identity: dict[str, Any]) -> None:
    """Raise an InputError if a folder has results of another campaign or code."""
    folder = results_folder.folder
    path = folder / MANIFEST
    if not path.exists():
        return
    try:
        manifest = json.loads(read_bytes(path, MANIFEST_BYTES).decode())
        if not isinstance(manifest, dict):
            raise ValueError("no JSON object")
    except ValueError as error:
        raise InputError(f"{path}: not a manifest ({error}); use --fresh to start again") from error
    is_other_campaign = manifest.get("campaign_digest") != identity["campaign_digest"]
    other_code = difference(manifest, identity)
    if (is_other_campaign or other_code) and results_folder.is_without_results():
        results_folder.clear()  # a campaign that failed in its first case has only written its description
    elif is_other_campaign:
        raise InputError(f"{folder}: holds the results of another campaign; use --fresh, or another folder")
    elif other_code:
        raise InputError(f"{folder}: was computed {other_code}; use --fresh")


def difference(manifest: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Return how the code that computed results differs from that of `now`, in words; empty if it does not."""
    wording = {"tool": "by another version", "code_digest": "by another code"}
    wording |= {library: f"with another {library}" for library in _LIBRARIES}
    for key, words in wording.items():
        if manifest.get(key) != now[key]:
            return f"{words} ({manifest.get(key)}, this is {now[key]})"
    version = results_version(manifest)
    if version != now["results_version"]:
        return f"with other tables (version {version}, this is {now['results_version']})"
    return ""


def identity_of(manifest: Mapping[str, Any], case_id: str) -> str:
    """Return the origin of a case's parts as text; only parts of the same origin are merged."""
    keys = ("campaign_digest", "seed", "tool", "code_digest", *_LIBRARIES)
    campaign = " ".join(f"{key}={manifest.get(key, '')}" for key in keys)
    return f"results={results_version(manifest)} {campaign} case={case_id}"


def _write_json(path: Path, content: dict[str, Any]) -> None:
    replace_file(path, json.dumps(content, indent=2, sort_keys=True, default=str) + "\n")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
