"""Document data of a review: title block, requirements with their sources, margin policy."""

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.evaluate import metric_in
from lvnav_trade.metrics.metric import where
from lvnav_trade.metrics.requirements.requirements import with_unit
from lvnav_trade.report.blocks import Block, Text, stated, words
from lvnav_trade.report.escape import note
from lvnav_trade.report.sentences import say
from lvnav_trade.report.validity import when, with_evidence
from lvnav_trade.store.read import Tables

CHANGED = "with changes"  # what the commit of a manifest ends with where files differed from it
_OPTIONAL = ("id", "parent", "source", "verification", "rationale")


class Line(NamedTuple):
    """A line of the head: what it says, and whether it is a warning."""

    name: str
    text: str
    warning: bool = False


Head = tuple[Line, ...]


def title_of(tables: Tables) -> str:
    """Return the title of the report: that of the document, else the name of the campaign."""
    named = (tables.campaign.get("document") or {}).get("title")
    return str(named or tables.manifest.get("campaign") or tables.campaign.get("name"))


def head(tables: Tables) -> Head:
    """Return the head of the document: marking, issue, author, date, campaign, version and commit.

    A commit with uncommitted changes is a warning: nobody can compute such results again from the repository.
    """
    card, manifest = tables.campaign.get("document") or {}, tables.manifest
    commit = str(manifest.get("commit") or "")
    lines = [(name, card.get(name)) for name in ("classification", "issue", "author")]
    date = str(manifest.get("finished") or manifest.get("created") or "")[:10]
    named = card.get("title") and (manifest.get("campaign") or tables.campaign.get("name"))
    lines += [("date", date), ("campaign", named), ("lvnav-trade", manifest.get("tool"))]
    found = [Line(name, str(text)) for name, text in lines if text]
    if commit.endswith(CHANGED):
        text = f"{commit}: the results cannot be computed again from a commit"
        return (*found, Line("commit", text, True))
    return (*found, *([Line("commit", commit)] if commit else []))


def stated_requirements(tables: Tables) -> list[Block]:
    """Return the requirements as stated, with identifiers, sources and interpretation, and the convention."""
    rows, limits = [], _limits(tables)
    for one in tables.campaign.get("requirements") or ():
        sides, over = metric_in(one).bounded_as, "mixed" if one.get("during") else "ensemble"
        limit = limits.get(one["name"]) or one["below"]
        rows.append(
            {
                **{field: str(one.get(field) or "") for field in _OPTIONAL},
                "requirement": one["name"],
                "bound": f"{words(one['metric'])} below {limit}",
                "place": place_of(one),
                "probability": float(one["probability"]),
                "confidence": float(one.get("confidence", 0.9)),
                "interpretation": f"{sides}, {over}",
            }
        )
    if not rows:
        return []
    frame = pd.DataFrame(rows)
    empty = [field for field in _OPTIONAL if not frame[field].any()]
    return [stated("stated_requirements", frame.drop(columns=empty)), Text(note("convention"))]


def _limits(tables: Tables) -> dict[str, str]:
    """Return the limit of every requirement by its name, in the unit of the verdicts, where it is known."""
    known = METRICS["requirements"](tables).dropna(subset=["limit"]).drop_duplicates("requirement")
    return {row.requirement: with_unit(row.limit, row.unit) for row in known.itertuples()}


def place_of(requirement: Mapping[str, Any]) -> str:
    """Return where in the flight a stated requirement applies: "at injection", "during coast"."""
    return f"{'during' if requirement.get('during') else 'at'} {words(where(requirement))}"


def margin_policy(tables: Tables, margins: pd.DataFrame) -> list[Block]:
    """Say which designs keep the margin that the present phase of the project requires, and which of these do not keep
    it within the window around an event; nothing without a policy.
    """
    policy = tables.campaign.get("margin_policy")
    if not policy or margins.empty:
        return []
    required = _fraction(policy["required"][policy["phase"]])
    least = margins.groupby("case", sort=False).margin_ratio.agg(lambda sizes: sizes.min(skipna=False))
    short = least[~(least >= required)]
    kept = len(least) - len(short)
    named = [
        f"{case} ({'no margin' if margin != margin else f'{100.0 * margin:+.0f} %'})" for case, margin in short.items()
    ]
    places = " and ".join(dict.fromkeys(place_of(one) for one in tables.campaign.get("requirements") or ()))
    text = say(
        "margin_policy",
        phase=policy["phase"],
        required=required,
        kept=kept,
        whole=len(least),
        places=places,
        short=named,
        around=_margins_around(tables, required, set(least.index) - set(short.index)),
    )
    return [Text(text, "Margin policy.")]


def _margins_around(tables: Tables, required: float, kept: Collection[str]) -> str:
    """Say which of some cases have less than the required margin within a window around an event."""
    frame = METRICS["windows"](tables)
    frame = frame[frame.case.isin(kept)]
    frame = frame.assign(margin=1.0 - frame.worst / frame.limit)
    least = frame.loc[frame.groupby("case", sort=False).margin.idxmin()]
    short = least[least.margin < required]
    if short.empty:
        return ""
    each = [
        f"{row.case} ({100.0 * row.margin:+.0f} % in {row.requirement}, {when(row, words(row.event))})"
        for row in short.itertuples()
    ]
    named, by = with_evidence(each, short.by)
    events = " and ".join(dict.fromkeys(words(short.event)))
    return say("margin_around", kept=len(kept), short=len(short), events=events, evidence=by, cases=named)


def _fraction(value: float | str) -> float:
    return float(str(value).partition(" ")[0])
