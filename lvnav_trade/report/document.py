"""Title block of the report, requirements with their sources, margin policy."""

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import pandas as pd

from lvnav_trade.report.blocks import Block, Text, formatted_table, words
from lvnav_trade.report.escape import note
from lvnav_trade.report.sentences import say
from lvnav_trade.report.validity import with_evidence, worst_time_text
from lvnav_trade.results.evaluate import statement_metric
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.metric import event_or_phase
from lvnav_trade.results.requirements.requirements import with_unit
from lvnav_trade.results.tables.read import Tables

CHANGED = "with changes"  # end of the commit in a manifest if files differed from it
_OPTIONAL = ("id", "parent", "source", "verification", "rationale")


class Line(NamedTuple):
    """A line of the title block."""

    name: str
    text: str
    warning: bool = False  # whether it is highlighted as a warning


Head = tuple[Line, ...]


def title_of(tables: Tables) -> str:
    """Return the title of the report: that of the document settings, or else the name of the campaign."""
    title = (tables.campaign.get("document") or {}).get("title")
    return str(title or tables.manifest.get("campaign") or tables.campaign.get("name"))


def head(tables: Tables) -> Head:
    """Return the title block: classification, issue, author, date, campaign, version and commit.

    Uncommitted changes give a warning, because such results cannot be reproduced from the repository.
    """
    card = tables.campaign.get("document") or {}
    manifest = tables.manifest
    date = str(manifest.get("finished") or manifest.get("created") or "")[:10]
    campaign = manifest.get("campaign") or tables.campaign.get("name")
    entries = {
        "classification": card.get("classification"),
        "issue": card.get("issue"),
        "author": card.get("author"),
        "date": date,
        "campaign": campaign if card.get("title") else None,  # else it is the title
        "lvnav-trade": manifest.get("tool"),
    }
    lines = [Line(name, str(text)) for name, text in entries.items() if text]
    commit = str(manifest.get("commit") or "")
    if commit.endswith(CHANGED):
        text = f"{commit}: the results cannot be computed again from a commit"
        lines.append(Line("commit", text, warning=True))
    elif commit:
        lines.append(Line("commit", commit))
    return tuple(lines)


def stated_requirements(tables: Tables) -> list[Block]:
    """Return the table of the requirements with identifiers, sources and interpretation, and their convention."""
    rows = []
    limits = _limits(tables)
    for requirement in tables.campaign.get("requirements") or ():
        limit = limits.get(requirement["name"]) or requirement["below"]
        sides = statement_metric(requirement).bound_type
        population = "mixed" if requirement.get("during") else "ensemble"  # to which the probability refers
        row: dict[str, Any] = {field: str(requirement.get(field) or "") for field in _OPTIONAL}
        row |= {
            "requirement": requirement["name"],
            "bound": f"{words(requirement['metric'])} below {limit}",
            "place": place_text(requirement),
            "probability": float(requirement["probability"]),
            "confidence": float(requirement.get("confidence", 0.9)),
            "interpretation": f"{sides}, {population}",
        }
        rows.append(row)
    if not rows:
        return []
    frame = pd.DataFrame(rows)
    empty = [field for field in _OPTIONAL if not frame[field].any()]
    return [formatted_table("stated_requirements", frame.drop(columns=empty)), Text(note("convention"))]


def _limits(tables: Tables) -> dict[str, str]:
    """Return the known limits of requirements by name, as text in the unit of the verdicts."""
    limits = METRICS["requirements"](tables).dropna(subset=["limit"]).drop_duplicates("requirement")
    return {row.requirement: with_unit(row.limit, row.unit) for row in limits.itertuples()}


def place_text(requirement: Mapping[str, Any]) -> str:
    """Return the event or phase of a requirement in words: "at injection", "during coast"."""
    return f"{'during' if requirement.get('during') else 'at'} {words(event_or_phase(requirement))}"


def margin_policy(tables: Tables, margins: pd.DataFrame) -> list[Block]:
    """Return the paragraph on the margin policy; empty without a policy.

    It names the designs with the margin required in the present project phase, and those among them that lose it within
    the window around an event.
    """
    policy = tables.campaign.get("margin_policy")
    if not policy or margins.empty:
        return []
    required_margin = _fraction(policy["required"][policy["phase"]])
    smallest_margins = margins.groupby("case", sort=False).margin_ratio.agg(lambda sizes: sizes.min(skipna=False))
    is_sufficient = smallest_margins >= required_margin
    designs = []
    for case, margin in smallest_margins[~is_sufficient].items():
        text = "no margin" if pd.isna(margin) else f"{100.0 * margin:+.0f} %"
        designs.append(f"{case} ({text})")
    sufficient = set(smallest_margins.index[is_sufficient])
    places = dict.fromkeys(place_text(requirement) for requirement in tables.campaign.get("requirements") or ())
    text = say(
        "margin_policy",
        phase=policy["phase"],
        required=required_margin,
        kept=len(sufficient),
        whole=len(smallest_margins),
        places=" and ".join(places),
        short=designs,
        around=_window_margins(tables, required_margin, sufficient),
    )
    return [Text(text, "Margin policy.")]


def _window_margins(tables: Tables, required_margin: float, sufficient: Collection[str]) -> str:
    """Return the sentence on the cases with less than the required margin in a window around an event.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    required_margin : float
        Required margin, as a fraction of the limit.
    sufficient : collection of str
        Labels of the cases with the required margin at the events.

    Returns
    -------
    str
        Empty if no case lacks the margin.
    """
    frame = METRICS["windows"](tables)
    frame = frame[frame.case.isin(sufficient)]
    frame = frame.assign(margin=1.0 - frame.worst / frame.limit)
    smallest_margins = frame.loc[frame.groupby("case", sort=False).margin.idxmin()]
    insufficient_margins = smallest_margins[smallest_margins.margin < required_margin]
    if insufficient_margins.empty:
        return ""
    texts = []
    for row in insufficient_margins.itertuples():
        moment = worst_time_text(row, words(row.event))
        margin = f"{100.0 * row.margin:+.0f} %"
        texts.append(f"{row.case} ({margin} in {row.requirement}, {moment})")
    cases, source = with_evidence(texts, insufficient_margins.by)
    events = " and ".join(dict.fromkeys(words(insufficient_margins.event)))
    return say(
        "margin_around",
        kept=len(sufficient),
        short=len(insufficient_margins),
        events=events,
        evidence=source,
        cases=cases,
    )


def _fraction(value: float | str) -> float:
    return float(str(value).partition(" ")[0])
