"""A kept study counted anew: what its folder says of rows by now, and the answer of the page, without its results."""

from collections.abc import Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import pandas as pd

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.study import Study
from lvnav_trade.errors import InputError, writing
from lvnav_trade.input_files import read_text
from lvnav_trade.limits import DATA_BYTES
from lvnav_trade.metrics.held import evidence, held
from lvnav_trade.metrics.published import COLUMNS, MARKS, marks
from lvnav_trade.report.build import markdown_page, pictures
from lvnav_trade.report.escape import csv_text
from lvnav_trade.report.script import StudyScript
from lvnav_trade.report.study import answer

_ANSWER, _CAMPAIGNS = "## Answer\n", "The campaigns of this study.\n"
_TEXTS = ("id", "source", "item", "case", "metric", "unit", "verdict", "remark", *MARKS)


def recount(study: Study, campaigns: Sequence[Campaign], folder: Path | str, script: StudyScript) -> Path:
    """Write references.csv and the answer of a kept page anew, with items and marks as the study's folder has them now.

    Numbers, figures of campaigns and their sections stay. InputError where no such page is kept there.
    """
    place = Path(folder)
    rows = _marked(_kept(place), _stated(campaigns, script))
    text = read_text(place / "report.md", DATA_BYTES)
    if _ANSWER not in text or _CAMPAIGNS not in text:
        raise InputError(f"{place / 'report.md'}: is not the report of a study with an answer")
    before, _, rest = text.partition(_ANSWER)
    old, end, after = rest.partition("\n## ")
    section = answer(study, rows, script, _campaigns(old, rows))
    made = markdown_page("", "", [section])
    page = f"{before}{made[made.index(_ANSWER) :].rstrip()}\n{end}{after}"
    files = {"references.csv": csv_text(rows).encode(), "report.md": page.encode(), **pictures([section])}
    with writing(place, "the study cannot be kept there"):
        for name, content in files.items():
            (place / name).write_bytes(content)
    return place / "report.md"


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
        made.append({**row, "item": one["item"], **marks(one, kind)})
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
