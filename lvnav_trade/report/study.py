"""The page of a study: what was published beside ours, campaign by campaign, with figures, remarks and assumptions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from matplotlib.figure import Figure as Drawing

from lvnav_trade.campaign.definition.published import Case
from lvnav_trade.campaign.reading.study import Figure, Part, Study
from lvnav_trade.errors import InputError
from lvnav_trade.metrics.errors.agreement import agreement, by_case
from lvnav_trade.metrics.published.published import cases_of
from lvnav_trade.metrics.published.references import references
from lvnav_trade.plots import PLOTS
from lvnav_trade.plots.published import ratios
from lvnav_trade.plots.single_run import single
from lvnav_trade.plots.steps import steps
from lvnav_trade.report.blocks import Block, Code, Section, Text, number, percent, picture, table
from lvnav_trade.report.build import markdown_page, pictures
from lvnav_trade.report.escape import csv_text
from lvnav_trade.report.kml import flights, kml
from lvnav_trade.report.study_tables import missions_table, noise_table, study_tables
from lvnav_trade.report.vehicle import control_tables, motion_summary, observed_table
from lvnav_trade.store import Tables
from lvnav_trade.store.contents import owned

CSV = ("references", "agreement")
_CAPTIONS = {
    "errors": "RMS of the {quantity} error: Monte Carlo as lines, linear covariance as short dashes.",
    "relative": "RMS of the {quantity} error over that of the first case; dots: the filter's own sigma over the true.",
    "envelope": "The {quantity} error of one case, an axis below the other.",
    "budget": "What the {quantity} error is made of.",
    "locus": "{metric} against {axis}.",
    "trajectory": "The flight.",
    "satellites": "Satellites in view, tracked, and their C/N0; faults shaded.",
    "sky": "The sky at the antenna.",
    "timeline": "What the receiver's channels do with every satellite.",
    "delays": "Delays of the signals, and what corrections leave of them.",
    "latency": "Age of a measurement when the filter takes it.",
    "consistency": "Normalised errors and innovations squared against their bounds.",
    "logic": "What the filter does over the flight, part of runs; events as lines, faults shaded.",
    "orbit": "Errors of the orbit.",
    "impact": "Points of impact.",
    "motion": "Errors of the {quantity}: raw sample and estimate.",
    "ignition": "Filtered over raw sample around lift-off.",
    "singular": "Singular values of what each stretch of flight tells.",
    "movement": "Movement of the nozzle by what feeds the controller; the band holds all runs.",
    "sweep": "How much less the nozzle moves with the filtered rate, over the rate gain.",
    "turning": "True angular acceleration in pitch and jerk along z of one run, and what the filter expects.",
    "worth": "What feeds the controller is worth: movement of the nozzle, and how well the attitude is study_tables.",
    "apart": "By how many percent the true sigma of one case is smaller than that of another, linear covariance.",
    "interpretations": "By how much the estimate's sigma lies below the sample's; marks: what is stated.",
    "autocorrelation": "Autocorrelation of the innovations (blue: position or range, red: velocity or range rate); "
    "grey: 95 % of what one flight of white ones shows.",
    "missions": "Flown missions among our flights.",
    "spread": "Published single flights among ours, each by itself.",
}


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
    frames = {"references": _together(answered, _references), "agreement": _together(answered, _agreement)}
    sections = [_answer(answered, frames["references"]), *_assumptions(study)]
    sections += [_campaign(one) for one in answered]
    sections += [_agreements(answered), _reproduce(study, answered)]
    files: dict[str, bytes | str] = {**pictures(sections)}
    files |= {f"{name}.csv": csv_text(frame) for name, frame in frames.items()}
    files["report.md"] = markdown_page(study.title, study.description.strip(), sections)
    files |= {f"{one.part.campaign}.kml": _flight(one, one.part.kml) for one in answered if one.part.kml is not None}
    try:
        target.claim("study", files)
        for name, content in files.items():
            target.write(name, content)
        target.replace("study", files)
    except OSError as error:
        raise InputError(f"{folder}: the study cannot be kept there: {error.strerror or error}") from error
    return target.folder / "report.md"


def _flight(one: Answered, case: Case) -> bytes:
    """Return the flight of the case that is asked for as KML, with ellipses of its position error every minute."""
    _one_at_least(one, case)
    label = one.tables.labels[cases_of(one.tables, case)[0]]
    drawn = [flight for flight in flights(one.tables, True, 60.0) if flight.name == label]
    return kml(f"{one.part.campaign}: {label}", drawn)


def _references(one: Answered) -> pd.DataFrame:
    return references(one.tables, one.stated)


def _agreement(one: Answered) -> pd.DataFrame:
    """Return the rows of a campaign with runs; without any there is nothing to hold against each other."""
    frame = agreement(one.tables)
    return frame[frame.monte_carlo.notna()]


def _together(answered: Sequence[Answered], frame_of: Callable[[Answered], pd.DataFrame]) -> pd.DataFrame:
    """Return the frames of all campaigns, the campaign's name before each case."""
    frames = [frame_of(one).assign(campaign=one.part.campaign) for one in answered]
    whole = pd.concat([frame for frame in frames if len(frame)] or frames[:1], ignore_index=True)
    whole["case"] = whole.campaign + ": " + whole["case"]
    return whole.drop(columns="campaign")


def _answer(answered: Sequence[Answered], frame: pd.DataFrame) -> Section:
    """Return the first section: how many numbers lie in their band, and which do not."""
    blocks: list[Block] = []
    numbers, orders = frame[frame.published.notna()], frame[frame.published.isna()]
    if len(numbers):
        inside = int(numbers.in_band.sum())
        blocks.append(Text(f"{inside} of {len(numbers)} published numbers lie in the band that their campaign states."))
    if len(orders):
        study_tables = int(orders.in_band.sum())
        blocks.append(Text(f"{study_tables} of {len(orders)} published orderings and statements on innovations hold."))
    rows = [_line(one, frame) for one in answered]
    blocks.append(table(pd.DataFrame(rows), "The campaigns of this study."))
    if len(numbers):
        drawn = picture("ratios", ratios(numbers), "All published numbers at once.")
        blocks.append(drawn)
    outside = frame[~frame.in_band]
    if len(outside):
        caption = "Out of band, or not as published, and why."
        blocks.append(table(_shown(outside)[["item", "case", "metric", "published", "ours", "remark"]], caption))
    return Section("answer", "Answer", blocks)


def _line(one: Answered, frame: pd.DataFrame) -> dict[str, Any]:
    mine = frame[frame["case"].str.startswith(f"{one.part.campaign}: ")]
    counted = by_case(one.tables)
    tested = counted[counted.verdict.isin(["agree", "disagree"])]
    cases = one.tables.cases
    return {
        "campaign": one.part.campaign,
        "cases": len(cases),
        "runs": int(cases.run_count.sum()),
        "failed runs": int(cases.failed_count.sum()),
        "as published": f"{int(mine.in_band.sum())} of {len(mine)}" if len(mine) else "–",
        "both engines agree": f"{int((tested.verdict == 'agree').sum())} of {len(tested)} cases"
        if len(tested)
        else "–",
    }


def _shown(frame: pd.DataFrame) -> pd.DataFrame:
    """Return the rows as they stand on the page."""
    band = frame.band_low.map(number) + " to " + frame.band_high.map(number)
    shown = frame.assign(metric=frame.metric.str.replace("_", " "), band=band)
    return shown.rename(columns={"ratio": "ours / published (-)", "in_band": "in band"})


def _assumptions(study: Study) -> list[Section]:
    if not study.assumptions:
        return []
    return [
        Section("assumptions", "Assumptions", [Text(f"{k}. {text}") for k, text in enumerate(study.assumptions, 1)])
    ]


def _campaign(one: Answered) -> Section:
    """Return a campaign's section: its question, its figures, its numbers, what is said of it."""
    part, tables = one.part, one.tables
    question = part.question or str(one.stated.get("description") or "")
    blocks: list[Block] = [Text(" ".join(question.split()))] if question else []
    frame = references(tables, one.stated)
    if len(frame):
        wanted = [
            "item", "case", "metric", "unit", "published", "ours", "ours / published (-)", "band", "in band", "remark",
        ]  # fmt: skip
        blocks.append(
            table(_shown(frame)[wanted], f"Published beside ours ({'; '.join(dict.fromkeys(frame.source))}).")
        )
    blocks += missions_table(tables, one.flown)
    blocks += [*motion_summary(tables), *control_tables(tables, brief=True), *observed_table(tables)]
    blocks += study_tables(tables, part.tables, part.paired)
    blocks += _behind(one)
    for place, figure in enumerate(part.figures, 1):
        drawn = _draw(one, figure)
        if drawn is not None:
            caption = figure.caption or _CAPTIONS[figure.plot].format(**figure.model_dump())
            blocks.append(picture(f"{part.campaign}-{place}-{figure.plot}", drawn, " ".join(caption.split())))
    if not any(figure.plot == "spread" for figure in part.figures):
        drawn = PLOTS["spread"](tables, one.stated.get("references") or ())
        if drawn is not None:
            blocks.append(picture(f"{part.campaign}-spread", drawn, _CAPTIONS["spread"]))
    if part.kml is not None:
        blocks.append(
            Text(f"The flight with its 3-sigma position errors, for viewers of the Earth: {part.campaign}.kml.")
        )
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
        blocks.append(noise_table(found, step))
        drawn = steps(found.steps, [phase[:3] for phase in found.phases])
        caption = f"Error of the unaided system, and what the transition misses of it in steps of {step:g} s."
        blocks.append(picture(f"{one.part.campaign}-steps-{step:g}", drawn, caption))
    return blocks


def _draw(one: Answered, figure: Figure) -> Drawing | None:
    """Return a figure as study.yaml asks for it."""
    tables, plot = one.tables, PLOTS[figure.plot]
    for case in (figure.case, *figure.cases):
        _one_at_least(one, case)
    drawn: Drawing | None
    if figure.plot == "spread":
        drawn = plot(tables, one.stated.get("references") or ())
    elif figure.plot in ("errors", "relative"):
        drawn = plot(tables, figure.quantity, figure.cases, figure.axis, figure.during)
    elif figure.plot == "autocorrelation":
        drawn = plot(tables, figure.cases, figure.channels)
    elif figure.plot == "locus":
        stated = {"metric": figure.metric, "at": figure.at, "during": figure.during, "statistic": figure.statistic}
        drawn = plot(tables, figure.axis, stated, figure.unit, figure.published, figure.band, figure.cases)
    elif figure.plot == "missions":
        drawn = plot(tables, one.flown)
    elif figure.plot in ("sweep", "interpretations"):
        drawn = plot(tables)
    elif figure.plot in ("worth", "apart"):
        drawn = plot(tables, figure.cases)
    elif figure.plot in ("envelope", "budget", "motion"):
        drawn = plot(tables, cases_of(tables, figure.case)[0], figure.quantity)
    else:
        drawn = plot(tables, cases_of(tables, figure.case)[0])
    return drawn


def _one_at_least(one: Answered, case: Case) -> None:
    if not cases_of(one.tables, case):
        raise InputError(
            f"study.yaml: {one.part.campaign}: no case {case}; there are {list(one.tables.labels.values())}"
        )


def _agreements(answered: Sequence[Answered]) -> Section:
    """Return the verdict on every case: do Monte Carlo and linear covariance agree."""
    frames = [by_case(one.tables).assign(campaign=one.part.campaign) for one in answered]
    frame = pd.concat(frames, ignore_index=True)
    frame = frame[frame.verdict != "no runs"]
    shown = pd.DataFrame({"campaign": frame.campaign, "case": frame["case"], "verdict": frame.verdict})
    shown["rows outside"] = frame.outside_count.astype(str) + " of " + frame.tested_count.astype(str)
    shown["furthest"] = frame.state + " at " + frame.event
    shown["ratio (-)"], shown["bounds"] = frame.ratio, frame.low.map(number) + " to " + frame.high.map(number)
    shown["why not applicable"] = frame.reason
    text = (
        "Monte-Carlo RMS over what linear covariance expects of it, for the nine navigation errors at every event; "
        f"{percent(0.01)} family-wise level per case. All rows: agreement.csv."
    )
    return Section("agreement", "Monte Carlo against linear covariance", [Text(text), table(shown)])


def _reproduce(study: Study, answered: Sequence[Answered]) -> Section:
    """Return the command, seeds, digests."""
    rows = []
    for one in answered:
        manifest = one.tables.manifest
        runs = one.tables.campaign.get("monte_carlo") or {}
        rows.append(
            {
                "campaign": one.part.campaign,
                "seed": str(one.tables.campaign.get("seed")),
                "runs per case": str(runs.get("runs", 0)),
                "campaign digest": manifest.get("campaign_digest", ""),
                "code digest": manifest.get("code_digest", ""),
            }
        )
    place = study.name or "FOLDER"
    text = (
        f"The tables behind every figure stand in results/{place}/CAMPAIGN; lvnav-trade report makes a campaign's own "
        "page there. The same campaigns, seeds and code give the same tables byte for byte."
    )
    command = f"lvnav-trade study {place} --keep reports/{place}"
    return Section("reproduce", "How to reproduce", [Code(command), Text(text), table(pd.DataFrame(rows))])
