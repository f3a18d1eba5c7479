"""Folders that the tool writes: a list of their files, and the manifest, read even where it is damaged."""

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import lru_cache
from itertools import takewhile
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from lvnav_trade.quantities.errors import InputError, quoted, writing
from lvnav_trade.quantities.input_files import read_bytes
from lvnav_trade.results.tables import parts as part_files
from lvnav_trade.results.tables import scratch
from lvnav_trade.results.tables.dictionary import FEATURES, REPORTED, TABLES, TABLES_OF_VERSION_2
from lvnav_trade.results.tables.table_files import CASE_TABLE, replace_file

CONTENTS, RESOLVED, MANIFEST = "contents.json", "campaign.resolved.yaml", "manifest.json"
_BYTES = 2**26  # limit, far above the size of the list for the largest campaign
RUN_FILES = (MANIFEST, RESOLVED, *(f"{table}.parquet" for table in TABLES))
_EARLIER = {earlier: FEATURES[name] for name, earlier in TABLES_OF_VERSION_2.items()}  # tables with another name before
_STORED = FEATURES | _EARLIER
_MARK, _VERSION = "lvnav_trade_contents", 1
_CASE_TABLES = (CASE_TABLE, ".parquet")  # the second is the extension in earlier versions
_CASE = re.compile(r"\w[\w.-]*")
_NAME_BYTES = 255  # longest name in a folder on common file systems
_TEMPORARY = re.compile(r"^\.(.+)\.\d+$")
_GIVE_ANOTHER = "nothing was changed; give another folder"
Kind = Literal["results", "report", "study", "base", "code", "vectors"]
_KINDS: dict[str, str] = {
    "results": "the results of a campaign",
    "report": "a kept report",
    "study": "the kept report of a study",
    "base": "a kept base",
    "code": "the code of a filter",
    "vectors": "the reference vectors of a filter",
}


class OwnedFolder:
    """A folder whose files the tool lists in `contents.json`.

    Names are relative to the folder, with slashes. A name is listed before its file is written, so that all files of a
    killed process are listed. A file that is not listed is neither replaced nor removed. A listed name that leads out
    of the folder raises an InputError.

    Attributes
    ----------
    folder : Path
        The folder.
    cases : list of str
        Digests of the cases whose blocks, tables and scratch files are in the folder.
    """

    def __init__(
        self, folder: Path, kind: Kind, files: Mapping[str, list[str]], cases: Iterable[str], adopted: bool
    ) -> None:
        self.folder, self.kind, self.cases = folder, kind, sorted(set(cases))
        self._files, self._adopted = dict(files), adopted
        for name in self.names:
            self.place(name)
        for case in self.cases:
            self._place_case(case)

    @property
    def names(self) -> set[str]:
        """All listed names."""
        return {name for group in self._files.values() for name in group}

    def listed(self, group: str) -> list[str]:
        """Return the names of a group."""
        return list(self._files.get(group, ()))

    def claim(self, group: str, names: Iterable[str], cases: Iterable[str] = ()) -> None:
        """List names and cases that are about to be written, and create the folder if it is missing.

        An InputError is raised, before anything is changed, if a file with such a name exists and is not listed, or if
        a part of its path is a link. In a folder of results of an earlier version, which has no list, existing files of
        the report are assumed to be of the tool.
        """
        wanted, listed = sorted(set(names)), self.names
        for name in wanted:
            path = self.place(name)
            if path.is_symlink():
                raise InputError(f"{path}: is a link, which is not followed; {_GIVE_ANOTHER}")
            if name not in listed and not self._adopted and path.exists():
                raise InputError(f"{path}: was not written by lvnav-trade; move it, or give another folder")
        for case in cases:
            self._place_case(case)
        self._files[group] = sorted({*self._files.get(group, ()), *wanted})
        self.cases = sorted({*self.cases, *cases})
        self.folder.mkdir(parents=True, exist_ok=True)
        self._save()

    def publish(self, group: str, files: Mapping[str, bytes | str]) -> None:
        """Write the files of a group, each atomically, and remove other files that the group listed before.

        Raises an InputError as `claim`.
        """
        self.claim(group, files)
        for name, content in files.items():
            path = self.place(name)
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, content)
        for name in set(self._files[group]) - set(files):
            self._remove(self.place(name))
        self._files[group] = sorted(files)
        self._save()

    def remove(self, group: str, names: Iterable[str]) -> None:
        """Remove files of a group from the folder, and then from the list."""
        gone = set(names)
        for name in gone:
            self._remove(self.place(name))
        self._files[group] = [name for name in self._files.get(group, ()) if name not in gone]
        self._save()

    def is_without_results(self) -> bool:
        """Return whether the campaign that has the folder stored nothing: no table, no report, no block of runs."""
        described = {MANIFEST, RESOLVED}
        stored = any(self.place(name).exists() for name in self.names - described)
        return not stored and not any(part_files.paths(self._place_case(case)) for case in self.cases)

    def clear(self) -> None:
        """Remove all listed files, and folders that become empty."""
        for name in sorted(self.names):
            self._remove(self.place(name))
        self.remove_case_tables()
        self.remove_blocks()
        scratch.remove(self.folder / scratch.FOLDER, self.cases)
        self._files, self.cases = {}, []

    def remove_case_tables(self) -> None:
        """Remove the tables of single cases; blocks of runs remain."""
        for case in self.cases:
            folder = self._place_case(case) / "tables"
            for path in [folder / f"{table}{end}" for table in _STORED for end in _CASE_TABLES]:
                self._remove(path)

    def remove_blocks(self) -> None:
        """Remove the blocks of runs of all cases."""
        for case in self.cases:
            for path in part_files.paths(self._place_case(case)):
                self._remove(path)

    def sweep(self) -> None:
        """Remove temporary files of killed processes that belong to listed names."""
        own = {self.folder / CONTENTS, *map(self.place, self.names)}
        cases = {place / name for place in map(self._place_case, self.cases) for name in (".", "tables")}
        for place in cases | {path.parent for path in own}:
            for path in place.glob(".*.*"):
                name = _TEMPORARY.sub(r"\1", path.name)
                of_case = place in cases and (part_files.is_name(name) or PurePosixPath(name).stem in _STORED)
                if name != path.name and (of_case or place / name in own):
                    path.unlink(missing_ok=True)

    def place(self, name: str) -> Path:
        """Return the path of a name; InputError if it leads out of the folder."""
        parts = PurePosixPath(name).parts
        if not parts or ".." in parts or "\0" in name or PurePosixPath(name).is_absolute():
            raise InputError(f"{self.folder}: the name {name!r} leads out of the folder; {_GIVE_ANOTHER}")
        if any(len(os.fsencode(part)) > _NAME_BYTES for part in parts):
            raise InputError(
                f"{self.folder}: the name {quoted(name)} is longer than {_NAME_BYTES} bytes; {_GIVE_ANOTHER}"
            )
        path = self.folder
        for part in parts[:-1]:
            path = path / part
            if path.is_symlink():
                raise InputError(f"{path}: is a link, which is not followed; {_GIVE_ANOTHER}")
        return path / parts[-1]

    def _place_case(self, case: str) -> Path:
        if not _CASE.fullmatch(case):
            raise InputError(f"{self.folder}: {quoted(case)} is no digest of a case; {_GIVE_ANOTHER}")
        return self.place(f"parts/{case}/tables/x").parents[1]

    def _remove(self, path: Path) -> None:
        path.unlink(missing_ok=True)
        with suppress(OSError):  # a folder is not empty, or does not exist
            for place in takewhile(lambda place: place != self.folder, path.parents):
                place.rmdir()

    def _save(self) -> None:
        files = {group: names for group, names in sorted(self._files.items()) if names}
        content: dict[str, Any] = {_MARK: _VERSION, "kind": self.kind, "files": files, "cases": self.cases}
        if self.kind == "results":
            stored, shown = files.get("run", ()), files.get("report", ())
            content["tables"] = {name: feature for name, feature in _STORED.items() if f"{name}.parquet" in stored}
            content["tables"] |= {f"{name}.csv": of for name, of in REPORTED.items() if f"{name}.csv" in shown}
        replace_file(self.folder / CONTENTS, json.dumps(content, indent=1) + "\n")


def owned(folder: Path | str, kind: Kind) -> OwnedFolder:
    """Return a folder in which the tool may write files of one kind; nothing is changed.

    The folder is missing, empty (apart from hidden files), or contains only files of the same kind that the tool wrote.
    Results and bases of an earlier version, which have no list of their files, are recognised by their manifest.

    Parameters
    ----------
    folder : Path or str
        The folder.
    kind : str
        Kind of files: results, report, study, base, code or vectors.

    Returns
    -------
    OwnedFolder
        The folder with the list of its files.

    Raises
    ------
    InputError
        The folder contains files of the user or of another kind, or a listed name leads out of the folder.
    """
    folder = Path(folder)
    existing: list[str] = []
    with writing(folder, "the folder cannot be written", resumes=True), suppress(FileNotFoundError):
        existing = [name for name in os.listdir(folder) if not name.startswith(".")]
    if CONTENTS in existing:
        files, cases, present = _listed(folder)
    elif not existing:
        return OwnedFolder(folder, kind, {}, (), adopted=False)
    else:
        files, cases, present = _of_manifest(folder)
    if present != kind:
        raise InputError(f"{folder}: holds {_KINDS[present]}, not {_KINDS[kind]}; {_GIVE_ANOTHER}")
    return OwnedFolder(folder, kind, files, cases, adopted=CONTENTS not in existing)


def is_without_rows(folder: Path, table: str) -> bool:
    """Whether results lack a table because it has no rows: its stored name is missing in their list of tables."""
    tables = _json(folder / CONTENTS).get("tables")
    return isinstance(tables, dict) and table not in tables


def _listed(folder: Path) -> tuple[dict[str, list[str]], list[str], str]:
    content = _json(folder / CONTENTS)
    files: Any = content.get("files")
    cases: Any = content.get("cases")
    good = content.get("kind") in _KINDS and isinstance(files, dict)
    if _MARK not in content or not good or not all(map(_is_texts, (cases, *files.values()))):
        raise InputError(f"{folder / CONTENTS}: not a list of files of lvnav-trade; {_GIVE_ANOTHER}")
    if content[_MARK] != _VERSION:
        raise InputError(f"{folder / CONTENTS}: of another version of lvnav-trade; {_GIVE_ANOTHER}")
    return files, cases, content["kind"]


def _of_manifest(folder: Path) -> tuple[dict[str, list[str]], list[str], str]:
    """Return the files, cases and kind of a folder of an earlier version, from its manifest."""
    manifest = _json(folder / MANIFEST)
    if not all(isinstance(manifest.get(key), str) for key in ("campaign_digest", "tool", "code_digest")):
        raise InputError(f"{folder}: holds files that lvnav-trade did not write (no {CONTENTS}); {_GIVE_ANOTHER}")
    cases = [str(case) for key in ("asked_cases", "cases") for case in manifest.get(key) or ()]
    return (
        {"run": [*RUN_FILES, *(f"{table}.parquet" for table in _EARLIER)]},
        cases,
        "results" if "created" in manifest else "base",
    )


def _json(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file; empty if there is none."""
    try:
        content = json.loads(read_bytes(path, _BYTES).decode())
    except (InputError, OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _is_texts(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(item, str) for item in value)


def refuse_foreign(path: Path, manifest: object) -> None:
    """Raise an InputError if the content of a manifest is not that of results or of a kept base of this tool."""
    if not isinstance(manifest, dict) or "campaign_digest" not in manifest:
        raise InputError(f"{path}: not a manifest of lvnav-trade")


DIGESTS = "digests"
"""Key of the manifest: SHA-256 of each table and of the resolved campaign, by the name of its file."""
MANIFEST_BYTES = 2**26  # limit, far above the size for the largest campaign


def read_manifest(path: Path) -> dict[str, Any]:
    """Return the content of a manifest; InputError if it cannot be read, is damaged or of another tool."""
    try:
        content = json.loads(read_bytes(path, MANIFEST_BYTES).decode())
    except (ValueError, RecursionError) as error:
        raise damaged(path, error) from None
    refuse_foreign(path, content)
    for is_kind, keys in _KINDS_OF_FIELDS.items():
        for key in keys:
            if key in content and not is_kind(content[key]):
                raise damaged(path, f"{key} cannot be {quoted(content[key])}")
    return dict(content)


def digests(paths: Iterable[Path]) -> dict[str, str]:
    """Return the digests of existing files, by name."""
    return {path.name: digest(path.read_bytes()) for path in paths if path.is_file()}


def digest(content: bytes) -> str:
    """Return the SHA-256 of a file's content; line breaks of texts, which a repository may change, are normalised."""
    return hashlib.sha256(content if content[:4] == b"PAR1" else content.replace(b"\r\n", b"\n")).hexdigest()


def refuse_changed(path: Path) -> None:
    """Raise an InputError if a file of results does not have the digest in its manifest (earlier versions had none)."""
    manifest = path.parent / MANIFEST
    if not (manifest.is_file() and path.is_file()):
        return
    state = manifest.stat()
    wanted = _digests_in(manifest, state.st_mtime_ns, state.st_size).get(path.name)
    if wanted is not None and wanted != digest(path.read_bytes()):
        raise damaged(path, "its content is not what the campaign wrote")


@lru_cache(maxsize=8)
def _digests_in(manifest: Path, _changed_ns: int, _size: int) -> dict[str, str]:
    by_name: dict[str, str] = read_manifest(manifest).get(DIGESTS, {})
    return by_name


def damaged(path: Path, why: object) -> InputError:
    """Return the exception for a damaged file of results, one line with the remedy."""
    line = str(why).strip().partition("\n")[0] or type(why).__name__
    return InputError(f"{path}: damaged: {line}; the same lvnav-trade run makes it again")


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_list_of_texts(value: object) -> bool:
    return isinstance(value, list) and all(map(_is_text, value))


def _is_mapping_to_texts(value: object) -> bool:
    return isinstance(value, dict) and all(map(_is_text, value.values()))


def _is_count(value: object) -> bool:
    return type(value) is int and 0 <= value < 2**63


def _is_above_zero(value: object) -> bool:
    return _is_count(value) and value != 0


_KINDS_OF_FIELDS: dict[Callable[[object], bool], tuple[str, ...]] = {
    _is_text: ("campaign", "campaign_digest", "tool", "code_digest", "created", "finished", "cpu", "system"),
    _is_list_of_texts: ("cases", "lost", "warnings", "notes", "beyond_limits"),
    _is_mapping_to_texts: ("asked_cases", DIGESTS),
    _is_count: ("asked_runs", "workers_died", "results_version"),
    _is_above_zero: ("asked_block",),
}
"""Type checks of the content of a manifest, with the keys to which they apply."""
