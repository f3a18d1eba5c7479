"""The manual: links find their headings, samples run as they are printed, pages build without a network."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
from ruamel.yaml import YAML

from lvnav_studies.checks import faults
from lvnav_studies.claims import Claims
from lvnav_trade.api import check
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.study_card import StudyCard
from lvnav_trade.cli import app
from lvnav_trade.quantities.errors import InputError

LINK = re.compile(r"(?<!!)\[[^\]]+\]\(([^)\s]+)\)")
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SAVED = re.compile(r"[Ss]ave this as\s+`([^`]+)`")
NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?(e-?[0-9]+)?")


def _slug(title: str) -> str:
    return re.sub(r"[^\w\- ]", "", re.sub(r"[`*]", "", title).strip().lower()).replace(" ", "-")


def _anchors(page: Path) -> set[str]:
    return {_slug(found[1]) for found in re.finditer(r"^#+ (.*)$", page.read_text(), re.MULTILINE)}


def test_every_link_to_a_heading_finds_it(root):
    lost = []
    for page in [root / "README.md", root / "CHANGELOG.md", *sorted((root / "docs").rglob("*.md"))]:
        for link in LINK.findall(page.read_text()):
            target, _, anchor = link.partition("#")
            if anchor and "://" not in link and anchor not in _anchors(page.parent / target if target else page):
                lost.append(f"{page.relative_to(root)}: {link}")
    assert lost == []


@pytest.fixture(scope="module")
def desk(root, tmp_path_factory):
    """A folder with what a clone has, in which the samples are run one after the other."""
    place = tmp_path_factory.mktemp("clone")
    for name in ("configs", "campaigns", "lvnav_trade"):
        (place / name).symlink_to(root / name)
    return place


def _save(desk: Path, text: str) -> list[str]:
    """Write the files of a page that says `save this as` before a block, and return their names."""
    saved = []
    for found in BLOCK.finditer(text):
        names = SAVED.findall(text[: found.start()].rsplit("```", 1)[-1])
        if names:
            (desk / names[-1]).parent.mkdir(parents=True, exist_ok=True)
            (desk / names[-1]).write_text(found[2])
            saved.append(names[-1])
    return saved


def _commands(text: str) -> list[list[str]]:
    lines = [
        line for kind, body in BLOCK.findall(text) if kind == "sh" for line in body.replace("\\\n", " ").splitlines()
    ]
    return [words for words in (shlex.split(line, comments=True) for line in lines) if words]


def _alike(printed: str, said: str) -> bool:
    """Return whether two lines have the same words and, to 1 %, the same numbers (other processors round otherwise)."""
    mine, its = printed.split(), said.split()
    return len(mine) == len(its) and all(
        one == other
        or (NUMBER.fullmatch(one) and NUMBER.fullmatch(other) and float(one) == pytest.approx(float(other), rel=0.01))
        for one, other in zip(mine, its, strict=True)
    )


def _run_as_printed(words: list[str], place: Path) -> subprocess.CompletedProcess[str]:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        words, cwd=place, capture_output=True, text=True, env=os.environ | {"PATH": path}, check=False
    )


def _change_the_line(place: Path, text: str) -> None:
    """Do what the page asks for: change the one line of the campaign that begins with the same word."""
    campaign = place / "my_vehicle/ascent.yaml"
    key = text.partition(":")[0]
    changed, count = re.subn(rf"^{key}:.*$", text.strip(), campaign.read_text(), flags=re.MULTILINE)
    assert count == 1
    campaign.write_text(changed)


@pytest.mark.slow  # three minutes: every command of the page, with all its runs
def test_the_tutorial_prints_what_its_commands_print(root, desk):
    text, said, run = (root / "docs/tutorial.md").read_text(), "", []
    assert len(_save(desk, text)) == 2
    for kind, body in BLOCK.findall(text):
        if kind == "yaml" and body.count("\n") == 1:
            _change_the_line(desk, body)
        if kind == "text" and "gnss_outage" not in body:  # that one is tested below
            lines = said.splitlines()
            missing = [line for line in body.splitlines() if not any(_alike(line, other) for other in lines)]
            assert missing == [], f"{shlex.join(run[-1])} printed\n{said}"
        for words in _commands(f"```{kind}\n{body}```"):
            if words[0] in ("cd", "make", "source"):  # what the tests themselves rest on
                continue
            done = _run_as_printed(words, desk)
            answer = (0, 1, 3) if words[1] in ("run", "solve", "compare") else (0,)
            assert done.returncode in answer, f"{shlex.join(words)}\n{done.stderr[-500:]}"
            said = done.stdout
            run.append(words)
    verbs = [words[1] for words in run if words[0] == "lvnav-trade"]
    assert verbs == ["check", "plan", "run", "run", "solve", "report", "keep-base", "compare"]
    assert (desk / "results/ascent/brief.html").is_file()
    assert (desk / "results/gyro_bias/report.md").is_file()


@pytest.mark.parametrize(
    ("said", "is_alike"),
    [("met 0.1321 m/s", True), ("met 0.14 m/s", False), ("violated 0.132 m/s", False), ("met 0.132 m/s 5", False)],
)
def test_a_line_is_alike_by_its_words_and_numbers(said, is_alike):
    assert bool(_alike("met   0.132 m/s", said)) is is_alike


def test_the_mistake_of_the_tutorial_is_answered_as_printed(root, desk):
    text = (root / "docs/tutorial.md").read_text()
    _save(desk, text)
    shutil.copy(root / "configs/trajectories/example_table.csv", desk / "my_vehicle/flight.csv")
    campaign = desk / "my_vehicle/wrong.yaml"
    campaign.write_text((desk / "my_vehicle/ascent.yaml").read_text().replace("satellite_outage", "gnss_outage"))
    with pytest.raises(InputError) as found:
        check(campaign)
    printed = next(body for kind, body in BLOCK.findall(text) if kind == "text" and "gnss_outage" in body)
    assert printed.strip().removesuffix("...").replace("ascent.yaml", "wrong.yaml") in str(found.value).replace(
        f"{desk}/", ""
    )


# Pages whose samples are alternatives: none is laid over those above it.
AFRESH = ("search.md", "several_units.md")
NO_SETTINGS = {
    "tutorial.md": {0, 1, 2},  # its files are run above
    "guarding_a_design.md": {1},  # a workflow of another tool
    "recorded_data.md": {0},  # a card of a log, read in tests/campaign/test_recorded_log.py
    "your_own_trajectory.md": {1, 2},  # cards of files that are not here
}


def _laid_over(base: dict[str, Any], settings: dict[str, Any]) -> None:
    """Lay a sample's settings over a campaign; of a receiver or filter it changes fields of the card."""
    for key, value in settings.items():
        if key in Campaign.model_fields and key != "base":
            base[key] = value
        for name, inner in (value if key == "base" else {key: value}).items():
            if key != "base" and key in Campaign.model_fields:
                continue
            card = base["base"].get(name)
            changed = name in ("receiver", "filter") and isinstance(inner, dict) and "card" not in inner
            base["base"][name] = {"card": card} | inner if changed else inner


@pytest.mark.parametrize(
    "page",
    [
        "../README.md",
        *sorted(
            path.name for path in (Path(__file__).parents[2] / "docs").glob("*.md") if "```yaml" in path.read_text()
        ),
    ],
)
def test_the_settings_of_a_page_are_accepted(root, desk, monkeypatch, page):
    """Each sample is laid over the small campaign and over those above it, unless it has axes of its own."""
    monkeypatch.chdir(desk)
    shutil.copy(root / "configs/trajectories/example_table.csv", desk / "my_flight.csv")
    samples = [body for kind, body in BLOCK.findall((root / "docs" / page).read_text()) if kind == "yaml"]
    yaml, start = YAML(typ="safe"), (root / "campaigns/smoke.yaml").read_text()
    campaign, base = desk / "sample.yaml", yaml.load(start)
    for number, body in enumerate(samples):
        settings = yaml.load(body)
        if number in NO_SETTINGS.get(page, ()):
            continue
        if set(settings) <= set(Claims.model_fields) - {"references"}:  # of a study, on the campaign above it
            assert list(faults(Claims.model_validate(settings), check(campaign).campaign)) == []
            continue
        if set(settings) == {"printed"}:  # of study.yaml
            assert StudyCard.model_validate({"title": "A paper", "description": "", **settings}).printed
            continue
        base = yaml.load(start) if page in AFRESH else base
        _laid_over(base, settings)
        with campaign.open("w") as out:
            yaml.dump(base, out)
        check(campaign)


def test_every_command_of_the_manual_is_understood(root):
    command = typer.main.get_command(app)
    pages = [root / "README.md", *sorted((root / "docs").glob("*.md"))]
    seen = 0
    for page in pages:
        for words in _commands(page.read_text()):
            if words[0] == "lvnav-trade" and not words[1].startswith("-"):
                verb = command.get_command(None, words[1])
                assert verb is not None, f"{page.name}: {words}"
                verb.make_context(words[1], list(words[2:]))
                seen += 1
    assert seen > 15


def test_the_notebook_recipe_runs(root, desk):
    body = next(body for kind, body in BLOCK.findall((root / "docs/how_to.md").read_text()) if kind == "python")
    # The package from where it is installed, not from the link on the desk: a kernel is kept by the path of its source.
    environment = os.environ | {"PYTHONSAFEPATH": "1"}
    done = subprocess.run(
        [sys.executable, "-c", body], cwd=desk, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-500:]
    assert done.stdout.startswith("<Results of smoke: 1 cases, 8 runs each>")


def test_the_example_notebook_runs_and_shows_what_it_printed(root, desk, monkeypatch):
    monkeypatch.chdir(desk)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    names: dict[str, Any] = {}
    cells = json.loads((root / "docs/example.ipynb").read_text())["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    for cell in code:
        exec("".join(cell["source"]), names)
    printed = [out["data"]["text/plain"] for cell in code for out in cell["outputs"]]
    assert "".join(printed[1]) == repr(names["results"])
    assert list(names["shares"].columns) == ["imu=tactical_fog", "imu=tactical_mems"]
    stored = re.search(r"position_error +3d +m +([0-9.]+)", "".join(printed[2]))
    mine = names["rms"].query("phase_or_event == 'injection' and metric == 'position_error' and axis == '3d'").rms
    assert float(stored[1]) == pytest.approx(mine.iloc[0], rel=0.02)
    assert len(names["axes"].lines) == 4


def test_the_validation_page_has_every_model_and_every_test(root):
    spec = importlib.util.spec_from_file_location("generate", root / "docs/generate.py")
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    page = generate.validation()
    assert page.count("\n## ") > 130
    assert page.count("*Left out:*") == page.count("\n## ")
    assert "test_monte_carlo_spreads_as_linear_covariance_says" in page
