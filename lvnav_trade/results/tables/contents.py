"""Folders that the tool writes: the list of their files, and the manifest, which may be damaged."""

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
FolderType = Literal["results", "report", "study", "base", "code", "vectors"]
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
        self,
        folder: Path,
        folder_type: FolderType,
        files: Mapping[str, list[str]],
        cases: Iterable[str],
        is_adopted: bool,
    ) -> None:
        self.folder, self.folder_type, self.cases = folder, folder_type, sorted(set(cases))
        self._files, self._is_adopted = dict(files), is_adopted
        for name in self.names:
            self.place(name)
        for case in self.cases:
            self._place_case(case)

    @property
    def names(self) -> set[str]:
        """All listed names."""
        return {name for group in self._files.values() for name in group}

    def listed_names(self, group: str) -> list[str]:
        """Return the names of a group."""
        return list(self._files.get(group, ()))

    def claim(self, group: str, names: Iterable[str], cases: Iterable[str] = ()) -> None:
        """List names and cases that are about to be written, and create the folder if it is missing.

        In a folder of results of an earlier version, which has no list, existing files of the report are assumed to be
        files of the tool.

        Raises
        ------
        InputError
            A file with such a name exists and is not listed, or a part of its path is a link. Nothing has been changed.
        """
        new_names = sorted(set(names))
        listed_names = self.names
        for name in new_names:
            path = self.place(name)
            if path.is_symlink():
                raise InputError(f"{path}: is a link, which is not followed; {_GIVE_ANOTHER}")
            if name not in listed_names and not self._is_adopted and path.exists():
                raise InputError(f"{path}: was not written by lvnav-trade; move it, or give another folder")
        for case in cases:
            self._place_case(case)
        self._files[group] = sorted({*self._files.get(group, ()), *new_names})
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
        removed_names = set(names)
        for name in removed_names:
            self._remove(self.place(name))
        self._files[group] = [name for name in self._files.get(group, ()) if name not in removed_names]
        self._save()

    def is_without_results(self) -> bool:
        """Return whether the campaign that has the folder stored nothing: no table, no report, no block of runs."""
        for name in self.names:
            if name not in (MANIFEST, RESOLVED) and self.place(name).exists():
                return False
        return not any(part_files.paths(self._place_case(case)) for case in self.cases)

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
            for table in _STORED:
                for extension in _CASE_TABLES:
                    self._remove(folder / f"{table}{extension}")

    def remove_blocks(self) -> None:
        """Remove the blocks of runs of all cases."""
        for case in self.cases:
            for path in part_files.paths(self._place_case(case)):
                self._remove(path)

    def sweep(self) -> None:
        """Remove temporary files of killed processes that belong to listed names."""
        listed_paths = {self.folder / CONTENTS}
        listed_paths |= {self.place(name) for name in self.names}
        case_folders = {self._place_case(case) for case in self.cases}
        case_folders |= {folder / "tables" for folder in case_folders}
        for folder in case_folders | {path.parent for path in listed_paths}:
            for path in folder.glob(".*.*"):
                name = _TEMPORARY.sub(r"\1", path.name)
                if name == path.name:
                    continue
                is_case_file = part_files.is_name(name) or PurePosixPath(name).stem in _STORED
                if (folder in case_folders and is_case_file) or folder / name in listed_paths:
                    path.unlink(missing_ok=True)

    def place(self, name: str) -> Path:
        """Return the path of a name; InputError if it leads out of the folder."""
        segments = PurePosixPath(name).parts
        if not segments or ".." in segments or "\0" in name or PurePosixPath(name).is_absolute():
            raise InputError(f"{self.folder}: the name {name!r} leads out of the folder; {_GIVE_ANOTHER}")
        if any(len(os.fsencode(segment)) > _NAME_BYTES for segment in segments):
            raise InputError(
                f"{self.folder}: the name {quoted(name)} is longer than {_NAME_BYTES} bytes; {_GIVE_ANOTHER}"
            )
        path = self.folder
        for segment in segments[:-1]:
            path = path / segment
            if path.is_symlink():
                raise InputError(f"{path}: is a link, which is not followed; {_GIVE_ANOTHER}")
        return path / segments[-1]

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
        content: dict[str, Any] = {_MARK: _VERSION, "kind": self.folder_type, "files": files, "cases": self.cases}
        if self.folder_type == "results":
            content["tables"] = self._features()
        replace_file(self.folder / CONTENTS, json.dumps(content, indent=1) + "\n")

    def _features(self) -> dict[str, str]:
        """Return the feature that each listed table belongs to: by name of stored tables, by file of CSV tables."""
        stored_files = self.listed_names("run")
        report_files = self.listed_names("report")
        features = {name: feature for name, feature in _STORED.items() if f"{name}.parquet" in stored_files}
        for name, feature in REPORTED.items():
            if f"{name}.csv" in report_files:
                features[f"{name}.csv"] = feature
        return features


def owned_folder(folder: Path | str, folder_type: FolderType) -> OwnedFolder:
    """Return a folder in which the tool may write files of one kind; nothing is changed.

    The folder is missing, empty (apart from hidden files), or contains only files of the same kind that the tool wrote.
    Results and bases of an earlier version, which have no list of their files, are recognised by their manifest.

    Parameters
    ----------
    folder : Path or str
        The folder.
    folder_type : str
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
        files, cases, present_type = _read_list(folder)
    elif not existing:
        return OwnedFolder(folder, folder_type, {}, (), is_adopted=False)
    else:
        files, cases, present_type = _infer_list(folder)
    if present_type != folder_type:
        raise InputError(f"{folder}: holds {_KINDS[present_type]}, not {_KINDS[folder_type]}; {_GIVE_ANOTHER}")
    return OwnedFolder(folder, folder_type, files, cases, is_adopted=CONTENTS not in existing)


def is_without_rows(folder: Path, table: str) -> bool:
    """Whether results lack a table because it has no rows: its stored name is missing in their list of tables."""
    tables = _read_json(folder / CONTENTS).get("tables")
    return isinstance(tables, dict) and table not in tables


def _read_list(folder: Path) -> tuple[dict[str, list[str]], list[str], str]:
    """Return the files, cases and kind of a folder from its list of files; InputError if it is damaged."""
    content = _read_json(folder / CONTENTS)
    files: Any = content.get("files")
    cases: Any = content.get("cases")
    is_list = (
        _MARK in content
        and content.get("kind") in _KINDS
        and isinstance(files, dict)
        and all(_is_text_list(names) for names in (cases, *files.values()))
    )
    if not is_list:
        raise InputError(f"{folder / CONTENTS}: not a list of files of lvnav-trade; {_GIVE_ANOTHER}")
    if content[_MARK] != _VERSION:
        raise InputError(f"{folder / CONTENTS}: of another version of lvnav-trade; {_GIVE_ANOTHER}")
    return files, cases, content["kind"]


def _infer_list(folder: Path) -> tuple[dict[str, list[str]], list[str], str]:
    """Return the files, cases and kind of a folder of an earlier version, from its manifest."""
    manifest = _read_json(folder / MANIFEST)
    if not all(isinstance(manifest.get(key), str) for key in ("campaign_digest", "tool", "code_digest")):
        raise InputError(f"{folder}: holds files that lvnav-trade did not write (no {CONTENTS}); {_GIVE_ANOTHER}")
    cases: list[str] = []
    for key in ("asked_cases", "cases"):
        cases += [str(case) for case in manifest.get(key) or ()]
    earlier_tables = [f"{table}.parquet" for table in _EARLIER]
    folder_type = "results" if "created" in manifest else "base"
    return {"run": [*RUN_FILES, *earlier_tables]}, cases, folder_type


def _read_json(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file; empty if there is none."""
    try:
        content = json.loads(read_bytes(path, _BYTES).decode())
    except (InputError, OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


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
        raise damaged_file_error(path, error) from None
    refuse_foreign(path, content)
    for is_valid, keys in _FIELD_CHECKS.items():
        for key in keys:
            if key in content and not is_valid(content[key]):
                raise damaged_file_error(path, f"{key} cannot be {quoted(content[key])}")
    return dict(content)


def digests(paths: Iterable[Path]) -> dict[str, str]:
    """Return the digests of existing files, by name."""
    return {path.name: digest(path.read_bytes()) for path in paths if path.is_file()}


def digest(content: bytes) -> str:
    """Return the SHA-256 of a file's content; line breaks of texts, which a repository may change, are normalised."""
    is_parquet = content[:4] == b"PAR1"
    if not is_parquet:
        content = content.replace(b"\r\n", b"\n")
    return hashlib.sha256(content).hexdigest()


def refuse_changed(path: Path) -> None:
    """Raise an InputError if a file of results does not have the digest in its manifest (earlier versions had none)."""
    manifest = path.parent / MANIFEST
    if not (manifest.is_file() and path.is_file()):
        return
    state = manifest.stat()
    written_digest = _read_digests(manifest, state.st_mtime_ns, state.st_size).get(path.name)
    if written_digest is not None and written_digest != digest(path.read_bytes()):
        raise damaged_file_error(path, "its content is not what the campaign wrote")


@lru_cache(maxsize=8)
def _read_digests(manifest: Path, _changed_ns: int, _size: int) -> dict[str, str]:
    """Return the digests in a manifest by file, cached until the manifest changes."""
    digest_by_file: dict[str, str] = read_manifest(manifest).get(DIGESTS, {})
    return digest_by_file


def damaged_file_error(path: Path, reason: object) -> InputError:
    """Return the exception for a damaged file of results, one line with the remedy."""
    line = str(reason).strip().partition("\n")[0] or type(reason).__name__
    return InputError(f"{path}: damaged: {line}; the same lvnav-trade run makes it again")


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_text_list(value: object) -> bool:
    return isinstance(value, list) and all(map(_is_text, value))


def _is_text_mapping(value: object) -> bool:
    return isinstance(value, dict) and all(map(_is_text, value.values()))


def _is_count(value: object) -> bool:
    return type(value) is int and 0 <= value < 2**63


def _is_above_zero(value: object) -> bool:
    return _is_count(value) and value != 0


_FIELD_CHECKS: dict[Callable[[object], bool], tuple[str, ...]] = {
    _is_text: ("campaign", "campaign_digest", "tool", "code_digest", "created", "finished", "cpu", "system"),
    _is_text_list: ("cases", "lost", "warnings", "notes", "beyond_limits"),
    _is_text_mapping: ("asked_cases", DIGESTS),
    _is_count: ("asked_runs", "workers_died", "results_version"),
    _is_above_zero: ("asked_block",),
}
"""Type checks of the content of a manifest, with the keys to which they apply."""
