"""The page of a study: what was published beside ours, campaign by campaign, with figures, remarks and assumptions."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from matplotlib.figure import Figure as Drawing

from lvnav_trade.campaign.definition.published import Case
from lvnav_trade.campaign.reading.study import Figure, Part, Study
from lvnav_trade.errors import InputError, writing
from lvnav_trade.metrics.errors.agreement import agreement, by_case
from lvnav_trade.metrics.published.published import cases_of
from lvnav_trade.metrics.published.references import references
from lvnav_trade.plots import PLOTS
from lvnav_trade.plots.published import ratios
from lvnav_trade.plots.study import single, steps
from lvnav_trade.report.blocks import Block, Section, Text, percent, picture, table
from lvnav_trade.report.build import markdown_page, pictures
from lvnav_trade.report.escape import csv_text, note
from lvnav_trade.report.kml import flights, kml
from lvnav_trade.report.sections import stated
from lvnav_trade.report.study_tables import missions_table, noise_table, study_tables
from lvnav_trade.report.vehicle import control_tables, motion_summary, observed_table
from lvnav_trade.store import Tables
from lvnav_trade.store.contents import owned


class Answered(NamedTuple):
    """A campaign of the study with its results; stated: references, orderings, innovations as the campaign has them;
    behind: what the study computes beside them (campaign.behind.Behind), or None.
    """

    part: Part
    tables: Tables
    stated: dict[str, Any]
    behind: Any = None

    @property
    def flown(self) -> list[dict[str, Any]]:
        """The published single flights that are shown among ours."""
        return [one.model_dump(mode="json") for one in self.part.flown]


def build(study: Study, answered: Sequence[Answered], folder: Path | str) -> Path:
    """Write report.md, figures/ and the two CSV tables of a study into a folder; return the page.

    What an earlier page left there is replaced. InputError where the folder cannot be written.
    """
    target = owned(folder, "study")
    published = _together(answered, [references(one.tables, one.stated) for one in answered])
    agreed = [agreement(one.tables) for one in answered]
    engines = _together(answered, [frame[frame.monte_carlo.notna()] for frame in agreed])
    sections = [_answer(answered, published), *_assumptions(study)]
    sections += [_campaign(one) for one in answered]
    sections += [_agreements(answered), _reproduce(study, answered)]
    files: dict[str, bytes | str] = {**pictures(sections)}
    files |= {"references.csv": csv_text(published), "agreement.csv": csv_text(engines)}
    files["report.md"] = markdown_page(study.title, study.description.strip(), sections)
    files |= {f"{one.part.campaign}.kml": _flight(one, one.part.kml) for one in answered if one.part.kml is not None}
    with writing(folder, "the study cannot be kept there"):
        target.publish("study", files)
    return target.folder / "report.md"


def _flight(one: Answered, case: Case) -> bytes:
    """Return the flight of the case that is asked for as KML, with ellipses of its position error every minute."""
    label = one.tables.labels[_cases(one, case)[0]]
    drawn = [flight for flight in flights(one.tables, True, 60.0) if flight.name == label]
    return kml(f"{one.part.campaign}: {label}", drawn)


def _together(answered: Sequence[Answered], frames: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Return the frames of all campaigns, the campaign's name before each case."""
    named = [
        frame.assign(case=[f"{one.part.campaign}: {case}" for case in frame["case"]])
        for one, frame in zip(answered, frames, strict=True)
    ]
    return pd.concat([frame for frame in named if len(frame)] or named[:1], ignore_index=True)


def _answer(answered: Sequence[Answered], frame: pd.DataFrame) -> Section:
    blocks: list[Block] = []
    numbers, orders = frame[frame.published.notna()], frame[frame.published.isna()]
    for rows, what in (
        (numbers, "numbers lie in the band that their campaign states"),
        (orders, "orderings and statements on innovations hold"),
    ):
        if len(rows):
            blocks.append(Text(f"{int(rows.in_band.sum())} of {len(rows)} published {what}."))
    lines = [_line(one, frame) for one in answered]
    blocks.append(table(pd.DataFrame(lines), "The campaigns of this study."))
    if len(numbers):
        blocks.append(picture("ratios", ratios(numbers), "All published numbers at once."))
    outside = frame[~frame.in_band]
    if len(outside):
        blocks.append(stated("out_of_band", outside))
    return Section("answer", "Answer", blocks)


def _line(one: Answered, frame: pd.DataFrame) -> dict[str, Any]:
    mine = frame[frame["case"].str.startswith(f"{one.part.campaign}: ")]
    counted, cases = by_case(one.tables), one.tables.cases
    tested = counted[counted.verdict.isin(["agree", "disagree"])]
    agree = int((tested.verdict == "agree").sum())
    return {
        "campaign": one.part.campaign,
        "cases": len(cases),
        "runs": int(cases.run_count.sum()),
        "failed runs": int(cases.failed_count.sum()),
        "as published": f"{int(mine.in_band.sum())} of {len(mine)}" if len(mine) else "–",
        "both engines agree": f"{agree} of {len(tested)} cases" if len(tested) else "–",
    }


def _assumptions(study: Study) -> list[Section]:
    texts: list[Block] = [Text(f"{k}. {text}") for k, text in enumerate(study.assumptions, 1)]
    return [Section("assumptions", "Assumptions", texts)] * bool(texts)


def _campaign(one: Answered) -> Section:
    """Return a campaign's section: its question, its figures, its numbers, what is said of it."""
    part, tables = one.part, one.tables
    question = part.question or str(one.stated.get("description") or "")
    blocks: list[Block] = [Text(" ".join(question.split()))] if question else []
    frame = references(tables, one.stated)
    if len(frame):
        blocks.append(stated("study_references", frame, sources="; ".join(dict.fromkeys(frame.source))))
    blocks += missions_table(tables, one.flown)
    blocks += [*motion_summary(tables), *control_tables(tables, brief=True), *observed_table(tables)]
    blocks += study_tables(tables, part.tables, part.paired)
    blocks += _behind(one)
    shown = [(f"{place}-{figure.plot}", figure) for place, figure in enumerate(part.figures, 1)]
    if not any(figure.plot == "spread" for figure in part.figures):
        shown.append(("spread", Figure(plot="spread")))
    for name, figure in shown:
        drawn = _draw(one, figure)
        if drawn is not None:
            caption = figure.caption or note(figure.plot, "figures_of_a_study", **figure.model_dump())
            blocks.append(picture(f"{part.campaign}-{name}", drawn, " ".join(caption.split())))
    if part.kml is not None:
        text = f"The flight with its 3-sigma position errors, for viewers of the Earth: {part.campaign}.kml."
        blocks.append(Text(text))
    blocks += [Text(" ".join(paragraph.split())) for paragraph in part.text.split("\n\n") if paragraph.strip()]
    return Section(part.campaign, part.campaign.replace("_", " ").capitalize(), blocks)


def _behind(one: Answered) -> list[Block]:
    """Return process noise by phase and the error per step, of every length of a step; a single flight."""
    blocks: list[Block] = []
    if one.behind is None:
        return blocks
    if one.behind.single is not None:
        caption = f"One flight (run {one.part.single.run if one.part.single else 0}): what the filter estimates."
        blocks.append(picture(f"{one.part.campaign}-single", single(one.behind.single), caption))
    for step, found in one.behind.noise:
        drawn = steps(found.steps, [phase[:3] for phase in found.phases])
        caption = f"Error of the unaided system, and what the transition misses of it in steps of {step:g} s."
        blocks += [noise_table(found, step), picture(f"{one.part.campaign}-steps-{step:g}", drawn, caption)]
    return blocks


def _draw(one: Answered, figure: Figure) -> Drawing | None:
    case, many, quantity = _cases(one, figure.case)[0], figure.cases, figure.quantity
    for asked in many:
        _cases(one, asked)
    over = (quantity, many, figure.axis, figure.during)
    metric = figure.model_dump(include={"metric", "at", "during", "statistic"})
    arguments: dict[str, tuple[Any, ...]] = {
        "spread": (one.stated.get("references") or (),),
        "errors": over,
        "relative": over,
        "autocorrelation": (many, figure.channels),
        "locus": (figure.axis, metric, figure.unit, figure.published, figure.band, many),
        "missions": (one.flown,),
        "sweep": (),
        "interpretations": (),
        "worth": (many,),
        "apart": (many,),
        "envelope": (case, quantity),
        "budget": (case, quantity),
        "motion": (case, quantity),
    }
    drawn: Drawing | None = PLOTS[figure.plot](one.tables, *arguments.get(figure.plot, (case,)))
    return drawn


def _cases(one: Answered, case: Case) -> list[str]:
    """Return the digests of a case as study.yaml names it; InputError where there is none."""
    found = list(cases_of(one.tables, case))
    if not found:
        known = list(one.tables.labels.values())
        raise InputError(f"study.yaml: {one.part.campaign}: no case {case}; there are {known}")
    return found


def _agreements(answered: Sequence[Answered]) -> Section:
    frame = pd.concat([by_case(one.tables).assign(campaign=one.part.campaign) for one in answered], ignore_index=True)
    frame = frame[frame.verdict != "no runs"]
    frame = frame.assign(
        outside=frame.outside_count.astype(str) + " of " + frame.tested_count.astype(str),
        furthest=frame.state + " at " + frame.event,
    )
    title = "Monte Carlo against linear covariance"
    return Section(
        "agreement", title, [Text(note("study_agreement", level=percent(0.01))), stated("study_agreement", frame)]
    )


def _reproduce(study: Study, answered: Sequence[Answered]) -> Section:
    rows = [
        {
            "campaign": one.part.campaign,
            "seed": str(one.tables.campaign.get("seed")),
            "runs per case": str((one.tables.campaign.get("monte_carlo") or {}).get("runs", 0)),
            "campaign digest": one.tables.manifest.get("campaign_digest", ""),
            "code digest": one.tables.manifest.get("code_digest", ""),
        }
        for one in answered
    ]
    place = study.name or "FOLDER"
    command = f"lvnav-trade study {place} --keep reports/{place}"
    return Section(
        "reproduce",
        "How to reproduce",
        [Text(command, kind="code"), Text(note("study_reproduce", place=place)), table(pd.DataFrame(rows))],
    )
