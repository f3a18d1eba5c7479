"""Report section on filters that test for faults: rates, what is decided, what it is worth."""

import pandas as pd

from lvnav_trade.report.blocks import Block, Text, few, figures, number, of, stated
from lvnav_trade.report.escape import note
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.integrity import IN_PART, ISOLATED, WRONG
from lvnav_trade.results.tables.read import Tables

_SHARES = ("false alarm", "detected", ISOLATED, IN_PART, WRONG, "missed", "recovered")
_TIMES = ("detected", ISOLATED, "recovered")
_MOST = 4  # decisions of a case that the page shows


@of("integrity")
def rates(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the rates of each case, and the times to detect, to isolate and to recover."""
    rows = []
    for (case, fault), one in frame.groupby(["case", "fault"], sort=False):
        of_outcome = one.set_index("outcome")
        row = {"case": case, "fault": fault.replace("_", " "), "runs": int(one.run_count.iloc[0])}
        row |= {name: _share(of_outcome, name) for name in _SHARES}
        row |= {f"time, {name}": _time(of_outcome, name) for name in _TIMES}
        rows.append(row)
    found = pd.DataFrame(rows).rename(columns=lambda name: name.replace(" ", "_"))
    return [Text(note("integrity")), stated("integrity", found)]


def _share(rows: pd.DataFrame, outcome: str) -> str:
    """Write a share in percent with its interval; a dash where the case has no such outcome."""
    if outcome not in rows.index:
        return "–"
    one = rows.loc[outcome]
    return f"{100 * one.share_ratio:.3g} ({100 * one.low_ratio:.3g} to {100 * one.high_ratio:.3g})"


def _time(rows: pd.DataFrame, outcome: str) -> str:
    """Write the median time, and in brackets that of linear covariance."""
    if outcome not in rows.index:
        return "–"
    one = rows.loc[outcome]
    return f"{number(one.median_s)} ({number(one.lincov_s)})"


@of("tested_errors")
def worth(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return errors at the last event with the tests and without them, where the campaign has both."""
    return [stated("tested_errors", frame)]


@of("decisions")
def _decided(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    keys = ["case", "isolated", "satellites"]
    times = frame.loc[frame.index.repeat(frame.run_count)].groupby(keys, sort=False).t_s
    found = pd.DataFrame(
        {"times": times.size(), "first_s": times.min(), "median_s": times.median(), "last_s": times.max()}
    )
    found["lincov"] = frame.groupby(keys, sort=False).lincov.sum().reindex(found.index)
    found = found.reset_index().sort_values("times", ascending=False, kind="stable")
    shown = found.groupby("case", sort=False).head(_MOST)
    order = {case: place for place, case in enumerate(frame.case.unique())}
    return [stated("decisions", shown.sort_values("case", key=lambda case: case.map(order), kind="stable"))]


def integrity(tables: Tables) -> list[Block]:
    """Return what filters that test for faults found, in tables, and their decisions over time."""
    blocks = rates(tables)
    if not blocks:
        return []
    decided = METRICS["decisions"](tables).case
    group, more = few([case for case, label in tables.labels.items() if label in set(decided)])
    return [*blocks, *worth(tables), *_decided(tables), *figures(tables, "decisions", group), *more]
