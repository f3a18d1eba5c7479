"""Recount of a study report in a repository, without results or with the results of some campaigns."""

import re
from collections.abc import Collection, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.study_card import StudyCard
from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.quantities.input_files import read_text
from lvnav_trade.quantities.input_limits import DATA_BYTES
from lvnav_trade.report.blocks import Section
from lvnav_trade.report.build import markdown_page, pictures
from lvnav_trade.report.escape import csv_text
from lvnav_trade.report.script import StudyResult, StudyScript
from lvnav_trade.report.study import (
    APPENDIX,
    agreement_rows,
    agreements,
    answer,
    assumptions,
    campaign_row,
    campaign_section,
    flight_of,
    heading,
    join_frames,
    published_frame,
    published_table,
    reproduce,
)
from lvnav_trade.results.evaluation.published import COLUMNS, MARKS, is_evidence, is_reproduced, marks, verdict_in_band
from lvnav_trade.results.statistics.select import with_display_units
from lvnav_trade.results.tables.contents import owned_folder

_ANSWER, _ASSUMPTIONS, _REPRODUCE = "Answer", "Assumptions", "How to reproduce"
_EARLIER = "Monte Carlo against linear covariance"  # appendix of reports of earlier versions, with every case
_CAMPAIGNS = "The campaigns of this study.\n"
_COUNTS_AS = {"references": "number", "statements": "statement"}  # by list of entries; all others count as orders
_TEXTS = ("id", "source", "item", "case", "metric", "unit", "verdict", "remark", *MARKS)


class _Page(NamedTuple):
    """A report in a repository.

    head : Text before the first section.
    sections : Text of each section by heading.
    """

    head: str
    sections: dict[str, str]


def recount(study: StudyCard, campaigns: Sequence[Campaign], folder: Path | str, script: StudyScript) -> Path:
    """Update references.csv and the answer of a stored report with the present items and marks of the study.

    Numbers, figures and sections of the campaigns are unchanged. Cases in which both engines agree are removed from the
    appendix.

    Parameters
    ----------
    study : StudyCard
        Texts and layout of the report.
    campaigns : sequence of Campaign
        All campaigns of the study.
    folder : Path or str
        Folder of the stored report.
    script : StudyScript
        Additions to the report.

    Returns
    -------
    Path
        report.md.

    Raises
    ------
    InputError
        The folder has no such report, or the study lacks the entry of a stored row.
    """
    place = Path(folder)
    rows = _mark_rows(_stored_rows(place), _study_entries(campaigns, script))
    page = _stored_page(place)
    section = answer(study, rows, script, _campaign_lines(page.sections[_ANSWER], rows))
    page.sections[_ANSWER] = _section_text(section)
    _update_appendix(page.sections, ())
    files = {
        "references.csv": csv_text(rows).encode(),
        "report.md": _page_bytes(page),
        **pictures([section]),
    }
    with writing(place, "the study cannot be kept there"):
        for name, content in files.items():
            (place / name).write_bytes(content)
    return place / "report.md"


def renew(
    study: StudyCard,
    campaigns: Sequence[Campaign],
    folder: Path | str,
    script: StudyScript,
    study_results: Sequence[StudyResult],
) -> Path:
    """Update a stored study report with new results of some campaigns, and recount all of it.

    study, folder, script : as in `recount`
    campaigns : all campaigns of the study, in order
    study_results : new results; rows, figures and sections of the other campaigns are unchanged

    InputError if the folder has no such report. Returns report.md.
    """
    place = Path(folder)
    target = owned_folder(place, "study")
    page = _stored_page(place)
    names = [campaign.name for campaign in campaigns]
    study_results = [result._replace(tables=with_display_units(result.tables, study.units)) for result in study_results]
    new_results = {result.study_campaign.campaign: result for result in study_results}
    frames = [published_frame(result, script) for result in study_results]
    unchanged_rows = _unchanged_rows(place, campaigns, script, new_results)
    unchanged_lines = _campaign_lines(page.sections[_ANSWER], unchanged_rows)
    with_results = {line["campaign"] for line in unchanged_lines} | set(new_results)

    rows = _sort_rows([unchanged_rows, join_frames(study_results, frames)], names)
    further_rows = script.further_rows([campaign for campaign in campaigns if campaign.name not in with_results])
    if further_rows:
        rows = pd.concat([rows, published_table(further_rows)], ignore_index=True)

    lines = {line["campaign"]: line for line in _campaign_lines(page.sections[_ANSWER], rows)}
    lines |= {name: campaign_row(result, rows) for name, result in new_results.items()}
    sections = [
        answer(study, rows, script, [lines[name] for name in names if name in lines]),
        *assumptions(study),
    ]
    for result, frame in zip(study_results, frames, strict=True):
        sections.append(campaign_section(result, frame, script))

    files: dict[str, bytes] = {
        **pictures(sections),
        "references.csv": csv_text(rows).encode(),
        "agreement.csv": csv_text(_agreement_rows(place, study_results, names)).encode(),
        "report.md": _page_bytes(_renewed_page(page, study, sections, study_results, names)),
    }
    for name, result in new_results.items():
        if result.study_campaign.kml is not None:
            files[f"{name}.kml"] = flight_of(result, result.study_campaign.kml)
    figures_of_new = tuple(f"figures/{name}-" for name in new_results)
    earlier_figures = {name for name in target.listed_names("study") if name.startswith(figures_of_new)}
    with writing(place, "the study cannot be kept there"):
        target.claim("study", files)
        for name, content in files.items():
            (place / name).write_bytes(content)
        target.remove("study", earlier_figures - set(files))
    return place / "report.md"


def _unchanged_rows(
    place: Path, campaigns: Sequence[Campaign], script: StudyScript, new_campaigns: Collection[str]
) -> pd.DataFrame:
    """Return the stored rows of the campaigns that are not in `new_campaigns`, with their present items and marks."""
    stored_rows = _stored_rows(place)
    is_new = _campaign_names(stored_rows).isin(list(new_campaigns))
    unchanged_rows = stored_rows[(stored_rows["case"] != "") & ~is_new]
    return _mark_rows(unchanged_rows, _study_entries(campaigns, script))


def _renewed_page(
    page: _Page,
    study: StudyCard,
    sections: Sequence[Section],
    study_results: Sequence[StudyResult],
    names: Sequence[str],
) -> _Page:
    """Return a stored report with new sections, and with updated lines of some campaigns in common tables.

    page : the stored report
    sections : sections to replace or insert
    study_results : new results
    names : names of all campaigns, in order
    """
    new_campaigns = [result.study_campaign.campaign for result in study_results]
    page = _insert_sections(page, sections, [heading(name) for name in names])
    head = markdown_page(study.title, study.description.strip(), [])
    _merge_lines(page.sections, reproduce(study, study_results), _REPRODUCE, new_campaigns, names)
    _update_appendix(page.sections, new_campaigns)
    _merge_lines(page.sections, agreements(study_results), APPENDIX, new_campaigns, names)
    return page._replace(head=head.rstrip() + "\n\n")


def _stored_page(place: Path) -> _Page:
    """Return the stored report; InputError if it has no answer."""
    head, *chunks = re.split(r"(?m)^## ", read_text(place / "report.md", DATA_BYTES))
    sections = {}
    for chunk in chunks:
        title, _, body = chunk.partition("\n")
        sections[title] = body
    if _CAMPAIGNS not in sections.get(_ANSWER, ""):
        raise InputError(f"{place / 'report.md'}: is not the report of a study with an answer")
    return _Page(head, sections)


def _page_bytes(page: _Page) -> bytes:
    section_texts = [f"## {title}\n{text.rstrip()}\n" for title, text in page.sections.items()]
    return (page.head + "\n".join(section_texts)).encode()


def _section_text(section: Section) -> str:
    """Return the Markdown of a section below its heading."""
    page = markdown_page("", "", [section])
    section_start = page.index("\n## ") + 1
    return page[section_start:].partition("\n")[2]


def _insert_sections(page: _Page, sections: Sequence[Section], order: Sequence[str]) -> _Page:
    """Return a report with sections replaced or inserted.

    order : headings of the campaigns, in the order of the report
    """
    sections_by_title = page.sections | {section.title: _section_text(section) for section in sections}
    first = [title for title in (_ANSWER, _ASSUMPTIONS) if title in sections_by_title]
    middle = [title for title in order if title in sections_by_title]
    last = [title for title in sections_by_title if title not in {*first, *middle}]
    titles = first + middle + last
    return page._replace(sections={title: sections_by_title[title] for title in titles})


def _update_appendix(sections: dict[str, str], new_campaigns: Collection[str]) -> None:
    """Move the comparison of both engines to the end.

    Lines on cases in which the engines agree, and on the campaigns in `new_campaigns`, are removed.
    """
    text = sections.pop(_EARLIER, None) or sections.pop(APPENDIX, None)
    if text is None:
        return
    remaining_lines = []
    for line in text.split("\n"):
        if " | agree | " not in line and _first_cell(line) not in new_campaigns:
            remaining_lines.append(line)
    sections[APPENDIX] = "\n".join(remaining_lines)


def _first_cell(line: str) -> str:
    """Return the first cell of a table row; empty for any other line."""
    if line.startswith("|"):
        return line[1:].partition("|")[0].strip()
    return ""


def _merge_lines(
    sections: dict[str, str], section: Section, title: str, new_campaigns: Collection[str], names: Sequence[str]
) -> None:
    """Replace the lines of some campaigns in the table of a stored section, in place.

    sections : text of the stored sections by heading; changed
    section : the section with the campaigns in `new_campaigns` only
    title : heading of the stored section
    new_campaigns : names of the campaigns with new lines
    names : names of all campaigns, in the order of the table
    """
    new_text = _section_text(section)
    stored_text = sections.get(title, new_text)
    campaign_lines = []
    for line in stored_text.split("\n"):
        campaign = _first_cell(line)
        if campaign in names and campaign not in new_campaigns:
            campaign_lines.append(line)
    campaign_lines += [line for line in new_text.split("\n") if _first_cell(line) in new_campaigns]
    campaign_lines.sort(key=lambda line: names.index(_first_cell(line)))

    has_table = "\n|" in stored_text
    frame = (stored_text if has_table else new_text).split("\n")
    frame = [line for line in frame if _first_cell(line) not in names]
    table_lines = [k for k, line in enumerate(frame) if line.startswith("|")]
    table_end = table_lines[-1] + 1 if table_lines else len(frame)
    sections[title] = "\n".join(frame[:table_end] + campaign_lines + frame[table_end:])


def _campaign_names(rows: pd.DataFrame) -> pd.Series:
    """Return the campaign of each row, which is written before its case."""
    return rows["case"].str.partition(": ")[0]


def _sort_rows(frames: Sequence[pd.DataFrame], names: Sequence[str]) -> pd.DataFrame:
    """Return the rows of all frames in the order of their campaigns."""
    rows = pd.concat([frame for frame in frames if len(frame)] or frames[:1], ignore_index=True)
    places = {name: k for k, name in enumerate(names)}
    place = _campaign_names(rows).map(places)
    return rows.iloc[place.argsort(kind="stable")].reset_index(drop=True)


def _agreement_rows(place: Path, study_results: Sequence[StudyResult], names: Sequence[str]) -> pd.DataFrame:
    """Return the rows of agreement.csv, with those of the campaigns in `study_results` replaced.

    place : folder of the stored report
    names : names of all campaigns, in the order of the rows
    """
    stored_rows = _text_table(read_text(place / "agreement.csv", DATA_BYTES))
    new_rows = _text_table(csv_text(agreement_rows(study_results)))
    campaigns = [result.study_campaign.campaign for result in study_results]
    unchanged_rows = stored_rows[~_campaign_names(stored_rows).isin(campaigns)]
    return _sort_rows([unchanged_rows, new_rows], names)


def _text_table(text: str) -> pd.DataFrame:
    """Return a CSV table with all cells as text."""
    return pd.read_csv(StringIO(text), dtype=str, keep_default_na=False)


def _stored_rows(place: Path) -> pd.DataFrame:
    """Return the rows of the stored references.csv, with text columns as text."""
    text = read_text(place / "references.csv", DATA_BYTES)
    rows = pd.read_csv(StringIO(text), dtype=dict.fromkeys(_TEXTS, str)).reindex(columns=COLUMNS)
    for name in _TEXTS:
        rows[name] = rows[name].astype(object).where(rows[name].notna(), "")
    return rows


class _Entry(NamedTuple):
    """An entry in the folder of a study from which a row of references.csv is made.

    identifier : Identifier of the row.
    counts_as : Group in which the row counts.
    content : The entry.
    """

    identifier: str
    counts_as: str
    content: Mapping[str, Any]


def _study_entries(campaigns: Sequence[Campaign], script: StudyScript) -> list[_Entry]:
    """Return the entries in the folder of the study."""
    study_entries = []
    for campaign in campaigns:
        lists = dict(script.entries(campaign.name))
        references = campaign.model_dump(mode="json")["references"]
        lists["references"] = [*references, *lists.get("references", ())]
        for key, entries in lists.items():
            counts_as = _COUNTS_AS.get(key, "order")
            for number, entry in enumerate(entries, 1):
                identifier = entry["id"] or f"{campaign.name} {key} {number}"
                study_entries.append(_Entry(identifier, counts_as, entry))
    for entry in script.entries("").get("statements", ()):
        study_entries.append(_Entry(str(entry["id"]), "statement", entry))
    return study_entries


def _mark_rows(rows: pd.DataFrame, entries: Sequence[_Entry]) -> pd.DataFrame:
    """Return rows with their present items and marks; InputError if the study no longer has the entry of a row.

    rows : rows of references.csv
    """
    by_identifier: dict[str, list[_Entry]] = {}
    for entry in entries:
        by_identifier.setdefault(entry.identifier, []).append(entry)
    marked_rows = []
    for row in rows.to_dict(orient="records"):
        item = str(row["item"])
        candidates = [
            entry for entry in by_identifier.get(row["id"], []) if item.startswith(str(entry.content["item"]))
        ]
        if not candidates:
            label = row["id"] or row["item"]
            raise InputError(f"references.csv: the study has no statement any more for {label!r}; run the study")
        # Entries may share an identifier, and the item of one may begin with that of another
        entry = max(candidates, key=lambda candidate: len(str(candidate.content["item"])))
        verdict = verdict_in_band(row, entry.content) if entry.counts_as == "number" else {}
        marked_rows.append(
            {
                **row,
                "item": entry.content["item"],
                **verdict,
                **marks(entry.content, entry.counts_as),
            }
        )
    return pd.DataFrame(marked_rows, columns=COLUMNS)


def _campaign_lines(text: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of the campaign table in a stored answer, recounted."""
    table = text.partition(_CAMPAIGNS)[2].strip().partition("\n\n")[0]
    headings, _, *lines = [_split_cells(line) for line in table.split("\n")]
    campaign_rows = []
    for line in lines:
        cells: dict[str, Any] = dict(zip(headings, line, strict=True))
        is_of_campaign = rows["case"].str.startswith(f"{cells['campaign']}: ")
        evidence_rows = rows[is_of_campaign & is_evidence(rows)]
        for name in ("cases", "runs", "failed runs"):
            cells[name] = int(cells[name])
        cells["as published"] = "–"
        if len(evidence_rows):
            n_held = int(is_reproduced(evidence_rows).sum())
            cells["as published"] = f"{n_held} of {len(evidence_rows)}"
        campaign_rows.append(cells)
    return campaign_rows


def _split_cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]
