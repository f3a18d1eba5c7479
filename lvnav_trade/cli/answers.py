"""Console output of campaigns: verdicts, table of linear covariance, ranking of designs."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from lvnav_trade.campaign.text import frame_table, table
from lvnav_trade.cli.console import FAILED, VerbResult
from lvnav_trade.quantities.errors import InputError

_MOST = 10  # largest number of failed runs listed individually
_COMPONENTS = {"3d", "north", "east", "down", "x", "y", "z", "radial", "along", "cross", "roll", "pitch", "yaw"}
_COMPONENT_OF = re.compile(r"^\w+ component of the |^length of the three-axis ")
_ROWS = 20  # largest number of rows of a table; for more cases a summary is printed


def covariance_collector(as_json: bool) -> tuple[list[Any], Callable[..., None]]:
    """Return a list, and a function that appends results of linear covariance to it and prints them unless for JSON."""
    collected_answers: list[Any] = []

    def show(answers: Sequence[Any], cases: Sequence[Any]) -> None:
        collected_answers.extend(answers)
        if not as_json:
            _print_covariance(answers, cases)

    return collected_answers, show


def shard_result(outcome: Any) -> VerbResult:
    """Return the console output on a finished shard."""
    lines = [f"failed: {line}" for line in outcome.failures[:_MOST]]
    lines.append(f"{outcome.runs} runs of {outcome.cases} cases are stored in {outcome.folder}")
    lines.append(f"when all shards are there: lvnav-trade merge {outcome.folder.parent}")
    content = {
        "folder": str(outcome.folder),
        "runs": outcome.runs,
        "cases": outcome.cases,
        "failures": list(outcome.failures),
    }
    return VerbResult("\n".join(lines), content, FAILED if outcome.failures else 0)


def check_preferred(prefer: Sequence[str]) -> None:
    """Refuse unknown words of `run --prefer` before anything is computed."""
    from lvnav_trade.campaign.syntax.tree import hint
    from lvnav_trade.results.evaluation.resources import PREFERRED

    for name in prefer:
        if name not in PREFERRED:
            raise InputError(f"--prefer {name}: should be one of {', '.join(PREFERRED)}{hint(name, PREFERRED)}")


def with_ranking(answer: VerbResult, results: Any, prefer: Sequence[str]) -> VerbResult:
    """Return an answer extended by the cases in preferred order; cases that meet every requirement come first.

    Parameters
    ----------
    answer : VerbResult
        Console output of the campaign.
    results : api.Results
        Results of the campaign.
    prefer : sequence of str
        Criteria in the order of preference: cost, mass, power, volume or error.
    """
    from lvnav_trade.results.evaluation.resources import sort_by_preference

    frame = results.pareto
    if frame.empty:
        return answer._replace(text=f"{answer.text}\n--prefer: no card states resources, or there is no requirement")
    ranking = sort_by_preference(frame, prefer)
    columns = [
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
    printed_columns = ranking[columns].assign(cost=ranking.cost.map("{:g}".format))
    content = {**answer.content, "preferred": json.loads(ranking.to_json(orient="records"))}
    return answer._replace(text=f"{answer.text}\n{frame_table(printed_columns)}", content=content)


def answer_of(results: Any, answers: Sequence[Any], report: bool) -> VerbResult:
    """Return the console output of a finished campaign: verdicts, location of the results, exit code.

    Parameters
    ----------
    results : api.Results
        Results of the campaign.
    answers : sequence
        Results of linear covariance, one per case.
    report : bool
        Whether the report has been built.
    """
    from lvnav_trade.campaign.reading.flights import KINDS

    verdicts, failures = results.requirements, results.failures  # each access computes the table again
    remarks = {name: results.tables.manifest.get(name, []) for name in KINDS}
    page = results.folder / "report.html" if report else None
    covariance = [
        {
            "case": answer.case,
            "event": answer.event,
            "rows": [list(row) for row in answer.rows],
            "error": answer.error,
        }
        for answer in answers
    ]
    content = {
        "folder": str(results.folder),
        "report": str(page) if page else None,
        "failures": failures,
        **remarks,
        "covariance": covariance,
        "requirements": json.loads(verdicts.to_json(orient="records")),  # pandas writes NaN as null
    }
    lines = _campaign_lines(results, verdicts, failures, remarks, report)
    summary = ""
    if len(verdicts):
        counts = verdicts.verdict.value_counts(sort=False)
        summary = ", ".join(f"{verdict} {count}" for verdict, count in counts.items()) + "; "
    location = f"report: {page}" if page else f"results: {results.folder}"
    return VerbResult("\n".join([*lines, summary + location]), content, results.exit_code)


def _campaign_lines(
    results: Any, verdicts: Any, failures: Sequence[str], remarks: Mapping[str, Sequence[str]], report: bool
) -> list[str]:
    """Return the lines on a finished campaign: remarks, verdicts, failed runs, summary of a design space.

    The verdicts are first, or second after a remark on settings beyond validated limits.

    Parameters
    ----------
    results : api.Results
        Results of the campaign.
    verdicts : pandas.DataFrame
        Verdict on every requirement in every case.
    failures : sequence of str
        Failed runs, a line each.
    remarks : mapping of str to sequence of str
        Remarks on the campaign, by kind.
    report : bool
        Whether the report has been built.
    """
    from lvnav_trade.campaign.reading.flights import remark_lines
    from lvnav_trade.results.requirements.requirements import verdict_texts

    lines = remark_lines(remarks) + [f"failed: {line}" for line in failures[:_MOST]]
    space = results.tables.manifest.get("space") or {}
    if len(verdicts) and not space:
        location = "requirements.csv, the report" if report else "requirements.csv, --json"
        verdict_table = verdict_texts(verdicts)
        verdict_table = verdict_table.assign(by=verdict_table.by.replace("LinCov", "linear covariance"))
        lines.insert(1 if remarks["beyond_limits"] else 0, _verdicts(verdict_table, location))
    if len(failures) > _MOST:
        lines.append(f"failed: {len(failures) - _MOST} more; all of them: column failure of the table runs, or --json")
    if space:
        lines.append(_designs(results, space))
    return lines


def combine_components(metrics: Sequence[Sequence[str]]) -> list[tuple[str, str, str]]:
    """Return metrics (name, unit, meaning) with the components of a quantity combined, as `position_error_*`.

    The components have the same unit, and their meanings differ in the name of the component only, which is listed.
    """
    groups: dict[tuple[str, ...], list[Sequence[str]]] = {}
    for name, unit, meaning in metrics:
        stem, _, component = name.rpartition("_")
        key = (name, unit, meaning)
        if component in _COMPONENTS:
            key = (f"{stem}_*", unit, _COMPONENT_OF.sub("", meaning))
        groups.setdefault(key, []).append((name, unit, meaning))
    metric_rows = []
    for (pattern, unit, common_meaning), members in groups.items():
        if len(members) == 1:
            name, _, meaning = members[0]
            metric_rows.append((name, unit, meaning))
        else:
            components = ", ".join(name.rpartition("_")[2] for name, _, _ in members)
            metric_rows.append((pattern, unit, f"{common_meaning}; *: {components}"))
    return metric_rows


def _designs(results: Any, space: Mapping[str, Any]) -> str:
    """Return the summary of a design space: designs that meet all requirements, those with an overconfident filter, and
    the command that lists them.
    """
    from lvnav_trade.results.evaluation.design_space import met_counts, overconfident

    frame = results.cases
    summary = f"{space['designs']} designs"
    n_impossible = sum((space.get("impossible") or {}).values())
    if n_impossible:
        summary += f", {n_impossible} of them impossible"
    if not results.tables.campaign.get("requirements"):
        return f"{summary}\nlist them: lvnav-trade cases {results.folder} --sort velocity"
    compliant = frame[frame.verdict == "met"]
    summary += f": {len(compliant)} meet all requirements by linear covariance"
    counts = met_counts(results.tables, frame)
    if len(counts) > 1:
        counts_text = ", ".join(f"{name} {count}" for name, count in counts.items())
        summary += f" ({counts_text})"
    n_overconfident = overconfident(compliant)
    if n_overconfident:
        summary += f", {n_overconfident} of these with an overconfident filter"
    options = '--where "verdict == met" --sort error' if len(compliant) else "--sort error"
    lines = [
        summary,
        f"list them: lvnav-trade cases {results.folder} {options}",
        f"verdicts of the {len(results.tables.labels)} that are analysed whole:",
    ]
    return "\n".join(lines)


def _verdicts(verdicts: Any, location: str) -> str:
    """Return the table of verdicts; of too many rows only the worst verdicts, and the location of the whole table."""
    from lvnav_trade.results.requirements.margins import ORDER

    n_omitted = len(verdicts) - _ROWS
    if n_omitted <= 0:
        return frame_table(verdicts)
    worst_first = verdicts.sort_values("verdict", key=lambda words: words.map(ORDER.index), kind="stable")
    lines = [frame_table(worst_first[:_ROWS]), f"{n_omitted} more rows, none worse: {location}"]
    for name, rows in verdicts.groupby("requirement", sort=False):
        counts = rows.verdict.value_counts(sort=False)
        counts_text = ", ".join(f"{verdict} {count}" for verdict, count in counts.items())
        lines.append(f"{name}: {counts_text}")
    return "\n".join(lines)


def _print_covariance(answers: Sequence[Any], cases: Sequence[Any]) -> None:
    """Print the table of linear covariance; for many cases only those with the smallest and largest errors."""
    rows = []
    for answer, case in zip(answers, cases, strict=True):
        cells = [f"{true_sigma:.3g} ({formal_sigma:.3g}) {unit}" for _, true_sigma, formal_sigma, unit in answer.rows]
        rows.append([case.label, answer.event, *(cells or [answer.error])])
    print("Linear covariance, RMS of the true error (in brackets the formal sigma), 3D:")
    header = ["case", "at", "position", "velocity", "attitude"]
    if len(rows) <= _ROWS:
        print(table(header, rows))
    else:
        extreme_rows = [[name, extreme, *rows[k]] for name, extreme, k in _extreme_cases(answers)]
        print(table(["of", "is", *header], extreme_rows))
        print(f"{len(rows)} cases, those with the smallest and the largest errors shown; all: the report, --json")
    sys.stdout.flush()


def _extreme_cases(answers: Sequence[Any]) -> Iterator[tuple[str, str, int]]:
    """Yield for each quantity the indices of the cases with its smallest and its largest error."""
    case_indices = [k for k, answer in enumerate(answers) if answer.rows]
    if not case_indices:
        return
    for column, (name, *_) in enumerate(answers[case_indices[0]].rows):
        errors = {k: answers[k].rows[column][1] for k in case_indices}
        by_error = sorted(case_indices, key=errors.__getitem__)
        yield name, "smallest", by_error[0]
        yield name, "largest", by_error[-1]
