"""Writing results: parts while a campaign runs, tables and manifest at its end."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa

from lvnav_trade.engines.analysis.explain import Explanation
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.engines.setup.starts import StartDraws
from lvnav_trade.engines.simulate.statistics import BlockSummary, merge
from lvnav_trade.errors import InputError, writing
from lvnav_trade.input_files import read_bytes
from lvnav_trade.records import CovHistory, RunBlock
from lvnav_trade.steering.nozzle import Controlled
from lvnav_trade.store import designs, scratch
from lvnav_trade.store import parts as part_files
from lvnav_trade.store.contents import MANIFEST, RESOLVED, RUN_FILES, OwnedFolder, owned
from lvnav_trade.store.files import (
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
from lvnav_trade.store.manifest import DIGESTS, MANIFEST_BYTES, digests
from lvnav_trade.store.schema import TABLES, arrow_schema
from lvnav_trade.store.tables import CaseInfo, case_tables, row_tables, starts_table, traces_table
from lvnav_trade.store.versions import RESULTS_VERSION, across_machines, campaign_digest, environment

# Those that compute: another version of one may round otherwise
_LIBRARIES = tuple((name, f"with another {name}") for name in ("numpy", "numba", "scipy"))


Each = Callable[[Callable[..., Any], Sequence[tuple[Any, ...]]], Iterable[Any]]


def one_by_one(function: Callable[..., Any], units: Sequence[tuple[Any, ...]]) -> Iterable[Any]:
    """Yield function(*unit) of work items, in this process."""
    return (function(*unit) for unit in units)


class Results:
    """The folder of one campaign's results, open for writing."""

    def __init__(self, folder: OwnedFolder, manifest: dict[str, Any]) -> None:
        self.folder, self.owned, self.manifest = folder.folder, folder, manifest

    def case_folder(self, case_id: str) -> Path:
        """Return the folder that holds the parts of a case."""
        return self.folder / "parts" / case_id

    def identity_of_case(self, case_id: str) -> str:
        """Return what a part or scratch file of a case is computed from, as one text."""
        return identity_of(self.manifest, case_id)

    def write_part(self, case_id: str, summary: BlockSummary) -> Path:
        """Write a block's statistics in one step; a shorter part that starts at the same run is replaced."""
        return part_files.write(self.case_folder(case_id), summary, self.identity_of_case(case_id))

    def done(self, case_id: str) -> list[tuple[int, int]]:
        """Return (first run, number of runs) of each sound part; damaged ones, and those of another campaign, case or
        code, are deleted, with a warning.
        """
        part_files.drop_damaged(self.case_folder(case_id), self.identity_of_case(case_id))
        return [part_files.span(path) for path in part_files.paths(self.case_folder(case_id))]

    def parts(self, case_id: str, n_run: int | None = None) -> Iterator[BlockSummary]:
        """Return the parts of a case in run order, one in memory at a time, or those of the runs before `n_run`.

        ValueError where one of the runs before `n_run` is in no part, or a part is damaged.
        """
        return part_files.stream(self.case_folder(case_id), self.identity_of_case(case_id), n_run)

    def write_case(
        self,
        case: CaseInfo,
        prepared: Prepared,
        cov: CovHistory,
        parts: Iterable[BlockSummary] | None,
        explained: Explanation | None = None,
        starts: StartDraws | None = None,
        control: Controlled | None = None,
    ) -> None:
        """Write the tables of one case; `finish` puts the cases together.

        parts: of its runs, in their order, each let go when the next one comes; None without Monte Carlo.
        """
        folder = self.case_folder(case.id) / "tables"
        folder.mkdir(parents=True, exist_ok=True)
        summary = None
        with row_files(folder, row_tables(case.id, prepared.outputs, None)) as rows:
            if parts is not None:
                summary = merge(
                    rows.noted(parts, partial(row_tables, case.id, prepared.outputs, channels=prepared.channel_names)),
                    rows=False,
                )
        with row_files(folder, starts_table(case.id, None)) as rows:
            for piece in starts.pieces() if starts is not None else ():
                rows.add(starts_table(case.id, piece))
        for name, table in case_tables(case, prepared, cov, summary, explained, control).items():
            file = folder / f"{name}{CASE_TABLE}"
            if table.num_rows or table.num_columns > len(TABLES[name]) + 1:  # columns of this case's own
                write_case_table(table, file)
            else:
                file.unlink(missing_ok=True)

    def sizes(self, case_id: str) -> tuple[tuple[str, int], ...]:
        """Return name and size (bytes) of each table that is there of a case."""
        found = (self.case_folder(case_id) / "tables").glob(f"*{CASE_TABLE}")
        return tuple(sorted((path.name, path.stat().st_size) for path in found))

    def write_traces(self, case_id: str, prepared: Prepared, blocks: Iterable[RunBlock]) -> None:
        """Write what blocks of one run each leave of it over time, among the tables of the case."""
        table = traces_table(case_id, prepared.outputs, blocks)
        write_case_table(table, self.case_folder(case_id) / "tables" / f"traces{CASE_TABLE}")

    def take(self, folder: Path, cases: Iterable[str]) -> None:
        """Copy the parts and scratch files of cases that a shard has left in another folder of results."""
        for case in cases:
            for path in part_files.paths(folder / "parts" / case):
                self.case_folder(case).mkdir(parents=True, exist_ok=True)
                replace_file(self.case_folder(case) / path.name, path.read_bytes())
            scratch.copy(folder / scratch.FOLDER, self.folder / scratch.FOLDER, case)

    def leave(self, extra_manifest: dict[str, Any]) -> None:
        """Write the manifest of a shard, which has no tables."""
        self.manifest |= extra_manifest
        _write_json(self.folder / MANIFEST, self.manifest)

    def finish(
        self, extra_manifest: dict[str, Any], trace: Callable[[Path], None] | None = None, each: Each = one_by_one
    ) -> None:
        """Write the tables of all cases, no row group of two cases, and the manifest (which alone carries times).

        The cases come in the order of "cases", the digests in the order of the plan; those without tables are left out.
        `trace` is called when all tables but that of single runs over time are there, and may write those. `each` calls
        a function with work items, one a table: worker processes may do them.
        """
        found = [case for case in extra_manifest["cases"] if (self.case_folder(case) / "tables").is_dir()]
        self._merge_tables([name for name in TABLES if name not in ("traces", "designs")], found, each)
        if not (self.folder / designs.FILE).exists():
            self.owned.remove("run", [designs.FILE])
        if trace is not None:
            trace(self.folder)
        self._merge_tables(["traces"], found, one_by_one)
        self.manifest |= extra_manifest
        files = [self.folder / RESOLVED, *(self.folder / f"{name}.parquet" for name in TABLES)]
        self.manifest |= {
            DIGESTS: digests(files),
            "cases": found,
            "across_machines": across_machines(),
            "finished": _now(),
        }
        self.owned.claim("run", (), found)
        _write_json(self.folder / MANIFEST, self.manifest)

    def choose(self, cases: Mapping[str, str], about: Mapping[str, Any]) -> None:
        """List further cases (digest and label), and note what is said of them."""
        self.owned.claim("run", (), cases)
        self.manifest |= {"asked_cases": dict(cases), **about}
        _write_json(self.folder / MANIFEST, self.manifest)

    def write_designs(self, table: pa.Table) -> None:
        """Write the table of all designs of a campaign that stores a row for each."""
        about = {**(table.schema.metadata or {}), **self._about("designs")}
        replace_table(table.replace_schema_metadata(about), self.folder / designs.FILE)

    def _about(self, name: str) -> dict[str, str]:
        """Return what a table says of itself."""
        return {
            "lvnav_trade.table": name,
            "lvnav_trade.version": self.manifest["tool"],
            "lvnav_trade.campaign": self.manifest["campaign_digest"],
        }

    def remove_case_tables(self) -> None:
        """Remove the tables of single cases: those of all cases hold their rows, in less space."""
        self.owned.remove_case_tables()

    def remove_blocks(self) -> None:
        """Remove the blocks of runs: the tables hold every run, but more runs then begin again with the first."""
        self.owned.remove_blocks()

    def _merge_tables(self, names: Sequence[str], cases: Sequence[str], each: Each) -> None:
        """Write tables of all cases; of those without rows nothing is left."""
        written = each(self.merge_table, [(name, cases) for name in names])
        self.owned.remove("run", [f"{name}.parquet" for name, rows in written if not rows])

    def merge_table(self, name: str, cases: Sequence[str]) -> tuple[str, bool]:
        """Write a table of all cases from those of each, where it has rows; return its name, and whether it has."""
        of_cases = [self.case_folder(case) / "tables" / f"{name}{CASE_TABLE}" for case in cases]
        files = [file for file in of_cases if file.is_file()]  # those that are empty are not there
        if not any(map(has_rows, files)):
            return name, False
        every = dict.fromkeys(column for file in files for column in case_schema(file).names[1:])
        schema = arrow_schema(name, tuple(column for column in every if column not in TABLES[name]))
        schema = schema.with_metadata(self._about(name))
        with merged_table(self.folder / f"{name}.parquet", schema) as write:
            for table in chain.from_iterable(map(batches, files)):
                write(_widen(table, schema))
        return name, True


def _widen(table: pa.Table, schema: pa.Schema) -> pa.Table:
    """Return the table with all columns of the schema; those that this case lacks are empty."""
    filled = [
        table[field.name] if field.name in table.schema.names else pa.nulls(table.num_rows, field.type)
        for field in schema
    ]
    return pa.table(filled, schema=schema)


def open_results(
    folder: Path,
    campaign_name: str,
    resolved_yaml: str,
    manifest: dict[str, Any],
    mode: Literal["resume", "fresh"] = "resume",
) -> Results:
    """Open the folder of a campaign's results for writing.

    With "resume", parts that are there are kept; InputError where they come from another campaign (apart from its
    number of runs, requirements, references and report) or from another version of the code. With "fresh" the files
    that the folder lists as written by the tool are deleted. InputError where the folder holds anything else (see
    `contents.owned`) or cannot be written.
    """
    folder = Path(folder)
    place = owned(folder, "results")
    identity = {"campaign": campaign_name, "campaign_digest": campaign_digest(resolved_yaml), **environment()}
    with writing(folder, "the results folder cannot be written", resumes=True):
        if mode == "fresh":
            place.clear()
        else:
            _refuse_other(folder, identity)
        place.claim("run", RUN_FILES, manifest.get("asked_cases", ()))
        place.sweep()
        replace_file(folder / RESOLVED, resolved_yaml)
        results = Results(place, {**manifest, **identity, "created": _now()})
        _write_json(folder / MANIFEST, results.manifest)
    return results


def _refuse_other(folder: Path, identity: dict[str, str]) -> None:
    path = folder / MANIFEST
    if not path.exists():
        return
    try:
        held = json.loads(read_bytes(path, MANIFEST_BYTES).decode())
        if not isinstance(held, dict):
            raise ValueError("no JSON object")
    except ValueError as error:
        raise InputError(f"{path}: not a manifest ({error}); use --fresh to start again") from error
    if held.get("campaign_digest") != identity["campaign_digest"]:
        raise InputError(f"{folder}: holds the results of another campaign; use --fresh, or another folder")
    other = difference(held, identity)
    if other:
        raise InputError(f"{folder}: was computed {other}; use --fresh")


def difference(held: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Return by which other code results were computed than that of `now`; empty where by the same."""
    for key, what in (("tool", "by another version"), ("code_digest", "by another code"), *_LIBRARIES):
        if held.get(key) != now[key]:
            return f"{what} ({held.get(key)}, this is {now[key]})"
    return ""


def identity_of(manifest: Mapping[str, Any], case_id: str) -> str:
    """Return what two parts of a case must have in common to be merged, as one text."""
    keys = ("campaign_digest", "seed", "tool", "code_digest", *(name for name, _ in _LIBRARIES))
    campaign = " ".join(f"{key}={manifest.get(key, '')}" for key in keys)
    return f"results={RESULTS_VERSION} {campaign} case={case_id}"


def _write_json(path: Path, content: dict[str, Any]) -> None:
    replace_file(path, json.dumps(content, indent=2, sort_keys=True, default=str) + "\n")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
