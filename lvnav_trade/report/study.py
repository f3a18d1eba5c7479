"""Report of a study: published and computed results by campaign, with tables, figures and assumptions."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from lvnav_trade.campaign.definition.published_cards import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.study_card import CampaignFigure, StudyCard
from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.report.blocks import Block, Picture, Section, Text, of, percent, stated, table
from lvnav_trade.report.build import markdown_page, pictures
from lvnav_trade.report.diagnostics import error_bound, rates, worth
from lvnav_trade.report.escape import csv_text, note
from lvnav_trade.report.evidence import logic_tables
from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.figure import Figure as Drawing
from lvnav_trade.report.figures.published import PublishedValue, ratios
from lvnav_trade.report.flight import control_tables, motion_summary, observed_table
from lvnav_trade.report.headline import headline, not_counted, those_that_miss
from lvnav_trade.report.kml import flights, kml
from lvnav_trade.report.printed import printed_tables
from lvnav_trade.report.script import StudyResult, StudyScript, published_rows
from lvnav_trade.results.evaluation.covariances import agreement, by_case
from lvnav_trade.results.evaluation.coverage import coverage
from lvnav_trade.results.evaluation.pooled_cases import cases_of
from lvnav_trade.results.evaluation.published import COLUMNS, evidence, held
from lvnav_trade.results.evaluation.rms import paired_levels
from lvnav_trade.results.requirements.requirements import in_words
from lvnav_trade.results.statistics.select import in_units
from lvnav_trade.results.tables.contents import owned
from lvnav_trade.results.tables.read import Tables

_ACRONYMS = {"ekf", "fdir", "hil", "imu", "pvt", "ukf"}
APPENDIX = "Appendix: Monte Carlo against linear covariance"
_MANY = 12  # cases; with more, the table of coverage has the last event only


def build(
    study: StudyCard,
    answered: Sequence[StudyResult],
    folder: Path | str,
    unflown: Sequence[Campaign] = (),
    script: StudyScript | None = None,
) -> Path:
    """Write the report of a study: report.md, figures/ and two CSV tables.

    Parameters
    ----------
    study : StudyCard
        Texts and layout of the report.
    answered : sequence of StudyResult
        Campaigns with their results.
    folder : Path or str
        Folder of the report; files of an earlier report are replaced.
    unflown : sequence of Campaign
        Campaigns without results, whose statements are listed as not run.
    script : StudyScript, optional
        Additions to the report.

    Returns
    -------
    Path
        report.md.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    target, script = owned(folder, "study"), script or StudyScript(folder)
    answered = [each._replace(tables=in_units(each.tables, study.units)) for each in answered]
    rows = [
        published_rows(each.campaign.name, each.tables, each.campaign.model_dump(mode="json"), script)
        for each in answered
    ]
    published = together(answered, [frame_of(one) for one in rows])
    if further := script.further_rows(unflown):
        published = pd.concat([published, frame_of(further)], ignore_index=True)
    sections = [
        answer(study, published, script, [line_of(one, published) for one in answered]),
        *assumptions(study),
        *(campaign_section(one, frame_of(mine), script) for one, mine in zip(answered, rows, strict=True)),
        reproduce(study, answered),
        agreements(answered),
    ]
    files: dict[str, bytes | str] = {
        **pictures(sections),
        "references.csv": csv_text(published),
        "agreement.csv": csv_text(agreed(answered)),
        "report.md": markdown_page(study.title, study.description.strip(), sections),
        **{f"{one.part.campaign}.kml": flight_of(one, one.part.kml) for one in answered if one.part.kml is not None},
    }
    with writing(folder, "the study cannot be kept there"):
        target.publish("study", files)
    return target.folder / "report.md"


def assumptions(study: StudyCard) -> list[Section]:
    """Return the section on what the publication does not specify; empty if the study states nothing about it."""
    blocks: list[Block] = [Text(f"{k}. {text}") for k, text in enumerate(study.assumptions, 1)]
    return [Section("assumptions", "Assumptions", blocks)] if blocks else []


def agreed(answered: Sequence[StudyResult]) -> pd.DataFrame:
    """Return the rows of agreement.csv: runs against linear covariance, by campaign and case."""
    return together(
        answered, [agreement(campaign_results.tables).dropna(subset="monte_carlo") for campaign_results in answered]
    )


def frame_of(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Return rows as the table of published numbers."""
    return pd.DataFrame(rows, columns=COLUMNS)


def flight_of(result: StudyResult, case: Case) -> bytes:
    """Return the trajectory of a case as KML."""
    label = result.tables.labels[_cases(result, case)[0]]
    drawn = [flight for flight in flights(result.tables, True, 60.0) if flight.name == label]
    return kml(f"{result.part.campaign}: {label}", drawn)


def together(answered: Sequence[StudyResult], frames: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Return the frames of all campaigns as one frame, with the campaign's name before each case."""
    labelled = [named(campaign_results, frame) for campaign_results, frame in zip(answered, frames, strict=True)]
    return pd.concat([frame for frame in labelled if len(frame)] or labelled[:1], ignore_index=True)


def named(result: StudyResult, frame: pd.DataFrame) -> pd.DataFrame:
    """Return a frame with the campaign's name before each case."""
    return frame.assign(case=[f"{result.part.campaign}: {case}" for case in frame["case"]])


def answer(
    study: StudyCard, every: pd.DataFrame, script: StudyScript, campaigns: Sequence[Mapping[str, Any]]
) -> Section:
    """Return the section with the answer of a study.

    Parameters
    ----------
    study : StudyCard
        Texts and layout of the report.
    every : pandas.DataFrame
        Rows of all campaigns, as `results.evaluation.published.references`.
    script : StudyScript
        Additions to the report.
    campaigns : sequence of mapping
        One row per campaign for the table of campaigns.
    """
    numbered = script.is_statement(every) & evidence(every)
    frame = every[~numbered]
    blocks = [
        *headline(frame, study.important, every[numbered]),
        *printed_tables(study, every),
        *those_that_miss(frame),
        *script.verdicts(every[numbered]),
    ]
    blocks.append(table(pd.DataFrame(campaigns), "The campaigns of this study."))
    numbers = frame[frame.published.notna() & evidence(frame)]
    if len(numbers):
        blocks.append(Picture("ratios", ratios(numbers), "All published numbers that are counted, in one figure."))
    return Section("answer", "Answer", [*blocks, *not_counted(frame)])


def line_of(result: StudyResult, frame: pd.DataFrame) -> dict[str, Any]:
    """Return the row of a campaign in the table of campaigns.

    frame : rows of published numbers of all campaigns
    """
    of_campaign = frame[frame["case"].str.startswith(f"{result.part.campaign}: ") & evidence(frame)]
    counted, cases = by_case(result.tables), result.tables.cases
    tested = counted[counted.verdict.isin(["agree", "disagree"])]
    agree = int((tested.verdict == "agree").sum())
    return {
        "campaign": result.part.campaign,
        "cases": len(cases),
        "runs": int(cases.run_count.sum()),
        "failed runs": int(cases.failed_count.sum()),
        "as published": f"{int(held(of_campaign).sum())} of {len(of_campaign)}" if len(of_campaign) else "–",
        "both engines agree": f"{agree} of {len(tested)} cases" if len(tested) else "–",
    }


def campaign_section(result: StudyResult, frame: pd.DataFrame, script: StudyScript) -> Section:
    """Return the section of a campaign.

    frame : rows of published numbers of this campaign
    """
    part, tables = result.part, result.tables
    question = part.question or result.campaign.description
    blocks: list[Block] = [Text(" ".join(question.split()))] if question else []
    frame = frame[~script.is_statement(named(result, frame))]  # statements are shown in the answer
    if len(frame):
        blocks.append(stated("study_references", frame, sources="; ".join(dict.fromkeys(frame.source))))
    blocks += [*script.blocks(result), *motion_summary(tables), *control_tables(tables, brief=True)]
    blocks += [*observed_table(tables), *study_tables(tables, part.tables, part.paired)]
    numbered = [(f"{place}-{figure.plot}", figure) for place, figure in enumerate(part.figures, 1)]
    if not any(figure.plot == "spread" for figure in part.figures):
        numbered.append(("spread", CampaignFigure(plot="spread")))
    for name, figure in numbered:
        script_figure = script.figures.get(figure.plot)
        drawn = _draw(result, figure, script) if script_figure is None else script_figure.draw(result, figure)
        if drawn is not None:
            about = (
                note(figure.plot, "figures_of_a_study", **figure.model_dump())
                if script_figure is None
                else script_figure.caption
            )
            blocks.append(Picture(f"{part.campaign}-{name}", drawn, " ".join((figure.caption or about).split())))
    if part.kml is not None:
        file = f"{part.campaign}.kml"
        blocks.append(Text(f"The trajectory with 3-sigma position errors, for Earth viewers: {file}."))
    blocks += [Text(" ".join(paragraph.split())) for paragraph in part.text.split("\n\n") if paragraph.strip()]
    return Section(part.campaign, heading(part.campaign), blocks)


def heading(campaign: str) -> str:
    """Return the name of a campaign as a heading: ``imu_noise`` becomes IMU noise."""
    first, *following = [word.upper() if word in _ACRONYMS else word for word in campaign.split("_")]
    return " ".join([first[:1].upper() + first[1:], *following])


def _draw(result: StudyResult, figure: CampaignFigure, script: StudyScript) -> Drawing | None:
    """Return the drawing of a figure of study.yaml, by the script or by a plot of the report."""
    case, level_sets, quantity = _cases(result, figure.case)[0], figure.cases, figure.quantity
    for level_set in level_sets:
        _cases(result, level_set)
    over = (quantity, level_sets, figure.axis, figure.during)
    metric = figure.model_dump(include={"metric", "at", "during", "statistic"})
    published = None if figure.published is None else PublishedValue(figure.published, figure.band or (0.5, 2.0))
    arguments: dict[str, tuple[Any, ...]] = {
        "spread": ([*result.campaign.model_dump(mode="json")["references"], *script.references(result.campaign.name)],),
        "errors": over,
        "relative": over,
        "autocorrelation": (level_sets, figure.channels),
        "locus": (figure.axis, metric, figure.unit, published, level_sets, figure.varied, figure.flown),
        "sweep": (figure.band,),
        "envelope": (case, quantity),
        "budget": (case, quantity),
        "motion": (case, quantity),
    }
    drawn: Drawing | None = PLOTS[figure.plot](result.tables, *arguments.get(figure.plot, (case,)))
    return drawn


def _cases(result: StudyResult, case: Case) -> list[str]:
    """Return the digests of the cases with the levels given in study.yaml; InputError if there is none."""
    digests = cases_of(result.tables, case, ())
    if not digests:
        labels = list(result.tables.labels.values())
        raise InputError(f"study.yaml: {result.part.campaign}: no case {case}; there are {labels}")
    return digests


def agreements(answered: Sequence[StudyResult]) -> Section:
    """Return the appendix with the cases in which runs and linear covariance disagree."""
    frame = pd.concat(
        [
            by_case(campaign_results.tables).assign(campaign=campaign_results.part.campaign)
            for campaign_results in answered
        ],
        ignore_index=True,
    )
    frame = frame[frame.verdict != "no runs"]
    frame = frame.assign(
        outside=frame.outside_count.astype(str) + " of " + frame.tested_count.astype(str),
        furthest=frame.state + " at " + frame.event,
    )
    differing = frame[frame.verdict != "agree"]
    blocks: list[Block] = [Text(note("study_agreement", level=percent(0.01)))]
    blocks += [stated("study_agreement", differing)] if len(differing) else []
    return Section("agreement", APPENDIX, blocks)


def reproduce(study: StudyCard, answered: Sequence[StudyResult]) -> Section:
    """Return the command, seeds and digests of each campaign."""
    rows = [
        {
            "campaign": each.part.campaign,
            "seed": str(each.tables.campaign.get("seed")),
            "runs per case": str((each.tables.campaign.get("monte_carlo") or {}).get("runs", 0)),
            "campaign digest": each.tables.manifest.get("campaign_digest", ""),
            "code digest": each.tables.manifest.get("code_digest", ""),
        }
        for each in answered
    ]
    place = study.name or "FOLDER"
    command = Text(f"lvnav-trade study {place} --keep reports/{place}", kind="code")
    blocks: list[Block] = [command, Text(note("study_reproduce", place=place)), table(pd.DataFrame(rows))]
    return Section("reproduce", "How to reproduce", blocks)


def study_tables(tables: Tables, wanted: Sequence[str], axis: str) -> list[Block]:
    """Return the tables named in `wanted`, in a fixed order.

    wanted : requirements, logic, coverage, paired, error_bound, integrity, tested_errors
    axis : axis whose levels are compared in the table `paired`
    """
    builders: dict[str, Callable[[Tables], list[Block]]] = {
        "requirements": _requirements,
        "logic": logic_tables,
        "coverage": _coverage,
        "paired": partial(_paired, axis=axis),
        "error_bound": error_bound,
        "integrity": rates,
        "tested_errors": worth,
    }
    return [block for name, make in builders.items() if name in wanted for block in make(tables)]


@of("requirements")
def _requirements(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    verdicts = {"met": "pass", "violated": "fail", "undecided": "undecided"}
    beyond = frame.failures.astype(str) + " of " + frame.runs.astype(str)
    share, sure = frame.probability.iloc[0], frame.confidence.iloc[0]
    text = (
        f"{int((frame.verdict == 'met').sum())} of {len(frame)} cells pass: at least {100 * share:g} % of flights "
        f"within the limit, at a confidence of {100 * sure:g} %."
    )
    frame = in_words(frame).assign(verdict=frame.verdict.map(verdicts), beyond=beyond)
    return [Text(text), stated("study_requirements", frame)]


def _coverage(tables: Tables) -> list[Block]:
    frame = coverage(tables)
    if frame.empty:
        return []
    ratios = ["inside_ratio", "all_inside_ratio", "low_ratio", "high_ratio"]
    events = _spaced(frame)[: 1 if len(tables.labels) > _MANY else None]  # with many cases only the last event
    frame = frame[frame.event.isin(events)].assign(**{name: 100.0 * frame[name] for name in ratios})
    return [Text(note("coverage")), stated("coverage", frame)]


def _spaced(frame: pd.DataFrame) -> list[str]:
    """Return events at least an eighth of the flight apart, starting from injection (or from the last event)."""
    times = frame.drop_duplicates("event").set_index("event").t_s.sort_values(ascending=False, kind="stable")
    last = str(times.index[0]) if "injection" not in times.index else "injection"
    selected, distance = [last], (times.max() - times.min()) / 8.0
    for name, t in times.items():
        if all(abs(t - times[event]) >= distance for event in selected):
            selected.append(str(name))
    return selected


def _paired(tables: Tables, axis: str) -> list[Block]:
    frame = paired_levels(tables, axis)
    if frame.empty:
        return []
    last = frame[frame.event.isin(_shown_events(frame))]
    return [Text(note("paired")), stated("paired", last, axis=axis)]


def _shown_events(frame: pd.DataFrame) -> list[str]:
    """Return the events at which paired differences are shown: first, last, and each change by a factor of two."""
    worst = frame.groupby("event", sort=False).difference_ratio.max()
    selection, level = [worst.index[0]], float(worst.iloc[0])
    for name, value in worst.items():
        if value > 2.0 * level or value < 0.5 * level:
            selection.append(name)
            level = float(value)
    return [str(name) for name in dict.fromkeys([*selection, worst.index[-1]])]
