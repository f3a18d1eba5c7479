"""Console output of campaigns: verdicts, table of linear covariance, ranking of designs."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import FAILED, VerbResult
from lvnav_trade.quantities.errors import InputError

_MOST = 10  # largest number of failed runs listed individually
_COMPONENTS = {"3d", "north", "east", "down", "x", "y", "z", "radial", "along", "cross", "roll", "pitch", "yaw"}
_COMPONENT_OF = re.compile(r"^\w+ component of the |^length of the three-axis ")
_ROWS = 20  # largest number of rows of a table; for more cases a summary is printed


def shown(as_json: bool) -> tuple[list[Any], Callable[..., None]]:
    """Return a list, and a function that appends results of linear covariance to it and prints them unless for JSON."""
    collected: list[Any] = []

    def show(answers: Sequence[Any], cases: Sequence[Any]) -> None:
        collected.extend(answers)
        if not as_json:
            _print_answers(answers, cases)

    return collected, show


def shared(done: Any) -> VerbResult:
    """Return the console output on a finished shard."""
    lines = [f"failed: {line}" for line in done.failures[:_MOST]]
    lines.append(f"{done.runs} runs of {done.cases} cases are stored in {done.folder}")
    lines.append(f"when all shards are there: lvnav-trade merge {done.folder.parent}")
    content = {"folder": str(done.folder), "runs": done.runs, "cases": done.cases, "failures": list(done.failures)}
    return VerbResult("\n".join(lines), content, FAILED if done.failures else 0)


def check_preferred(prefer: Sequence[str]) -> None:
    """Refuse unknown words of `run --prefer` before anything is computed."""
    from lvnav_trade.campaign.syntax.tree import hint
    from lvnav_trade.results.evaluation.resources import PREFERRED

    for name in prefer:
        if name not in PREFERRED:
            raise InputError(f"--prefer {name}: should be one of {', '.join(PREFERRED)}{hint(name, PREFERRED)}")


def with_ranking(answer: VerbResult, results: Any, prefer: Sequence[str]) -> VerbResult:
    """Return an answer extended by the cases in preferred order; cases that meet every requirement come first."""
    from lvnav_trade.results.evaluation.resources import ranked

    frame = results.pareto
    if frame.empty:
        return answer._replace(text=f"{answer.text}\n--prefer: no card states resources, or there is no requirement")
    order = ranked(frame, prefer)
    shown = order[
        [
            "case",
            "meets",
            "verdict",
            "error_ratio",
            "limiting_requirement",
            "cost",
            "mass_kg",
            "power_w",
            "volume_l",
            "front",
        ]
    ]
    shown = shown.assign(cost=shown.cost.map("{:g}".format))
    text = f"{answer.text}\n{table(list(shown.columns), list(shown.itertuples(index=False)))}"
    return answer._replace(
        text=text, content={**answer.content, "preferred": json.loads(order.to_json(orient="records"))}
    )


def answer_of(results: Any, answers: Sequence[Any], report: bool) -> VerbResult:
    """Return the console output of a finished campaign: verdicts, location of the results, exit code."""
    from lvnav_trade.campaign.reading.flights import KINDS, remark_lines
    from lvnav_trade.results.requirements.requirements import in_words

    verdicts, failures = results.requirements, results.failures
    remarks = {name: results.tables.manifest.get(name, []) for name in KINDS}
    page = results.folder / "report.html" if report else None
    lines = remark_lines(remarks) + [f"failed: {line}" for line in failures[:_MOST]]
    many = results.tables.manifest.get("space") or {}
    if len(verdicts) and not many:
        at = 1 if remarks["beyond_limits"] else 0
        whole = "requirements.csv, the report" if report else "requirements.csv, --json"
        lines.insert(at, _verdicts(_named_basis(in_words(verdicts)), whole))
    if len(failures) > _MOST:
        lines.append(f"failed: {len(failures) - _MOST} more; all of them: column failed of the table runs, or --json")
    if many:
        lines.append(_designs(results, many))
    counts = verdicts.verdict.value_counts(sort=False).items()
    summary = f"{', '.join(f'{verdict} {count}' for verdict, count in counts)}; " if len(verdicts) else ""
    lines.append(summary + (f"report: {page}" if page else f"results: {results.folder}"))
    content = {
        "folder": str(results.folder),
        "report": str(page) if page else None,
        "failures": failures,
        **remarks,
        "covariance": [{**answer._asdict(), "rows": [list(row) for row in answer.rows]} for answer in answers],
        "requirements": json.loads(verdicts.to_json(orient="records")),  # JSON has no NaN; pandas writes null
    }
    return VerbResult("\n".join(lines), content, results.exit_code)


def components_together(metrics: Sequence[Sequence[str]]) -> list[tuple[str, str, str]]:
    """Return metrics (name, unit, meaning) with the components of a quantity combined, as `position_error_*`.

    The components have the same unit, and their meanings differ in the name of the component only, which is listed.
    """
    groups: dict[tuple[str, ...], list[Sequence[str]]] = {}
    for name, unit, meaning in metrics:
        stem, _, last = name.rpartition("_")
        key = (f"{stem}_*", unit, _COMPONENT_OF.sub("", meaning)) if last in _COMPONENTS else (name, unit, meaning)
        groups.setdefault(key, []).append((name, unit, meaning))
    combined = []
    for (name, unit, meaning), members in groups.items():
        if len(members) == 1:
            combined.append((members[0][0], unit, members[0][2]))
        else:
            components = ", ".join(member[0].rpartition("_")[2] for member in members)
            combined.append((name, unit, f"{meaning}; *: {components}"))
    return combined


def _designs(results: Any, many: Mapping[str, Any]) -> str:
    """Return the summary of a design space: designs that meet all requirements, those with an overconfident filter, and
    the command that lists them.
    """
    from lvnav_trade.results.evaluation.design_space import counts_of, overconfident

    frame, has_requirements = results.cases, bool(results.tables.campaign.get("requirements"))
    good = frame[frame.verdict == "met"]
    impossible = sum((many.get("impossible") or {}).values())
    doubtful = overconfident(good)
    summary = f"{many['designs']} designs" + (f", {impossible} of them impossible" if impossible else "")
    if has_requirements:
        summary += f": {len(good)} meet all requirements by linear covariance"
        each = counts_of(results.tables, frame)
        summary += f" ({', '.join(f'{name} {count}' for name, count in each.items())})" if len(each) > 1 else ""
        summary += f", {doubtful} of these with an overconfident filter" if doubtful else ""
    order = "--sort velocity"
    if has_requirements:
        order = '--where "verdict == met" --sort error' if len(good) else "--sort error"
    lines = [summary, f"list them: lvnav-trade cases {results.folder} {order}"]
    if has_requirements:
        lines.append(f"verdicts of the {len(results.tables.labels)} that are analysed whole:")
    return "\n".join(lines)


def _named_basis(shown: Any) -> Any:
    """Return verdicts with the full name of their method."""
    return shown.assign(by=shown.by.replace("LinCov", "linear covariance"))


def _verdicts(shown: Any, whole: str) -> str:
    """Return the table of verdicts; of too many rows only the worst verdicts, and the location of the whole table."""
    from lvnav_trade.results.requirements.margins import ORDER

    more = len(shown) - _ROWS
    if more <= 0:
        return table(list(shown.columns), list(shown.itertuples(index=False)))
    rows = shown.sort_values("verdict", key=lambda words: words.map(ORDER.index), kind="stable")[:_ROWS]
    counts = [f"{name}: {', '.join(f'{word} {n}' for word, n in of.items())}" for name, of in _counted(shown)]
    text = table(list(rows.columns), list(rows.itertuples(index=False)))
    return "\n".join([text, f"{more} more rows, none worse: {whole}", *counts])


def _counted(shown: Any) -> Iterator[tuple[str, dict[str, int]]]:
    """Yield every requirement with the number of cases by verdict."""
    for name, rows in shown.groupby("requirement", sort=False):
        yield str(name), rows.verdict.value_counts(sort=False).to_dict()


def _print_answers(answers: Sequence[Any], cases: Sequence[Any]) -> None:
    rows = []
    for answer, case in zip(answers, cases, strict=True):
        cells = [f"{true:.3g} ({formal:.3g}) {unit}" for _, true, formal, unit in answer.rows]
        rows.append([case.label, answer.event, *(cells or [answer.error])])
    print("Linear covariance, RMS of the true error (in brackets the formal sigma), 3D:")
    head = ["case", "at", "position", "velocity", "attitude"]
    if len(rows) <= _ROWS:
        print(table(head, rows))
    else:
        ends = _ends(answers)
        print(table(["of", "is", *head], [[name, which, *rows[k]] for name, which, k in ends]))
        print(f"{len(rows)} cases, those with the smallest and the largest errors shown; all: the report, --json")
    sys.stdout.flush()


def _ends(answers: Sequence[Any]) -> Iterator[tuple[str, str, int]]:
    """Yield for each quantity the indices of the cases with its smallest and its largest error."""
    computed = [k for k, answer in enumerate(answers) if answer.rows]
    for place, (name, *_) in enumerate(answers[computed[0]].rows if computed else ()):
        by_size = sorted(computed, key=lambda k: answers[k].rows[place][1])
        yield name, "smallest", by_size[0]
        yield name, "largest", by_size[-1]
