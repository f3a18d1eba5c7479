"""Files of reference vectors: tables, units of every column, the case, a README."""

from __future__ import annotations

import io

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.api import case_of
from lvnav_trade.export.vectors import vector_files as made
from lvnav_trade.export.vectors.vector_tables import VectorTable
from lvnav_trade.quantities.errors import InputError
from tests.export.cases import prepared_of


@pytest.fixture(scope="module")
def smoke():
    return case_of("smoke", (), None)


@pytest.fixture(scope="module")
def prepared_case():
    return prepared_of({"measurements": "ranges", "correction": "closed"})


@pytest.fixture
def small(monkeypatch, prepared_case):
    """Let the tables be one of three rows: no run is simulated."""
    monkeypatch.setattr(made, "prepare", lambda _: prepared_case)
    frame = pd.DataFrame({"epoch": [0, 1, 2], "t_s": [0.1, 1.0 / 3.0, np.nan]})
    columns = {"epoch": ("", "number of the epoch"), "t_s": ("s", "time since lift-off")}
    monkeypatch.setattr(made, "vectors_of", lambda *_: {"epochs": VectorTable("Epochs", frame, columns)})
    return frame


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_the_numbers_are_the_same_in_every_format(smoke, small, kind):
    found = made.reference_vectors(*smoke, 3, kind)
    assert set(found.files) == {f"epochs.{kind}", "columns.csv", "case.yaml", "README.md"}
    content = found.files[f"epochs.{kind}"]
    read = pd.read_csv(io.StringIO(content)) if kind == "csv" else pd.read_parquet(io.BytesIO(content))
    pd.testing.assert_frame_equal(read, small, check_exact=True)
    assert found.run == 3


def test_units_and_meanings_are_a_table(smoke, small):
    found = made.reference_vectors(*smoke, 0, "csv")
    described = pd.read_csv(io.StringIO(str(found.files["columns.csv"])), keep_default_na=False)
    assert described.to_dict("records")[1] == {
        "table": "epochs", "column": "t_s", "unit": "s", "meaning": "time since lift-off",
    }  # fmt: skip


def test_the_readme_names_case_run_files_and_the_loop(smoke, small):
    text = str(made.reference_vectors(*smoke, 5, "csv").files["README.md"])
    assert f"({smoke[1].id})" in text
    assert "seed 1, run 5" in text
    assert "| `epochs.csv` | Epochs | 3 |" in text
    assert "The loop is closed" in text
    assert "{" not in text


def test_the_case_is_readable_yaml(smoke, small):
    from ruamel.yaml import YAML

    stated = YAML(typ="safe").load(str(made.reference_vectors(*smoke, 0, "csv").files["case.yaml"]))
    assert stated["filter"]["measurements"] == ["pseudorange", "range_rate"]


@pytest.mark.parametrize(("run", "kind", "message"), [(-1, "csv", "numbered from 0"), (0, "xml", "csv or parquet")])
def test_what_cannot_be_written_is_refused(smoke, small, run, kind, message):
    with pytest.raises(InputError, match=message):
        made.reference_vectors(*smoke, run, kind)
