"""Report of a study: published and computed results by campaign, with tables, figures and assumptions."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from lvnav_trade.campaign.definition.published_cards import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.study_card import CampaignFigure, StudyCard
from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.report.blocks import Block, Picture, Section, Text, formatted_table, percent, table
from lvnav_trade.report.build import markdown_page, pictures
from lvnav_trade.report.escape import csv_text, note
from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.figure import Figure as Drawing
from lvnav_trade.report.figures.published import PublishedValue, ratios
from lvnav_trade.report.flight import control_tables, motion_summary, observed_table
from lvnav_trade.report.headline import failed_table, headline, uncounted_tables
from lvnav_trade.report.kml import flights, kml
from lvnav_trade.report.printed import printed_tables
from lvnav_trade.report.script import StudyResult, StudyScript, published_rows
from lvnav_trade.report.study_tables import study_tables
from lvnav_trade.results.evaluation.covariances import agreement, by_case
from lvnav_trade.results.evaluation.pooled_cases import cases_of
from lvnav_trade.results.evaluation.published import COLUMNS, is_evidence, is_reproduced
from lvnav_trade.results.statistics.select import with_display_units
from lvnav_trade.results.tables.contents import owned_folder

_ACRONYMS = {"ekf", "fdir", "hil", "imu", "pvt", "ukf"}
APPENDIX = "Appendix: Monte Carlo against linear covariance"


def build(
    study: StudyCard,
    study_results: Sequence[StudyResult],
    folder: Path | str,
    not_run: Sequence[Campaign] = (),
    script: StudyScript | None = None,
) -> Path:
    """Write the report of a study: report.md, figures/ and two CSV tables.

    Parameters
    ----------
    study : StudyCard
        Texts and layout of the report.
    study_results : sequence of StudyResult
        Campaigns with their results.
    folder : Path or str
        Folder of the report; files of an earlier report are replaced.
    not_run : sequence of Campaign
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
    target = owned_folder(folder, "study")
    script = script or StudyScript(folder)
    study_results = [result._replace(tables=with_display_units(result.tables, study.units)) for result in study_results]
    frames = [published_frame(result, script) for result in study_results]
    reference_rows = join_frames(study_results, frames)
    further_rows = script.further_rows(not_run)
    if further_rows:
        reference_rows = pd.concat([reference_rows, published_table(further_rows)], ignore_index=True)
    lines = [campaign_row(result, reference_rows) for result in study_results]
    sections = [answer(study, reference_rows, script, lines), *assumptions(study)]
    for result, frame in zip(study_results, frames, strict=True):
        sections.append(campaign_section(result, frame, script))
    sections += [reproduce(study, study_results), agreements(study_results)]
    files: dict[str, bytes | str] = {
        **pictures(sections),
        "references.csv": csv_text(reference_rows),
        "agreement.csv": csv_text(agreement_rows(study_results)),
        "report.md": markdown_page(study.title, study.description.strip(), sections),
    }
    for result in study_results:
        if result.study_campaign.kml is not None:
            files[f"{result.study_campaign.campaign}.kml"] = flight_of(result, result.study_campaign.kml)
    with writing(folder, "the study cannot be kept there"):
        target.publish("study", files)
    return target.folder / "report.md"


def assumptions(study: StudyCard) -> list[Section]:
    """Return the section on what the publication does not specify; empty if the study states nothing about it."""
    blocks: list[Block] = [Text(f"{k}. {text}") for k, text in enumerate(study.assumptions, 1)]
    return [Section("assumptions", "Assumptions", blocks)] if blocks else []


def agreement_rows(study_results: Sequence[StudyResult]) -> pd.DataFrame:
    """Return the rows of agreement.csv: runs against linear covariance, by campaign and case."""
    frames = [agreement(result.tables).dropna(subset="monte_carlo") for result in study_results]
    return join_frames(study_results, frames)


def published_table(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Return rows as the table of published numbers."""
    return pd.DataFrame(rows, columns=COLUMNS)


def published_frame(result: StudyResult, script: StudyScript) -> pd.DataFrame:
    """Return the rows of published numbers of a campaign as a table."""
    stated_campaign = result.campaign.model_dump(mode="json")
    return published_table(published_rows(result.campaign.name, result.tables, stated_campaign, script))


def flight_of(result: StudyResult, case: Case) -> bytes:
    """Return the trajectory of a case as KML."""
    label = result.tables.labels[_cases(result, case)[0]]
    case_flights = [flight for flight in flights(result.tables, True, 60.0) if flight.name == label]
    return kml(f"{result.study_campaign.campaign}: {label}", case_flights)


def join_frames(study_results: Sequence[StudyResult], frames: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Return the frames of all campaigns as one frame, with the campaign's name before each case."""
    prefixed_frames = [prefix_cases(result, frame) for result, frame in zip(study_results, frames, strict=True)]
    with_rows = [frame for frame in prefixed_frames if len(frame)]
    return pd.concat(with_rows or prefixed_frames[:1], ignore_index=True)


def prefix_cases(result: StudyResult, frame: pd.DataFrame) -> pd.DataFrame:
    """Return a frame with the campaign's name before each case."""
    return frame.assign(case=[f"{result.study_campaign.campaign}: {case}" for case in frame["case"]])


def answer(
    study: StudyCard, reference_rows: pd.DataFrame, script: StudyScript, campaigns: Sequence[Mapping[str, Any]]
) -> Section:
    """Return the section with the answer of a study.

    Parameters
    ----------
    study : StudyCard
        Texts and layout of the report.
    reference_rows : pandas.DataFrame
        Rows of all campaigns, as `results.evaluation.published.references`.
    script : StudyScript
        Additions to the report.
    campaigns : sequence of mapping
        One row per campaign for the table of campaigns.
    """
    is_statement = script.is_statement(reference_rows) & is_evidence(reference_rows)
    statements = reference_rows[is_statement]
    frame = reference_rows[~is_statement]
    blocks = [
        *headline(frame, study.important, statements),
        *printed_tables(study, reference_rows),
        *failed_table(frame),
        *script.verdicts(statements),
        table(pd.DataFrame(campaigns), "The campaigns of this study."),
    ]
    numbers = frame[frame.published.notna() & is_evidence(frame)]
    if len(numbers):
        blocks.append(Picture("ratios", ratios(numbers), "All published numbers that are counted, in one figure."))
    blocks += uncounted_tables(frame)
    return Section("answer", "Answer", blocks)


def campaign_row(result: StudyResult, frame: pd.DataFrame) -> dict[str, Any]:
    """Return the row of a campaign in the table of campaigns.

    result : the campaign with its results
    frame : rows of published numbers of all campaigns
    """
    campaign = result.study_campaign.campaign
    evidence_rows = frame[frame["case"].str.startswith(f"{campaign}: ") & is_evidence(frame)]
    cases = result.tables.cases
    verdicts = by_case(result.tables).verdict
    n_agree = int((verdicts == "agree").sum())
    n_tested = int(verdicts.isin(["agree", "disagree"]).sum())
    reproduced_text = "–"
    if len(evidence_rows):
        reproduced_text = f"{int(is_reproduced(evidence_rows).sum())} of {len(evidence_rows)}"
    return {
        "campaign": campaign,
        "cases": len(cases),
        "runs": int(cases.run_count.sum()),
        "failed runs": int(cases.failed_count.sum()),
        "as published": reproduced_text,
        "both engines agree": f"{n_agree} of {n_tested} cases" if n_tested else "–",
    }


def campaign_section(result: StudyResult, frame: pd.DataFrame, script: StudyScript) -> Section:
    """Return the section of a campaign.

    Parameters
    ----------
    result : StudyResult
        The campaign with its results.
    frame : pandas.DataFrame
        Rows of published numbers of this campaign.
    script : StudyScript
        Additions to the report.
    """
    study_campaign = result.study_campaign
    question = study_campaign.question or result.campaign.description
    blocks: list[Block] = [Text(_one_line(question))] if question else []
    frame = frame[~script.is_statement(prefix_cases(result, frame))]  # statements are shown in the answer
    if len(frame):
        sources = "; ".join(dict.fromkeys(frame.source))
        blocks.append(formatted_table("study_references", frame, sources=sources))
    blocks += script.blocks(result)
    blocks += motion_summary(result.tables)
    blocks += control_tables(result.tables, brief=True)
    blocks += observed_table(result.tables)
    blocks += study_tables(result.tables, study_campaign.tables, study_campaign.paired)
    blocks += _campaign_pictures(result, script)
    if study_campaign.kml is not None:
        file = f"{study_campaign.campaign}.kml"
        blocks.append(Text(f"The trajectory with 3-sigma position errors, for Earth viewers: {file}."))
    for paragraph in study_campaign.text.split("\n\n"):
        if paragraph.strip():
            blocks.append(Text(_one_line(paragraph)))
    return Section(study_campaign.campaign, heading(study_campaign.campaign), blocks)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _campaign_pictures(result: StudyResult, script: StudyScript) -> list[Block]:
    """Return the figures of a campaign that study.yaml names, and the spread of the runs if it does not name it."""
    study_campaign = result.study_campaign
    figures = {f"{place}-{figure.plot}": figure for place, figure in enumerate(study_campaign.figures, 1)}
    if not any(figure.plot == "spread" for figure in study_campaign.figures):
        figures["spread"] = CampaignFigure(plot="spread")
    pictures_of_campaign: list[Block] = []
    for name, figure in figures.items():
        script_figure = script.figures.get(figure.plot)
        if script_figure is None:
            drawing = _draw(result, figure, script)
        else:
            drawing = script_figure.draw(result, figure)
        if drawing is None:
            continue
        if script_figure is None:
            caption = note(figure.plot, "figures_of_a_study", **figure.model_dump())
        else:
            caption = script_figure.caption
        caption = _one_line(figure.caption or caption)
        pictures_of_campaign.append(Picture(f"{study_campaign.campaign}-{name}", drawing, caption))
    return pictures_of_campaign


def heading(campaign: str) -> str:
    """Return the name of a campaign as a heading: ``imu_noise`` becomes IMU noise."""
    words = [word.upper() if word in _ACRONYMS else word for word in campaign.split("_")]
    words[0] = words[0][:1].upper() + words[0][1:]
    return " ".join(words)


def _draw(result: StudyResult, figure: CampaignFigure, script: StudyScript) -> Drawing | None:
    """Return the drawing of a figure in study.yaml, by a plot of the report; None if there is nothing to draw.

    Raises
    ------
    InputError
        The campaign has no case with the levels of the figure.
    """
    case = _cases(result, figure.case)[0]
    for levels in figure.cases:  # an InputError for levels without a case
        _cases(result, levels)
    error = (figure.quantity, figure.cases, figure.axis, figure.during)
    arguments: dict[str, tuple[Any, ...]] = {
        "spread": (_references(result, script),),
        "errors": error,
        "relative": error,
        "autocorrelation": (figure.cases, figure.channels),
        "locus": _locus_arguments(figure),
        "sweep": (figure.band,),
        "envelope": (case, figure.quantity),
        "budget": (case, figure.quantity),
        "motion": (case, figure.quantity),
    }
    plot = PLOTS[figure.plot]
    plot_arguments = arguments.get(figure.plot, (case,))
    drawing: Drawing | None = plot(result.tables, *plot_arguments)
    return drawing


def _references(result: StudyResult, script: StudyScript) -> list[Mapping[str, Any]]:
    """Return the published numbers of a campaign, of its card and of the script."""
    campaign = result.campaign
    return [*campaign.model_dump(mode="json")["references"], *script.references(campaign.name)]


def _locus_arguments(figure: CampaignFigure) -> tuple[Any, ...]:
    """Return the arguments of the plot `locus` after the tables."""
    published_value = None
    if figure.published is not None:
        published_value = PublishedValue(figure.published, figure.band or (0.5, 2.0))
    metric = figure.model_dump(include={"metric", "at", "during", "statistic"})
    return (figure.axis, metric, figure.unit, published_value, figure.cases, figure.varied, figure.study_level)


def _cases(result: StudyResult, case: Case) -> list[str]:
    """Return the digests of the cases with the levels given in study.yaml; InputError if there is none."""
    digests = cases_of(result.tables, case, ())
    if not digests:
        labels = list(result.tables.labels.values())
        raise InputError(f"study.yaml: {result.study_campaign.campaign}: no case {case}; there are {labels}")
    return digests


def agreements(study_results: Sequence[StudyResult]) -> Section:
    """Return the appendix with the cases in which runs and linear covariance disagree."""
    frames = [by_case(result.tables).assign(campaign=result.study_campaign.campaign) for result in study_results]
    frame = pd.concat(frames, ignore_index=True)
    frame = frame[frame.verdict != "no runs"]
    frame = frame.assign(
        outside=frame.outside_count.astype(str) + " of " + frame.tested_count.astype(str),
        furthest=frame.state + " at " + frame.event,
    )
    differing = frame[frame.verdict != "agree"]
    blocks: list[Block] = [Text(note("study_agreement", level=percent(0.01)))]
    if len(differing):
        blocks.append(formatted_table("study_agreement", differing))
    return Section("agreement", APPENDIX, blocks)


def reproduce(study: StudyCard, study_results: Sequence[StudyResult]) -> Section:
    """Return the command, seeds and digests of each campaign."""
    rows = []
    for result in study_results:
        campaign = result.tables.campaign
        manifest = result.tables.manifest
        monte_carlo = campaign.get("monte_carlo") or {}
        rows.append(
            {
                "campaign": result.study_campaign.campaign,
                "seed": str(campaign.get("seed")),
                "runs per case": str(monte_carlo.get("runs", 0)),
                "campaign digest": manifest.get("campaign_digest", ""),
                "code digest": manifest.get("code_digest", ""),
            }
        )
    place = study.name or "FOLDER"
    command = Text(f"lvnav-trade study {place} --keep reports/{place}", block_type="code")
    blocks: list[Block] = [command, Text(note("study_reproduce", place=place)), table(pd.DataFrame(rows))]
    return Section("reproduce", "How to reproduce", blocks)
