"""Console output of campaigns: verdicts, linear covariance's table, ranking of designs."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import FAILED, Answer
from lvnav_trade.errors import InputError

_MOST = 10  # failed runs that are listed one by one
_COMPONENTS = {"3d", "north", "east", "down", "x", "y", "z", "radial", "along", "cross", "roll", "pitch", "yaw"}
_COMPONENT_OF = re.compile(r"^\w+ component of the |^length of the three-axis ")
_ROWS = 20  # rows of a table; of more cases there is a summary


def shown(as_json: bool) -> tuple[list[Any], Callable[..., None]]:
    """Return a list, and what puts linear covariance's answers into it and prints them unless JSON is wanted."""
    found: list[Any] = []

    def show(answers: Sequence[Any], cases: Sequence[Any]) -> None:
        found.extend(answers)
        if not as_json:
            _print_answers(answers, cases)

    return found, show


def shared(done: Any) -> Answer:
    """Say what a shard has left."""
    lines = [f"failed: {line}" for line in done.failures[:_MOST]]
    lines.append(f"{done.runs} runs of {done.cases} cases are stored in {done.folder}")
    lines.append(f"when all shards are there: lvnav-trade merge {done.folder.parent}")
    content = {"folder": str(done.folder), "runs": done.runs, "cases": done.cases, "failures": list(done.failures)}
    return Answer("\n".join(lines), content, FAILED if done.failures else 0)


def check_preferred(prefer: Sequence[str]) -> None:
    """Refuse what `run --prefer` does not know before anything is computed."""
    from lvnav_trade.campaign.syntax.tree import hint
    from lvnav_trade.metrics.resources import PREFERRED

    for name in prefer:
        if name not in PREFERRED:
            raise InputError(f"--prefer {name}: should be one of {', '.join(PREFERRED)}{hint(name, PREFERRED)}")


def with_ranking(answer: Answer, results: Any, prefer: Sequence[str]) -> Answer:
    """Return an answer with the cases in the order that is preferred, those first that meet every requirement."""
    from lvnav_trade.metrics.resources import ranked

    frame = results.pareto
    if frame.empty:
        return answer._replace(text=f"{answer.text}\n--prefer: no card states resources, or there is no requirement")
    order = ranked(frame, prefer)
    shown = order[
        ["case", "meets", "verdict", "error_ratio", "binding", "cost", "mass_kg", "power_w", "volume_l", "front"]
    ]
    shown = shown.assign(cost=shown.cost.map("{:g}".format))
    text = f"{answer.text}\n{table(list(shown.columns), list(shown.itertuples(index=False)))}"
    return answer._replace(
        text=text, content={**answer.content, "preferred": json.loads(order.to_json(orient="records"))}
    )


def answer_of(results: Any, answers: Sequence[Any], report: bool) -> Answer:
    """Return verdicts and where the results are, with the exit code that they mean."""
    from lvnav_trade.campaign.reading.flights import KINDS, remark_lines
    from lvnav_trade.metrics.requirements.requirements import in_words

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
    said = f"{', '.join(f'{verdict} {count}' for verdict, count in counts)}; " if len(verdicts) else ""
    lines.append(said + (f"report: {page}" if page else f"results: {results.folder}"))
    content = {
        "folder": str(results.folder),
        "report": str(page) if page else None,
        "failures": failures,
        **remarks,
        "covariance": [{**answer._asdict(), "rows": [list(row) for row in answer.rows]} for answer in answers],
        "requirements": json.loads(verdicts.to_json(orient="records")),  # what is not a number is null
    }
    return Answer("\n".join(lines), content, results.exit_code)


def components_together(metrics: Sequence[Sequence[str]]) -> list[tuple[str, str, str]]:
    """Return metrics (name, unit, meaning) with the components of one quantity as one: `position_error_*`.

    Components have one unit, and meanings that differ in the component's name alone; the line lists them.
    """
    groups: dict[tuple[str, ...], list[Sequence[str]]] = {}
    for name, unit, meaning in metrics:
        stem, _, last = name.rpartition("_")
        key = (f"{stem}_*", unit, _COMPONENT_OF.sub("", meaning)) if last in _COMPONENTS else (name, unit, meaning)
        groups.setdefault(key, []).append((name, unit, meaning))
    found = []
    for (name, unit, meaning), members in groups.items():
        if len(members) == 1:
            found.append((members[0][0], unit, members[0][2]))
        else:
            found.append((name, unit, f"{meaning}; *: {', '.join(one[0].rpartition('_')[2] for one in members)}"))
    return found


def _designs(results: Any, many: Mapping[str, Any]) -> str:
    """Say how many of many designs meet all requirements, of how many of these the filter cannot be trusted, and how to
    look at them.
    """
    from lvnav_trade.metrics.space import counts_of, overconfident

    frame, asked = results.cases, bool(results.tables.campaign.get("requirements"))
    good = frame[frame.verdict == "met"]
    impossible = sum((many.get("impossible") or {}).values())
    doubtful = overconfident(good)
    said = f"{many['designs']} designs" + (f", {impossible} of them impossible" if impossible else "")
    if asked:
        said += f": {len(good)} meet all requirements by linear covariance"
        each = counts_of(results.tables, frame)
        said += f" ({', '.join(f'{name} {count}' for name, count in each.items())})" if len(each) > 1 else ""
        said += f", {doubtful} of these with an overconfident filter" if doubtful else ""
    order = "--sort velocity"
    if asked:
        order = '--where "verdict == met" --sort error' if len(good) else "--sort error"
    lines = [said, f"list them: lvnav-trade cases {results.folder} {order}"]
    if asked:
        lines.append(f"verdicts of the {len(results.tables.labels)} that are analysed whole:")
    return "\n".join(lines)


def _named_basis(shown: Any) -> Any:
    """Return verdicts that say in words what they rest on."""
    return shown.assign(by=shown.by.replace("LinCov", "linear covariance"))


def _verdicts(shown: Any, whole: str) -> str:
    """Return the table of verdicts; of more rows than fit, the worst verdicts first, and where the whole table is."""
    from lvnav_trade.metrics.requirements.margins import ORDER

    more = len(shown) - _ROWS
    if more <= 0:
        return table(list(shown.columns), list(shown.itertuples(index=False)))
    rows = shown.sort_values("verdict", key=lambda words: words.map(ORDER.index), kind="stable")[:_ROWS]
    counts = [f"{name}: {', '.join(f'{word} {n}' for word, n in of.items())}" for name, of in _counted(shown)]
    text = table(list(rows.columns), list(rows.itertuples(index=False)))
    return "\n".join([text, f"{more} more rows, none worse: {whole}", *counts])


def _counted(shown: Any) -> Iterator[tuple[str, dict[str, int]]]:
    """Yield every requirement with how many cases have which verdict."""
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
    """Yield for each quantity the numbers of the cases with its smallest and its largest error."""
    known = [k for k, answer in enumerate(answers) if answer.rows]
    for place, (name, *_) in enumerate(answers[known[0]].rows if known else ()):
        by_size = sorted(known, key=lambda k: answers[k].rows[place][1])
        yield name, "smallest", by_size[0]
        yield name, "largest", by_size[-1]
