"""A study with statements: its page, its command line, and mistakes in its files."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest
from ruamel.yaml import YAML

from lvnav_studies import Publication, main
from lvnav_trade import api
from lvnav_trade.api.pages import StudyResult
from lvnav_trade.campaign.reading.study_card import StudyCard, load_study
from lvnav_trade.quantities.errors import InputError, refuse_all
from lvnav_trade.report.study import build
from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.campaign.reading.test_study_card import CAMPAIGN

END = {"metric": "velocity_error_3d", "at": "injection"}
TERMS = {"a": END | {"case": {"imu": "coarse"}}, "b": END | {"case": {"imu": "fine"}}}
COMMON = {"source": "A paper", "value": "a / b", "terms": TERMS}
SIZE = {"source": "A paper", "id": "s2", "item": "#2 small", "value": "a", "terms": {"a": END}, "unit": "m/s"}
CLAIMS = {
    "orderings": [{"source": "A paper", "metric": "velocity_error_3d", "cases": [{"imu": "fine"}, {"imu": "coarse"}]}],
    "statements": [
        COMMON | {"item": "#1 three times", "at_least": 2.9, "at_most": 3.1},
        SIZE | {"at_most": 0.1, "along": "imu", "case": {"imu": "coarse"}},
    ],
}
OF_STUDY = {"not_set_up": [{"source": "A paper", "item": "#3 unheard of", "remark": "there is no such sensor"}]}
STUDY = {
    "title": "A paper again",
    "description": "What a paper says, held against our runs.",
    "campaigns": [{"campaign": "synthetic", "figures": [{"plot": "bound", "settings": {"statement": "s2"}}]}],
}
AXIS = "axes: [{path: imu, cards: [imu/tactical_fog, imu/tactical_mems], labels: [fine, coarse]}]"
SCRIPT = """\
from pathlib import Path

from lvnav_studies import Publication, main

STUDY = Publication(Path(__file__).parent)

if __name__ == "__main__":
    raise SystemExit(main(STUDY))
"""


def write(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    YAML().dump(content, path)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a study whose one campaign has results; the working folder is next to it."""
    monkeypatch.chdir(tmp_path)
    place = tmp_path / "papers"
    write(place / "study.yaml", STUDY)
    write(place / "statements" / "synthetic.yaml", CLAIMS)
    write(place / "statements" / "study.yaml", OF_STUDY)
    (place / "synthetic.yaml").write_text(CAMPAIGN.format(name="synthetic", more=f"monte_carlo: {{runs: 40}}\n{AXIS}"))
    (place / "study.py").write_text(SCRIPT)
    synthetic.results(tmp_path / "results" / "papers" / "synthetic", n_run=40)
    return place


def test_the_page_says_first_which_statements_hold_and_which_do_not(folder: Path) -> None:
    assert main(Publication(folder), ["--keep", "kept", "--only-page"]) == 0
    text = Path("kept/report.md").read_text(encoding="utf-8")
    answer = text.partition("## Answer")[2].partition("\n## ")[0]
    counts = "1 holds in every evaluation by which it is tested, 1 does not hold here, 1 is not set up."
    assert f"Of 3 statements {counts}" in answer
    fails, holds, missing = (
        answer.index(item, answer.index("Statements that do not hold here."))
        for item in ("#2 small", "#1 three times", "#3 unheard of")
    )
    assert fails < holds < missing
    assert "there is no such sensor" in answer
    assert "1 of 1 orders and statements on innovations are reproduced, 0 are not." in text
    assert text.count("#1 three times") == 1  # not again with its campaign
    assert Path("kept/figures/synthetic-1-bound.png").is_file()
    found = pd.read_csv("kept/references.csv", keep_default_na=False)
    assert list(found.verdict[found.item.str.startswith("#")]) == ["holds", "does not hold here", "not set up"]
    table = Publication(folder).table(api.load("results/papers/synthetic"))
    assert list(table.id) == ["synthetic references 1", "synthetic references 2", "synthetic orderings 1",
                              "synthetic statements 1", "s2"]  # fmt: skip


def test_a_kept_page_is_counted_anew_with_the_marks_that_its_folder_has_by_now(folder: Path) -> None:
    study = ["--keep", "kept", "--only-page"]
    assert main(Publication(folder), study) == 0
    before, first = Path("kept/report.md").read_text(), pd.read_csv("kept/references.csv", keep_default_na=False)
    assert main(Publication(folder), ["--keep", "kept", "--recount"]) == 0
    assert Path("kept/report.md").read_text() == before
    pd.testing.assert_frame_equal(pd.read_csv("kept/references.csv", keep_default_na=False), first)
    first_one, small = CLAIMS["statements"]
    write(folder / "statements" / "synthetic.yaml", CLAIMS | {"statements": [first_one, small | {"own": "the bound"}]})
    assert main(Publication(folder), ["--keep", "kept", "--recount"]) == 0
    rows = pd.read_csv("kept/references.csv", keep_default_na=False).set_index("id")
    assert (rows.counts_as["s2"], rows.own["s2"]) == ("own", "the bound")
    page = Path("kept/report.md").read_text()
    assert "1 result whose statement or bound is ours" in page
    assert page.partition("\n## Ass")[2] == before.partition("\n## Ass")[2]


def test_a_campaign_of_a_kept_page_is_renewed_and_the_others_stay(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(Publication(folder), ["--keep", "kept", "--only-page"]) == 0
    before, first = Path("kept/report.md").read_text(), pd.read_csv("kept/references.csv", keep_default_na=False)
    monkeypatch.setattr("lvnav_trade.api.studies.carry_out", lambda *args: None)  # results are there
    again = ["--keep", "kept", "--campaigns", "synthetic"]
    assert main(Publication(folder), again) == 0
    assert Path("kept/report.md").read_text() == before
    pd.testing.assert_frame_equal(pd.read_csv("kept/references.csv", keep_default_na=False), first)
    # a campaign that is new stands before it, and has its section, its rows and its line; what is there stays
    more = f"monte_carlo: {{runs: 40}}\n{AXIS}"
    (folder / "earlier.yaml").write_text(CAMPAIGN.format(name="earlier", more=more))
    write(folder / "study.yaml", STUDY | {"campaigns": [{"campaign": "earlier"}, *STUDY["campaigns"]]})
    write(folder / "statements" / "earlier.yaml", {"statements": [SIZE | {"id": "e1", "item": "#8 new", "at_most": 1}]})
    synthetic.results(Path("results/papers/earlier"), n_run=40)
    assert main(Publication(folder), ["--keep", "kept", "--campaigns", "earlier"]) == 0
    page, rows = Path("kept/report.md").read_text(), pd.read_csv("kept/references.csv", keep_default_na=False)
    assert set(rows.id) == {*first.id, "e1"}
    assert page.index("## Earlier") < page.index("## Synthetic")
    kept, old = (text.partition("## Synthetic")[2].partition("\n## ")[0] for text in (page, before))
    assert kept == old
    assert "Of 4 statements" in page
    assert page.count("| earlier | ") >= 2  # campaigns of the study, how to reproduce


def test_an_unknown_campaign_is_not_renewed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(Publication(folder), ["--keep", "kept", "--campaigns", "synthetics"]) == 2
    assert "no campaign 'synthetics' (did you mean 'synthetic'?)" in capsys.readouterr().err


def test_statements_of_campaigns_without_results_are_listed_as_not_run(folder: Path) -> None:
    (folder / "later.yaml").write_text(CAMPAIGN.format(name="later", more=""))
    write(folder / "study.yaml", STUDY | {"campaigns": [{"campaign": "synthetic"}, {"campaign": "later"}]})
    bound = {"source": "A paper", "item": "#7 far", "value": "a", "terms": {"a": END}, "at_most": 1}
    write(folder / "statements" / "later.yaml", {"statements": [bound]})
    assert main(Publication(folder), ["--keep", "kept", "--only-page"]) == 0
    text = Path("kept/report.md").read_text()
    assert "1 has not been run" in text
    assert "| #7 far | campaign later |" in text
    assert "not run" in Path("kept/references.csv").read_text()


def test_a_script_of_the_users_own_is_run_by_its_user_and_not_by_the_name_of_its_folder(folder: Path) -> None:
    with pytest.raises(InputError, match=r"papers/study.py: a script of your own is not run .* python papers/study.py"):
        api.study("papers", "kept", only_page=True)
    assert not Path("kept").exists()


def test_a_script_of_the_tool_is_found_by_its_name() -> None:
    found = api.studies.script_of("dlr")
    assert isinstance(found, Publication)
    assert "imu_grades" in found.claims


@pytest.mark.parametrize(
    ("file", "content", "reported"),
    [
        ("statements/synthetic.yaml", {"statement": []}, r"statements/synthetic.yaml:1:1: statement: unknown key"),
        ("statements/other.yaml", CLAIMS, "no campaign of the study has the name 'other' \\(known: synthetic\\)"),
        (
            "study.yaml",
            STUDY | {"printed": [{"title": "T", "columns": ["x"], "rows": {"a": ["#1 four times"]}}]},
            r"study.yaml:\d+:\d+: printed.0.rows.a.0: nothing with the item '#1 four times' is stated",
        ),
        (
            "study.yaml",
            STUDY | {"campaigns": [{"campaign": "synthetic", "figures": [{"plot": "bound"}]}]},
            r"study.yaml:\d+:\d+: campaigns.0.figures.0.settings.statement: no statement None that is along an axis",
        ),
    ],
)
def test_a_mistake_is_reported_at_its_place_before_anything_runs(
    folder: Path, file: str, content: object, reported: str
) -> None:
    write(folder / file, content)
    with pytest.raises(InputError, match=reported):
        api.study(Publication(folder), "kept", only_page=True)
    assert not Path("kept").exists()


def test_an_event_that_no_flight_has_is_reported_before_the_campaign_is_run(folder: Path) -> None:
    write(
        folder / "statements" / "synthetic.yaml",
        {"statements": [SIZE | {"at_most": 1, "terms": {"a": END | {"at": "apogee"}}}]},
    )
    script = Publication(folder)
    campaign = load_study(folder, None, script.figures)[1][0].campaign
    (found,) = script.mistakes_in_flight(campaign, {"a": {"liftoff": 0.0, "injection": 500.0}})
    assert (found.path, found.line > 0) == ("statements.0.terms.a.at", True)
    assert "'apogee' is not an event of the trajectory" in found.message
    refuse_all(list(script.mistakes_in_flight(campaign, {"a": {"apogee": 0.0}})))


def test_the_command_line_says_what_is_wrong(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(folder / "statements" / "other.yaml", CLAIMS)
    assert main(Publication(folder), ["--keep", "kept", "--only-page"]) == api.USAGE
    assert "no campaign of the study" in capsys.readouterr().err


def test_a_script_without_statements_adds_nothing(tmp_path: Path) -> None:
    tables = load(synthetic.results(tmp_path / "results", n_run=40))
    campaign = SimpleNamespace(name="synthetic", description="", model_dump=lambda mode: tables.campaign)
    study = StudyCard.model_validate({"title": "x", "description": "x", "campaigns": [{"campaign": "synthetic"}]})
    answered = [StudyResult(study.campaigns[0], campaign, tables)]  # type: ignore[arg-type]
    with_script, without = (
        build(study, answered, tmp_path / name, script=script)
        for name, script in (("a", Publication(tmp_path)), ("b", None))
    )
    assert with_script.read_bytes() == without.read_bytes()
