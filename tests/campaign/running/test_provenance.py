"""The manifest keeps what was asked, and nothing of whose machine it was, unless that is wanted."""

from __future__ import annotations

import platform
import sys

import pytest

from lvnav_trade.campaign.running.provenance import RECORD_HOST, command_record, without_folders

PRIVATE = "users/ann lee/secret"
ARGUMENTS = [
    "run", f"/{PRIVATE}/my.yaml", f"--out=/{PRIVATE}/results", "--set", f"constellation.almanac=/{PRIVATE}/a.alm",
    "--set", "base={trajectory: /users/ann/t.csv, x: [/users/ann/u.csv]}", "campaigns/demo.yaml", "a/b=1/2",
]  # fmt: skip


def test_arguments_keep_the_names_of_files_and_no_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(RECORD_HOST, raising=False)
    monkeypatch.setattr(sys, "argv", ["lvnav-trade", *ARGUMENTS])
    assert command_record() == {
        "command": [
            "run", "my.yaml", "--out=results", "--set", "constellation.almanac=a.alm", "--set",
            "base={trajectory: t.csv, x: [u.csv]}", "campaigns/demo.yaml", "a/b=1/2",
        ]
    }  # fmt: skip


def test_folders_and_host_are_kept_where_they_are_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(RECORD_HOST, "1")
    monkeypatch.setattr(sys, "argv", ["lvnav-trade", *ARGUMENTS])
    found = command_record()
    assert (found["command"], found["host"]) == (ARGUMENTS, platform.node())
    assert without_folders("OSError: /users/ann/x: gone") == "OSError: /users/ann/x: gone"


def test_a_line_of_text_loses_its_folders(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(RECORD_HOST, raising=False)
    for text, expected in (
        ("ValueError: /users/ann/results/parts/c/0-8.parquet: damaged", "ValueError: 0-8.parquet: damaged"),
        ("cannot read '/users/ann/a b.csv'", "cannot read 'a b.csv'"),
        ("m/s and 3/4 of ~5 m", "m/s and 3/4 of ~5 m"),
        ("file ~ann/x.csv, C:\\Users\\ann\\y.csv", "file x.csv, y.csv"),
    ):
        assert without_folders(text) == expected


@pytest.mark.parametrize("host", ["", "1"])
def test_addresses_are_kept_whole_but_for_their_credentials(monkeypatch: pytest.MonkeyPatch, host: str) -> None:
    monkeypatch.setenv(RECORD_HOST, host)
    given = ["--copy-to", "memory://user:SECRET@host/x", "--copy-to=s3://KEY:SEC/RET@b/x", "https://h/c?sig=SECRET"]
    monkeypatch.setattr(sys, "argv", ["lvnav-trade", *given])
    kept = ["--copy-to", "memory://***@host/x", "--copy-to=s3://***@b/x", "https://h/c?***"]
    assert command_record()["command"] == kept
