"""A scratch file gives back what was written, or is refused; nothing in it is executed."""

from __future__ import annotations

import io
import os
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics.case_diagnostics import CaseDiagnostics
from lvnav_trade.quantities.records import CovHistory
from lvnav_trade.results.tables import scratch
from tests import synthetic


class Evil:
    """What a pickle can do: run a command when it is loaded."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return os.system, (f"touch {self.mark}",)


class Loose(NamedTuple):
    """A named tuple that no covariance holds."""

    value: float


def npz(**arrays) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def same(one, other) -> bool:
    if isinstance(one, tuple):
        return type(one) is type(other) and len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    return type(one) is type(other) and (one == other or one != one)


class Named(NamedTuple):
    names: frozenset[str]
    reasons: Mapping[str, float]


def test_sets_and_mappings_come_back(tmp_path):
    value = Named(frozenset({"b", "a"}), {"x": 1.0, "a": 2.0})
    scratch.write(tmp_path / "a", value, "campaign a")
    assert scratch.read(tmp_path / "a", Named, "campaign a") == value


@pytest.mark.parametrize("value", [synthetic.covariance(), synthetic.explanation(synthetic.covariance())])
def test_what_is_written_comes_back_to_the_last_bit(tmp_path, value):
    scratch.write(tmp_path / "a", value, "campaign a")
    assert same(scratch.read(tmp_path / "a", type(value), "campaign a"), value)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_every_record_of_an_explanation_can_be_written():
    kinds = scratch.record_types(CaseDiagnostics)
    assert {"CaseDiagnostics", "AdjointBudget", "Output", "SourceCovariance", "SigmaSensitivity", "PhaseView"} <= set(
        kinds
    )
    assert set(scratch.record_types(CovHistory)) == {"CovHistory", "InjectionLaw"}


@pytest.mark.parametrize("form", ["plain", "in npz"])
def test_a_planted_pickle_is_never_loaded(tmp_path, form):
    mark = tmp_path / "executed"
    content = {
        "plain": pickle.dumps(Evil(mark)),
        "in npz": npz(tree=np.frombuffer(b'{"identity": "a", "value": {"array": 0}}', dtype=np.uint8),
                      a0=np.array([Evil(mark)], dtype=object)),
    }[form]  # fmt: skip
    (tmp_path / "a").write_bytes(content)
    assert not scratch.is_sound(tmp_path / "a", CovHistory, "a")
    with pytest.raises(ValueError, match="a: "):
        scratch.read(tmp_path / "a", CovHistory, "a")
    assert not mark.exists()


@pytest.mark.parametrize(
    "tree",
    [
        '{"identity": "a", "value": {"record": "Loose", "fields": [1.0]}}',
        '{"identity": "a", "value": {"record": "CovHistory", "fields": []}}',
        '{"identity": "a", "value": {"array": 7}}',
        '{"identity": "b", "value": 1}',
        '{"identity": "a", "value": 1}',
        "[]",
        "[" * 100_000,
        "",
    ],
)
def test_a_foreign_file_with_a_fitting_checksum_is_refused(tmp_path, tree):
    (tmp_path / "a").write_bytes(npz(tree=np.frombuffer(tree.encode(), dtype=np.uint8)))
    with pytest.raises(ValueError, match="not usable"):
        scratch.read(tmp_path / "a", CovHistory, "a")


def test_another_identity_a_cut_and_a_flipped_byte_are_refused(tmp_path, caplog):
    file = tmp_path / "a"
    scratch.write(file, synthetic.covariance(), "campaign a")
    assert not scratch.is_sound(file, CovHistory, "campaign b")
    content = bytearray(file.read_bytes())
    file.write_bytes(content[:1000])
    assert not scratch.is_sound(file, CovHistory, "campaign a")
    content[-9] ^= 1
    file.write_bytes(content)
    assert not scratch.is_sound(file, CovHistory, "campaign a")
    assert caplog.text.count("computed again") == 3


def test_what_is_neither_a_record_nor_a_number_is_not_written(tmp_path):
    for value in (Path("x"), {"a": Path("x")}, {"a"}, np.array([None])):
        with pytest.raises(TypeError):
            scratch.write(tmp_path / "a", Loose(value), "a")
    assert not list(tmp_path.iterdir())


def test_a_file_is_whole_or_not_there(tmp_path, monkeypatch):
    scratch.write(tmp_path / "a.covariance", Loose(1.0), "a")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        scratch.write(tmp_path / "b.covariance", Loose(1.0), "a")
    assert [file.name for file in tmp_path.iterdir()] == ["a.covariance"]


def test_only_scratch_files_of_the_cases_are_removed(tmp_path):
    folder = tmp_path / ".scratch"
    folder.mkdir()
    names = [
        "c.1.0.covariance",
        "c.abcd.explained",
        "c.1.0.covariance.123",
        "c.abcd.whole",
        "c.notes.txt",
        "d.1.0.covariance",
    ]
    for name in names:
        (folder / name).write_text("")
    scratch.remove(folder, ["c"])
    assert sorted(path.name for path in folder.iterdir()) == ["c.notes.txt", "d.1.0.covariance"]
    (folder / "c.notes.txt").unlink()
    scratch.remove(folder, ["d"])
    assert not folder.exists()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "c.x.covariance").write_text("mine")
    folder.symlink_to(tmp_path / "other")
    scratch.remove(folder, ["c"])
    assert (tmp_path / "other" / "c.x.covariance").exists()


def test_scratch_files_of_a_case_are_copied_and_no_others(tmp_path: Path) -> None:
    source, target = tmp_path / "a", tmp_path / "b"
    source.mkdir()
    for name in ("one.1.0.covariance", "one.1.0.abc.explained", "other.1.0.covariance", "one.txt"):
        (source / name).write_text(name)
    scratch.copy(source, target, "one")
    assert sorted(path.name for path in target.iterdir()) == ["one.1.0.abc.explained", "one.1.0.covariance"]
    scratch.copy(tmp_path / "none", tmp_path / "c", "one")
    assert not (tmp_path / "c").exists()
