"""A kept study counted anew without its results, or with the results of some of its campaigns."""

import re
from collections.abc import Collection, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.study import Study
from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.quantities.input_files import read_text
from lvnav_trade.quantities.limits import DATA_BYTES
from lvnav_trade.report.blocks import Section
from lvnav_trade.report.build import markdown_page, pictures
from lvnav_trade.report.escape import csv_text
from lvnav_trade.report.script import Answered, StudyScript, published_rows
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
_EARLIER = "Monte Carlo against linear covariance"  # the appendix of earlier pages, with every case
_CAMPAIGNS = "The campaigns of this study.\n"
_TEXTS = ("id", "source", "item", "case", "metric", "unit", "verdict", "remark", *MARKS)


class _Page(NamedTuple):
    """A kept page: what stands before its sections, and their texts by heading."""

    head: str
    sections: dict[str, str]


def recount(study: Study, campaigns: Sequence[Campaign], folder: Path | str, script: StudyScript) -> Path:
    """Write references.csv and the answer of a kept page anew, with items and marks as the study's folder has them now.

    Numbers, figures of campaigns and their sections stay; cases in which both engines agree leave the appendix.
    InputError where no such page is kept there.
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
    study: Study, campaigns: Sequence[Campaign], folder: Path | str, script: StudyScript, answered: Sequence[Answered]
) -> Path:
    """Write what a kept study has of some campaigns anew from their results, and count the whole of it.

    campaigns : All of the study, in its order.
    answered : Those with results; rows, figures and sections of the others stay.

    InputError where no such page is kept there.
    """
    place, names = Path(folder), [one.name for one in campaigns]
    target, page, kept = owned(place, "study"), _page(place), _kept(place)
    answered = [one._replace(tables=in_units(one.tables, study.units)) for one in answered]
    new = {one.part.campaign: one for one in answered}
    made = [
        frame_of(published_rows(one.campaign.name, one.tables, one.campaign.model_dump(mode="json"), script))
        for one in answered
    ]
    others = kept[(kept["case"] != "") & ~_campaign_of(kept).isin(list(new))]
    others = _marked(others, _stated(campaigns, script))
    flown = {*new, *(line["campaign"] for line in _campaigns(page.sections[_ANSWER], others))}
    further = script.further_rows([one for one in campaigns if one.name not in flown])
    rows = pd.concat(
        [_in_order([others, together(answered, made)], names), *([frame_of(further)] if further else [])],
        ignore_index=True,
    )
    lines = {line["campaign"]: line for line in _campaigns(page.sections[_ANSWER], rows)}
    lines |= {name: line_of(one, rows) for name, one in new.items()}
    sections = [
        answer(study, rows, script, [lines[name] for name in names if name in lines]),
        *assumptions(study),
        *(campaign_section(one, mine, script) for one, mine in zip(answered, made, strict=True)),
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
        **{f"{name}.kml": flight_of(one, one.part.kml) for name, one in new.items() if one.part.kml is not None},
    }
    drawn = {name for name in target.listed("study") if any(name.startswith(f"figures/{one}-") for one in new)}
    with writing(place, "the study cannot be kept there"):
        target.claim("study", files)
        for name, content in files.items():
            (place / name).write_bytes(content)
        target.remove("study", drawn - set(files))
    return place / "report.md"


def _page(place: Path) -> _Page:
    """Return the kept page; InputError where there is none with an answer."""
    head, *parts = re.split(r"(?m)^## ", read_text(place / "report.md", DATA_BYTES))
    found = {title: body for title, _, body in (part.partition("\n") for part in parts)}
    if _CAMPAIGNS not in found.get(_ANSWER, ""):
        raise InputError(f"{place / 'report.md'}: is not the report of a study with an answer")
    return _Page(head, found)


def _written(page: _Page) -> bytes:
    parts = [f"## {title}\n{text.rstrip()}\n" for title, text in page.sections.items()]
    return (page.head + "\n".join(parts)).encode()


def _text(section: Section) -> str:
    """Return a section as it stands on a page, below its heading."""
    made = markdown_page("", "", [section])
    return made[made.index("\n## ") + 1 :].partition("\n")[2]


def _with_sections(page: _Page, sections: Sequence[Section], order: Sequence[str]) -> _Page:
    """Return a page with sections replaced, or put where they belong by the order of the campaigns' headings."""
    found = page.sections | {section.title: _text(section) for section in sections}
    first = [title for title in (_ANSWER, _ASSUMPTIONS) if title in found]
    middle = [title for title in order if title in found]
    last = [title for title in found if title not in {*first, *middle}]
    return page._replace(sections={title: found[title] for title in (*first, *middle, *last)})


def _to_appendix(sections: dict[str, str], new: Collection[str]) -> None:
    """Put the comparison of both engines last, without the cases in which they agree and those of some campaigns."""
    text = sections.pop(_EARLIER, None) or sections.pop(APPENDIX, None)
    if text is not None:
        kept = [line for line in text.split("\n") if " | agree | " not in line and _first(line) not in new]
        sections[APPENDIX] = "\n".join(kept)


def _first(line: str) -> str:
    """Return the first cell of a line of a table; empty for another line."""
    return line[1:].partition("|")[0].strip() if line.startswith("|") else ""


def _merge(sections: dict[str, str], made: str, title: str, new: Collection[str], names: Sequence[str]) -> None:
    """Put the lines of some campaigns into the table of a section, which is in the order of the names."""
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


def _agreed(place: Path, answered: Sequence[Answered], names: Sequence[str]) -> pd.DataFrame:
    """Return the rows of agreement.csv, those of some campaigns new."""
    texts = (read_text(place / "agreement.csv", DATA_BYTES), csv_text(agreed(answered)))
    before, after = (pd.read_csv(StringIO(text), dtype=str, keep_default_na=False) for text in texts)
    return _in_order([before[~_campaign_of(before).isin([one.part.campaign for one in answered])], after], names)


def _kept(place: Path) -> pd.DataFrame:
    """Return the rows of a kept references.csv; columns of texts are texts."""
    text = read_text(place / "references.csv", DATA_BYTES)
    rows = pd.read_csv(StringIO(text), dtype=dict.fromkeys(_TEXTS, str)).reindex(columns=COLUMNS)
    return rows.assign(**{name: rows[name].astype(object).where(rows[name].notna(), "") for name in _TEXTS})


def _stated(campaigns: Sequence[Campaign], script: StudyScript) -> list[tuple[str, str, Mapping[str, Any]]]:
    """Return what the folder states: id of the row, what it counts as if it counts, and the entry."""
    found: list[tuple[str, str, Mapping[str, Any]]] = []
    for campaign in campaigns:
        lists = dict(script.stated(campaign.name))
        own = campaign.model_dump(mode="json")["references"]
        lists["references"] = [*own, *lists.get("references", ())]
        for key, entries in lists.items():
            kind = {"references": "number", "statements": "statement"}.get(key, "order")
            found += [(one["id"] or f"{campaign.name} {key} {k}", kind, one) for k, one in enumerate(entries, 1)]
    return found + [(str(one["id"]), "statement", one) for one in script.stated("").get("statements", ())]


def _marked(rows: pd.DataFrame, stated: Sequence[tuple[str, str, Mapping[str, Any]]]) -> pd.DataFrame:
    """Return rows with the items and marks that are stated of them now; InputError where a row is stated no more."""
    by_id: dict[str, list[tuple[str, Mapping[str, Any]]]] = {}
    for name, kind, one in stated:
        by_id.setdefault(name, []).append((kind, one))
    made = []
    for row in rows.to_dict(orient="records"):
        known = [pair for pair in by_id.get(row["id"], []) if str(row["item"]).startswith(str(pair[1]["item"]))]
        if not known:
            of = row["id"] or row["item"]
            raise InputError(f"references.csv: the study has no statement any more for {of!r}; run the study")
        kind, one = max(known, key=lambda pair: len(str(pair[1]["item"])))
        of_band = verdict_in_band(row, one) if kind == "number" else {}
        made.append({**row, "item": one["item"], **of_band, **marks(one, kind)})
    return pd.DataFrame(made, columns=COLUMNS)


def _campaigns(text: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the lines of the table of campaigns of a kept answer, counted anew."""
    table = text.partition(_CAMPAIGNS)[2].strip().partition("\n\n")[0].split("\n")
    names, _, *lines = ([cell.strip() for cell in line.strip("|").split("|")] for line in table)
    found = []
    for line in lines:
        of = dict(zip(names, line, strict=True))
        mine = rows[rows["case"].str.startswith(f"{of['campaign']}: ") & evidence(rows)]
        counts = {name: int(of[name]) for name in ("cases", "runs", "failed runs")}
        published = f"{int(held(mine).sum())} of {len(mine)}" if len(mine) else "–"
        found.append({**of, **counts, "as published": published})
    return found
