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
from lvnav_trade.report.script import StudyResult, StudyScript, published_rows
from lvnav_trade.report.study import (
    APPENDIX,
    agreed,
    agreements,
    answer,
    assumptions,
    campaign_section,
    flight_of,
    frame_of,
    heading,
    line_of,
    reproduce,
    together,
)
from lvnav_trade.results.evaluation.published import COLUMNS, MARKS, evidence, held, marks, verdict_in_band
from lvnav_trade.results.statistics.select import in_units
from lvnav_trade.results.tables.contents import owned

_ANSWER, _ASSUMPTIONS, _REPRODUCE = "Answer", "Assumptions", "How to reproduce"
_EARLIER = "Monte Carlo against linear covariance"  # appendix of reports of earlier versions, with every case
_CAMPAIGNS = "The campaigns of this study.\n"
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

    Raises
    ------
    InputError
        The folder has no such report.
    """
    place = Path(folder)
    rows, page = _marked(_kept(place), _stated(campaigns, script)), _page(place)
    section = answer(study, rows, script, _campaigns(page.sections[_ANSWER], rows))
    page.sections[_ANSWER] = _text(section)
    _to_appendix(page.sections, ())
    files = {"references.csv": csv_text(rows).encode(), "report.md": _written(page), **pictures([section])}
    with writing(place, "the study cannot be kept there"):
        for name, content in files.items():
            (place / name).write_bytes(content)
    return place / "report.md"


def renew(
    study: StudyCard,
    campaigns: Sequence[Campaign],
    folder: Path | str,
    script: StudyScript,
    answered: Sequence[StudyResult],
) -> Path:
    """Update a stored study report with new results of some campaigns, and recount all of it.

    campaigns : all campaigns of the study, in order
    answered : campaigns with results; rows, figures and sections of the others are unchanged

    InputError if the folder has no such report.
    """
    place, names = Path(folder), [each.name for each in campaigns]
    target, page, kept = owned(place, "study"), _page(place), _kept(place)
    answered = [each._replace(tables=in_units(each.tables, study.units)) for each in answered]
    new = {each.part.campaign: each for each in answered}
    published = [
        frame_of(published_rows(each.campaign.name, each.tables, each.campaign.model_dump(mode="json"), script))
        for each in answered
    ]
    unchanged = kept[(kept["case"] != "") & ~_campaign_of(kept).isin(list(new))]
    unchanged = _marked(unchanged, _stated(campaigns, script))
    with_results = {*new, *(line["campaign"] for line in _campaigns(page.sections[_ANSWER], unchanged))}
    further = script.further_rows([each for each in campaigns if each.name not in with_results])
    rows = pd.concat(
        [_in_order([unchanged, together(answered, published)], names), *([frame_of(further)] if further else [])],
        ignore_index=True,
    )
    lines = {line["campaign"]: line for line in _campaigns(page.sections[_ANSWER], rows)}
    lines |= {name: line_of(each, rows) for name, each in new.items()}
    sections = [
        answer(study, rows, script, [lines[name] for name in names if name in lines]),
        *assumptions(study),
        *(campaign_section(each, own, script) for each, own in zip(answered, published, strict=True)),
    ]
    page = _with_sections(page, sections, [heading(name) for name in names])
    page = page._replace(head=markdown_page(study.title, study.description.strip(), []).rstrip() + "\n\n")
    _merge(page.sections, _text(reproduce(study, answered)), _REPRODUCE, new, names)
    _to_appendix(page.sections, new)
    _merge(page.sections, _text(agreements(answered)), APPENDIX, new, names)
    files: dict[str, bytes] = {
        **pictures(sections),
        "references.csv": csv_text(rows).encode(),
        "agreement.csv": csv_text(_agreed(place, answered, names)).encode(),
        "report.md": _written(page),
        **{f"{name}.kml": flight_of(each, each.part.kml) for name, each in new.items() if each.part.kml is not None},
    }
    drawn = {name for name in target.listed("study") if any(name.startswith(f"figures/{each}-") for each in new)}
    with writing(place, "the study cannot be kept there"):
        target.claim("study", files)
        for name, content in files.items():
            (place / name).write_bytes(content)
        target.remove("study", drawn - set(files))
    return place / "report.md"


def _page(place: Path) -> _Page:
    """Return the stored report; InputError if it has no answer."""
    head, *parts = re.split(r"(?m)^## ", read_text(place / "report.md", DATA_BYTES))
    sections = {title: body for title, _, body in (chunk.partition("\n") for chunk in parts)}
    if _CAMPAIGNS not in sections.get(_ANSWER, ""):
        raise InputError(f"{place / 'report.md'}: is not the report of a study with an answer")
    return _Page(head, sections)


def _written(page: _Page) -> bytes:
    parts = [f"## {title}\n{text.rstrip()}\n" for title, text in page.sections.items()]
    return (page.head + "\n".join(parts)).encode()


def _text(section: Section) -> str:
    """Return the Markdown of a section below its heading."""
    page = markdown_page("", "", [section])
    return page[page.index("\n## ") + 1 :].partition("\n")[2]


def _with_sections(page: _Page, sections: Sequence[Section], order: Sequence[str]) -> _Page:
    """Return a report with sections replaced, or inserted in the order of the campaigns' headings."""
    updated = page.sections | {section.title: _text(section) for section in sections}
    first = [title for title in (_ANSWER, _ASSUMPTIONS) if title in updated]
    middle = [title for title in order if title in updated]
    last = [title for title in updated if title not in {*first, *middle}]
    return page._replace(sections={title: updated[title] for title in (*first, *middle, *last)})


def _to_appendix(sections: dict[str, str], new: Collection[str]) -> None:
    """Move the comparison of both engines to the end.

    Lines on cases in which the engines agree, and on the campaigns in `new`, are removed.
    """
    text = sections.pop(_EARLIER, None) or sections.pop(APPENDIX, None)
    if text is not None:
        remaining = [line for line in text.split("\n") if " | agree | " not in line and _first(line) not in new]
        sections[APPENDIX] = "\n".join(remaining)


def _first(line: str) -> str:
    """Return the first cell of a table row; empty for any other line."""
    return line[1:].partition("|")[0].strip() if line.startswith("|") else ""


def _merge(sections: dict[str, str], made: str, title: str, new: Collection[str], names: Sequence[str]) -> None:
    """Insert the lines of some campaigns into the table of a section, in the order of `names`."""
    before = sections.get(title, made)
    lines = [line for line in before.split("\n") if _first(line) in names and _first(line) not in new]
    lines += [line for line in made.split("\n") if _first(line) in new]
    frame = [line for line in (before if "\n|" in before else made).split("\n") if _first(line) not in names]
    at = max((k for k, line in enumerate(frame) if line.startswith("|")), default=len(frame) - 1) + 1
    sections[title] = "\n".join([*frame[:at], *sorted(lines, key=lambda line: names.index(_first(line))), *frame[at:]])


def _campaign_of(rows: pd.DataFrame) -> pd.Series:
    return rows["case"].str.partition(": ")[0]


def _in_order(frames: Sequence[pd.DataFrame], names: Sequence[str]) -> pd.DataFrame:
    """Return the rows of all frames in the order of their campaigns."""
    rows = pd.concat([frame for frame in frames if len(frame)] or frames[:1], ignore_index=True)
    place = _campaign_of(rows).map({name: k for k, name in enumerate(names)})
    return rows.iloc[place.argsort(kind="stable")].reset_index(drop=True)


def _agreed(place: Path, answered: Sequence[StudyResult], names: Sequence[str]) -> pd.DataFrame:
    """Return the rows of agreement.csv, with those of the answered campaigns replaced."""
    texts = (read_text(place / "agreement.csv", DATA_BYTES), csv_text(agreed(answered)))
    before, after = (pd.read_csv(StringIO(text), dtype=str, keep_default_na=False) for text in texts)
    return _in_order(
        [before[~_campaign_of(before).isin([campaign_results.part.campaign for campaign_results in answered])], after],
        names,
    )


def _kept(place: Path) -> pd.DataFrame:
    """Return the rows of the stored references.csv, with text columns as text."""
    text = read_text(place / "references.csv", DATA_BYTES)
    rows = pd.read_csv(StringIO(text), dtype=dict.fromkeys(_TEXTS, str)).reindex(columns=COLUMNS)
    return rows.assign(**{name: rows[name].astype(object).where(rows[name].notna(), "") for name in _TEXTS})


def _stated(campaigns: Sequence[Campaign], script: StudyScript) -> list[tuple[str, str, Mapping[str, Any]]]:
    """Return the entries in the folder of the study: identifier of the row, kind by which it counts, and the entry."""
    stated_entries: list[tuple[str, str, Mapping[str, Any]]] = []
    for campaign in campaigns:
        lists = dict(script.stated(campaign.name))
        references = campaign.model_dump(mode="json")["references"]
        lists["references"] = [*references, *lists.get("references", ())]
        for key, entries in lists.items():
            counts_as = {"references": "number", "statements": "statement"}.get(key, "order")
            stated_entries += [
                (entry["id"] or f"{campaign.name} {key} {k}", counts_as, entry) for k, entry in enumerate(entries, 1)
            ]
    return stated_entries + [
        (str(entry["id"]), "statement", entry) for entry in script.stated("").get("statements", ())
    ]


def _marked(rows: pd.DataFrame, stated: Sequence[tuple[str, str, Mapping[str, Any]]]) -> pd.DataFrame:
    """Return rows with their present items and marks; InputError if the study no longer has the entry of a row."""
    by_id: dict[str, list[tuple[str, Mapping[str, Any]]]] = {}
    for name, counts_as, entry in stated:
        by_id.setdefault(name, []).append((counts_as, entry))
    updated = []
    for row in rows.to_dict(orient="records"):
        candidates = [pair for pair in by_id.get(row["id"], []) if str(row["item"]).startswith(str(pair[1]["item"]))]
        if not candidates:
            of = row["id"] or row["item"]
            raise InputError(f"references.csv: the study has no statement any more for {of!r}; run the study")
        counts_as, entry = max(candidates, key=lambda pair: len(str(pair[1]["item"])))
        of_band = verdict_in_band(row, entry) if counts_as == "number" else {}
        updated.append({**row, "item": entry["item"], **of_band, **marks(entry, counts_as)})
    return pd.DataFrame(updated, columns=COLUMNS)


def _campaigns(text: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of the campaign table in a stored answer, recounted."""
    table = text.partition(_CAMPAIGNS)[2].strip().partition("\n\n")[0].split("\n")
    names, _, *lines = ([cell.strip() for cell in line.strip("|").split("|")] for line in table)
    recounted = []
    for line in lines:
        of = dict(zip(names, line, strict=True))
        counted_rows = rows[rows["case"].str.startswith(f"{of['campaign']}: ") & evidence(rows)]
        counts = {name: int(of[name]) for name in ("cases", "runs", "failed runs")}
        published = f"{int(held(counted_rows).sum())} of {len(counted_rows)}" if len(counted_rows) else "–"
        recounted.append({**of, **counts, "as published": published})
    return recounted
