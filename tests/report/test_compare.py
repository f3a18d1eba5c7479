"""A comparison as page, as data, as JUnit XML and as exit code; what is kept of a base."""

from __future__ import annotations

import json
from xml.etree import ElementTree

import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.report import compare as reported
from lvnav_trade.results.comparison.comparison import compare, parse_effects
from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.results.variants import variant, worse


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("base"), n_run=40))


@pytest.fixture(scope="module")
def candidates(base, tmp_path_factory):
    """Return a comparison for each verdict."""
    folder = tmp_path_factory.mktemp("candidates")
    changes = {"not worse": worse(1.0), "worse": worse(1.3), "undecided": worse(1.05, 0.05)}
    leave = parse_effects(["rare=none", "loose bound=none", "tight bound=none"])
    return {word: compare(base, variant(base, folder / word, runs=change), leave) for word, change in changes.items()}


@pytest.mark.parametrize(("word", "code"), [("not worse", 0), ("worse", 1), ("undecided", 3)])
def test_three_candidates_give_three_exit_codes(candidates, word, code):
    assert reported.EXIT[candidates[word].verdict] == code


def test_the_answer_counts_the_verdicts(candidates):
    assert reported.answer(candidates["worse"]) == "Worse: of 6 comparisons 6 worse, at 95 % confidence."
    assert (
        reported.answer(candidates["not worse"]) == "Nothing worse: of 6 comparisons 6 not worse, at 95 % confidence."
    )


def test_the_page_is_a_table_with_as_many_cells_in_every_row(candidates):
    page = reported.markdown(candidates["worse"])
    lines = [line for line in page.splitlines() if line.startswith("|")]
    assert len(lines) == 2 + 6
    assert {line.count("|") for line in lines} == {len(reported.HEAD) + 1}
    assert "| worse | imu=fine | velocity error 3d at injection |" in page
    assert "+30.0 %" in page
    assert page.endswith(".\n")


def test_what_is_worse_stands_first(candidates):
    words = [cells[0].partition(" (")[0] for cells in reported.rows(candidates["undecided"])]
    assert words == sorted(words, key=reported.ORDER.index)


def test_junit_holds_a_failure_for_worse_and_a_skip_for_undecided(candidates):
    for word, kind in (("worse", "failure"), ("undecided", "skipped")):
        root = ElementTree.fromstring(reported.junit(candidates[word]).encode())
        cases = root.findall("testsuite/testcase")
        assert len(cases) == int(root.get("tests")) == 6
        found = [case.find(kind) for case in cases if case.find(kind) is not None]
        attribute = {"failure": "failures", "skipped": "skipped"}[kind]
        assert len(found) == int(root.get(attribute)) == int(root.find("testsuite").get(attribute)) > 0
        assert found[0].get("message").startswith(word)


def test_data_holds_numbers_and_null_where_there_is_none(candidates):
    content = json.loads(json.dumps(reported.content(candidates["not worse"]), allow_nan=False))
    assert content["verdict"] == "not worse"
    assert content["rows"][0]["effective_runs"] is None
    assert content["rows"][0]["change"] == 0.0
    assert json.dumps(reported.content(candidates["worse"]), allow_nan=False)


def test_files_are_written_and_the_summary_of_a_job_is_appended_to(candidates, tmp_path, monkeypatch):
    summary = tmp_path / "summary.md"
    summary.write_text("before\n")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    md, xml = tmp_path / "new" / "page.md", tmp_path / "new" / "junit.xml"
    assert reported.write(candidates["worse"], md, xml) == [md, xml, summary]
    assert md.read_text() == reported.markdown(candidates["worse"])
    assert summary.read_text() == "before\n" + md.read_text() + "\n"
    monkeypatch.delenv("GITHUB_STEP_SUMMARY")
    assert reported.write(candidates["worse"]) == []


def test_a_file_that_cannot_be_written_is_refused_in_one_line(candidates, tmp_path):
    with pytest.raises(InputError, match="cannot be written: Is a directory"):
        reported.write(candidates["worse"], tmp_path)


def test_what_is_kept_of_a_base_is_small_and_compares_as_the_whole(base, tmp_path):
    kept = reported.keep_base(base, tmp_path / "kept")
    assert sum(path.stat().st_size for path in kept.iterdir()) < 200_000
    assert compare(kept, base).verdict == "not worse"
    assert compare(kept, base).frame.equals(compare(base, base).frame)


def test_without_runs_the_kept_base_still_compares(tmp_path):
    alone = load(synthetic.results(tmp_path / "alone", n_run=0))
    kept = reported.keep_base(alone, tmp_path / "kept")
    assert compare(kept, alone).verdict == "not worse"


def test_a_mapping_is_read_from_words_with_a_colon():
    assert reported.parse_map(["fog:fog_worse", "imu=a, filter=b : imu=c"]) == {
        "fog": "fog_worse",
        "imu=a, filter=b": "imu=c",
    }
    with pytest.raises(InputError, match="--map fog: write BASE:CANDIDATE"):
        reported.parse_map(["fog"])


@pytest.mark.parametrize(
    ("value", "scale", "text"),
    [(0.051, "ratio", "+5.10 %"), (-0.2, "fraction of runs", "-20.0 points"), (0.5, "m/s", "+0.500 m/s"),
     (0.0, "ratio", "0 %"), (float("nan"), "ratio", "–")],
)  # fmt: skip
def test_a_change_is_written_with_sign_and_unit(value, scale, text):
    assert reported._change(value, scale) == text
