"""Paired comparison of a candidate with a base: changes of errors and of compliance, each with its verdict."""

import difflib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities import units
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.state_layout import split_metric
from lvnav_trade.results.comparison import paired_changes
from lvnav_trade.results.comparison.matching import Pair, match, unmatched_case_notes
from lvnav_trade.results.evaluate import errors_at
from lvnav_trade.results.metric import event_or_phase
from lvnav_trade.results.requirements.improvements import lincov_verdicts
from lvnav_trade.results.requirements.requirements import errors_of
from lvnav_trade.results.statistics.case_results import RunErrors, parse_number
from lvnav_trade.results.statistics.select import at_time, final_event, flight_events, history_of, lincov_rms, pick
from lvnav_trade.results.tables.read import Tables, load

COLUMNS = [
    "case", "kind", "metric", "event", "statistic", "unit", "base", "candidate", "scale", "change", "low", "high",
    "effect", "verdict", "runs", "effective_runs", "remark",
]  # fmt: skip
CONFIDENCE = 0.95
# Default of the smallest change of interest
DEFAULT = "5 %"
DEFAULT_METRICS = ("velocity_error_3d", "position_error_3d", "attitude_error_3d")
FAILED_RUNS = "failed runs"
FAILED_EFFECT = "1 %"
# Statistic of a requirement without a given effect: fraction of runs beyond its limit, or the required quantile
BY_RUNS = "required"
FITTED = "quantile of a fitted distribution: too few runs lie beyond it"
_EFFECT = re.compile(r"^(?P<metric>[^@:=]+)(@(?P<at>[^@:=]+))?(:(?P<statistic>rms|q[0-9]{1,2}(\.[0-9]+)?))?$")


class Effect(NamedTuple):
    """Smallest change of interest of a metric."""

    metric: str  # name of a metric or of a requirement
    event: str  # event; empty for injection or the last event
    statistic: str  # rms, or q95 for a quantile
    amount: str  # as written: a percentage, a quantity with its unit, or none to exclude the metric


class ResultComparison(NamedTuple):
    """Comparison of two result sets."""

    frame: pd.DataFrame  # one row per case and metric, columns `COLUMNS`
    notes: tuple[str, ...]  # remarks on the whole comparison
    confidence: float
    base: Path  # folder of the base
    candidate: Path  # folder of the candidate

    @property
    def verdict(self) -> str:
        """Overall verdict: the worst verdict of all rows."""
        verdicts = set(self.frame.verdict)
        if "worse" in verdicts:
            return "worse"
        return "undecided" if "undecided" in verdicts else "not worse"


def parse_effect(key: str, amount: str) -> Effect:
    """Return the effect of a key ``METRIC[@EVENT][:STATISTIC]`` and an amount; InputError if one is not valid."""
    match = _EFFECT.match(key.strip())
    if match is None:
        raise InputError(f"effect {key!r}: write METRIC, METRIC@EVENT or METRIC@EVENT:q95")
    text = amount.strip()
    effect = Effect(
        metric=match["metric"].strip(),
        event=(match["at"] or "").strip(),
        statistic=match["statistic"] or "rms",
        amount=text,
    )
    if _is_relative(text):
        _amount(effect, "")
    elif text != "none" and not re.match(r"^[-+]?[0-9.]", text):
        raise InputError(f"effect {key!r}: {amount!r} is neither a percentage, nor a quantity with a unit, nor none")
    return effect


def parse_effects(assignments: Sequence[str]) -> list[Effect]:
    """Return the effects of assignments such as ``velocity_error_3d=5%``."""
    effects = []
    for text in assignments:
        key, equals, amount = text.rpartition("=")
        if not equals:
            raise InputError(f"--effect {text}: write METRIC=AMOUNT, such as velocity_error_3d=5%")
        effects.append(parse_effect(key, amount))
    return effects


def compare(
    base: Path | str | Tables,
    candidate: Path | str | Tables,
    effects: Sequence[Effect] = (),
    confidence: float | None = None,
    mapping: Mapping[str, str] | None = None,
) -> ResultComparison:
    """Compare a candidate with a base, case by case and run by run (paired).

    Verdicts: "worse" if the change is shown to be above the smallest change of interest, "not worse" if it is shown to
    be below, otherwise "undecided". Without runs on both sides linear covariance is compared.

    Parameters
    ----------
    base, candidate : Path, str or Tables
        The two result sets.
    effects : sequence of Effect
        Smallest changes of interest. They override those of the base's campaign (``compare: {effects: ...}``), which
        override the defaults.
    confidence : float, optional
        Confidence of the verdicts; by default that of the base's campaign, or else 0.95.
    mapping : mapping of str to str, optional
        See `matching.match`.

    Raises
    ------
    InputError
        The result sets are not comparable, or an effect names an unknown metric or event.

    Notes
    -----
    `low`, which shows "worse", has the error probability 1 - confidence for all rows together (Bonferroni). `high`,
    which shows "not worse", has it for each row, since every row must be not worse (intersection-union test).
    """
    first, second = load(base), load(candidate)
    pairs = match(first, second, mapping)
    settings = first.campaign.get("compare") or {}
    level = float(confidence if confidence is not None else settings.get("confidence", CONFIDENCE))
    if not 0.5 <= level < 1.0:
        raise InputError(f"--confidence {level:g}: give a number from 0.5 to below 1")
    campaign_effects = [parse_effect(key, str(amount)) for key, amount in (settings.get("effects") or {}).items()]
    merged_effects = _merge_effects(first, [*campaign_effects, *effects])
    tasks: list[_Task] = []
    for pair in pairs:
        tasks += _tasks(first, second, pair, merged_effects)
    alpha = 1.0 - level
    rows = [task.row(first, second, alpha / len(tasks), alpha) for task in tasks]
    return ResultComparison(
        frame=pd.DataFrame(rows, columns=COLUMNS),
        notes=_notes(first, second, pairs),
        confidence=level,
        base=first.folder,
        candidate=second.folder,
    )


def _merge_effects(base: Tables, user_effects: Sequence[Effect]) -> list[Effect]:
    """Return the effects to compare: defaults, then requirements, then the user's; the amount "none" removes one."""
    allowed_failures = {str(item["name"]): 1.0 - float(item["probability"]) for item in _requirements(base)}
    defaults = [Effect(metric, "", "rms", DEFAULT) for metric in DEFAULT_METRICS]
    effect_by_key: dict[tuple[str, str, str], Effect] = {}
    for effect in [*defaults, *user_effects]:
        is_requirement = effect.metric in allowed_failures and effect.statistic == "rms"
        if is_requirement or effect.metric == FAILED_RUNS:
            effect = effect._replace(statistic="beyond")
        effect_by_key[effect.metric, effect.event, effect.statistic] = effect
    metrics = {metric for metric, _, _ in effect_by_key}
    for name, fraction in allowed_failures.items():
        if name not in metrics:
            effect_by_key[name, "", BY_RUNS] = Effect(name, "", BY_RUNS, f"{100.0 * fraction:.12g} %")
    failed_runs = Effect(FAILED_RUNS, "", "beyond", FAILED_EFFECT)
    effect_by_key.setdefault((FAILED_RUNS, "", "beyond"), failed_runs)
    return [effect for effect in effect_by_key.values() if effect.amount != "none"]


def _requirements(tables: Tables) -> list[dict[str, Any]]:
    return list(tables.campaign.get("requirements") or ())


def _is_relative(amount: str) -> bool:
    return amount.endswith(("%", "percent"))


def _amount(effect: Effect, unit: str) -> float:
    """Return the amount of an effect as a fraction or in a unit; InputError if it is not valid or below zero."""
    text = effect.amount
    if _is_relative(text):
        text, unit = re.sub(r" ?(%|percent)$", r" \1", text), "dimensionless"  # 5% as well as 5 %
    try:
        value = units.parse(text, unit)
    except ValueError as error:
        raise InputError(f"effect on {effect.metric}: {error}") from None
    if value < 0.0:
        raise InputError(f"effect on {effect.metric}: {effect.amount!r} should not be below zero")
    return value


class _Task(NamedTuple):
    """Data of one row of the comparison."""

    task_type: str  # error, requirement or failures
    pair: Pair
    effect: Effect
    event: str
    first: RunErrors  # errors of the runs of the base
    second: RunErrors  # errors of the runs of the candidate
    bound: float = np.inf  # bound, if fractions of runs beyond it are compared

    @property
    def is_fraction(self) -> bool:
        """Whether fractions of runs beyond a bound are compared, and not errors."""
        return self.effect.statistic == "beyond"

    @property
    def is_relative(self) -> bool:
        """Whether the change is relative to the error of the base."""
        return not self.is_fraction and _is_relative(self.effect.amount)

    def row(self, base: Tables, candidate: Tables, alpha_low: float, alpha_high: float) -> dict[str, Any]:
        """Return the row of the comparison.

        alpha_low, alpha_high : error probabilities of the lower and upper bound on the change
        """
        n = min(len(self.first.magnitude), len(self.second.magnitude))
        if not n:
            return self._filled_row(self._expected_change(base, candidate), 0, "by linear covariance")
        first, second = self.first.magnitude[:n], self.second.magnitude[:n]
        is_finite = np.isfinite(first) & np.isfinite(second)
        is_fitted = False
        if self.is_fraction:
            change = paired_changes.exceedance_change(first >= self.bound, second >= self.bound, alpha_low, alpha_high)
        elif not is_finite.any():
            return self._filled_row(paired_changes.UNKNOWN_CHANGE, 0, "no run is good in both")
        elif self.effect.statistic == "rms":
            change = paired_changes.rms_change(
                first[is_finite], second[is_finite], self.is_relative, alpha_low, alpha_high
            )
        else:
            probability = float(self.effect.statistic[1:]) / 100.0
            is_fitted = not paired_changes.has_enough_runs(int(is_finite.sum()), probability)
            find_change = paired_changes.fitted_quantile_change if is_fitted else paired_changes.quantile_change
            change = find_change(
                first[is_finite], second[is_finite], probability, self.is_relative, alpha_low, alpha_high
            )
        if np.array_equal(first, second):
            zero_change = change._replace(change=0.0, low=0.0, high=0.0, effective_runs=float("inf"))
            return self._filled_row(zero_change, n, "the same in every run") | {"verdict": "not worse"}
        return self._filled_row(change, n, self._remark(change, is_fitted))

    def _expected_change(self, base: Tables, candidate: Tables) -> paired_changes.Change:
        """Return the change by linear covariance, which has no sampling error."""
        first = _expected_statistic(base, self.pair.base, self)
        second = _expected_statistic(candidate, self.pair.candidate, self)
        change = second / first - 1.0 if self.is_relative and first else second - first
        return paired_changes.Change(first, second, change, change, change, float("nan"))

    def _remark(self, change: paired_changes.Change, is_fitted: bool) -> str:
        if not np.isfinite(change.low + change.high):
            return "too few runs for a bound"
        remarks = []
        if is_fitted:
            remarks.append(FITTED)
        if change.high < 0.0:
            remarks.append("better")
        return "; ".join(remarks)

    def _filled_row(self, change: paired_changes.Change, runs: int, remark: str) -> dict[str, Any]:
        if self.is_fraction:
            size, unit, scale = 1.0, "", "fraction of runs"
        else:
            size, unit = self.first.label_factor, self.first.label_unit
            scale = "ratio" if self.is_relative else unit
        factor = 1.0 if self.is_relative else size
        amount = _amount(self.effect, self.first.unit)
        return {
            "case": self.pair.label,
            "kind": self.task_type,
            "metric": self.effect.metric,
            "event": self.event,
            "statistic": "fraction beyond" if self.is_fraction else self.effect.statistic,
            "unit": unit,
            "base": change.base * size,
            "candidate": change.candidate * size,
            "scale": scale,
            "change": change.change * factor,
            "low": change.low * factor,
            "high": change.high * factor,
            "effect": amount * factor,
            "verdict": paired_changes.verdict(change.low, change.high, amount),
            "runs": runs,
            "effective_runs": change.effective_runs,
            "remark": remark,
        }


def _tasks(base: Tables, candidate: Tables, pair: Pair, effects: Sequence[Effect]) -> list[_Task]:
    """Return the tasks of a pair of cases, without the errors that one of the two does not have."""
    requirements = {str(requirement["name"]): requirement for requirement in _requirements(base)}
    tasks = []
    for effect in effects:
        if effect.metric == FAILED_RUNS:
            task = _failure_task(base, candidate, pair, effect)
        elif effect.metric in requirements:
            task = _requirement_task(base, candidate, pair, effect, requirements[effect.metric])
        else:
            task = _error_task(base, candidate, pair, effect)
        if task is not None:
            tasks.append(task)
    return tasks


def _failure_task(base: Tables, candidate: Tables, pair: Pair, effect: Effect) -> _Task | None:
    first = _failures(base, pair.base)
    second = _failures(candidate, pair.candidate)
    if not (first.magnitude.any() or second.magnitude.any()):
        return None
    return _Task("failures", pair, effect, "", first, second, bound=0.5)


def _requirement_task(
    base: Tables, candidate: Tables, pair: Pair, effect: Effect, requirement: Mapping[str, Any]
) -> _Task | None:
    first = errors_of(base, pair.base, requirement)
    second = errors_of(candidate, pair.candidate, requirement)
    if first is None or second is None:
        return None
    runs = min(len(first.magnitude), len(second.magnitude))
    return _Task(
        task_type="requirement",
        pair=pair,
        effect=_required_effect(effect, float(requirement["probability"]), runs),
        event=event_or_phase(requirement),
        first=first,
        second=second,
        bound=parse_number(requirement["below"], first.unit),
    )


def _error_task(base: Tables, candidate: Tables, pair: Pair, effect: Effect) -> _Task | None:
    event = effect.event or final_event(base, pair.base)
    first = errors_at(base, pair.base, event, effect.metric)
    second = errors_at(candidate, pair.candidate, event, effect.metric)
    is_stored = event in set(flight_events(base, pair.base).event)
    if first is not None and second is not None and is_stored:
        return _Task("error", pair, effect, event, first, second)
    if effect.event or effect.metric not in DEFAULT_METRICS:
        raise InputError(_unknown_metric(base, pair, effect, event))
    return None


def _required_effect(effect: Effect, probability: float, runs: int) -> Effect:
    """Return the statistic of a requirement without a given effect.

    It is the fraction of runs beyond the limit. If there are so few runs that hardly any may be beyond, no change of
    this fraction can be shown to be small; then it is the quantile at the required probability.
    """
    if effect.statistic != BY_RUNS:
        return effect
    if runs and not paired_changes.has_enough_runs(runs, probability):
        return effect._replace(statistic=f"q{100.0 * probability:.12g}", amount=DEFAULT)
    return effect._replace(statistic="beyond")


def _unknown_metric(base: Tables, pair: Pair, effect: Effect, event: str) -> str:
    """Return the message on an effect whose metric or event does not exist."""
    if errors_at(base, pair.base, event, effect.metric) is not None:
        events = ", ".join(flight_events(base, pair.base).event)
        return f"effect on {effect.metric}: {event!r} is not an event of {pair.label} (it has {events})"
    metrics = [f"{row.quantity}_error_{row.axis}" for row in pick(base.outputs, case=pair.base).itertuples()]
    requirement_names = [requirement["name"] for requirement in _requirements(base)]
    near = difflib.get_close_matches(effect.metric, [*metrics, *requirement_names], 1)
    hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(metrics)}"
    return f"effect on {effect.metric!r}: no such metric or requirement in both cases of {pair.label} ({hint})"


def _failures(tables: Tables, case: str) -> RunErrors:
    """Return one for each failed run of a case, and zero for the others, (n_run,)."""
    rows = pick(tables.runs, case=case).drop_duplicates("run_number")
    return RunErrors((rows.failure != "").to_numpy(dtype=float), "", "", 1.0)


def _expected_statistic(tables: Tables, case: str, task: _Task) -> float:
    """Return the statistic of one side by linear covariance; NaN if it is not known."""
    if task.is_fraction:
        rows = pick(lincov_verdicts(tables), requirement=task.effect.metric, case=tables.labels[case])
        return 1.0 - float(rows.expected_probability.iloc[0]) if len(rows) else float("nan")
    quantity, axis = split_metric(task.effect.metric)
    history = history_of(tables, case, quantity, axis)
    if history.empty or task.effect.statistic != "rms":
        return float("nan")
    t = float(flight_events(tables, case).set_index("event").t_s[task.event])
    nearest = at_time(history.assign(rms=lincov_rms(history)), t)
    return float(nearest.rms)


def _notes(base: Tables, candidate: Tables, pairs: Sequence[Pair]) -> tuple[str, ...]:
    notes = unmatched_case_notes(base, candidate, pairs)
    first, second = (tables.manifest.get("code_digest") for tables in (base, candidate))
    if first != second:
        notes.append(f"Computed by two versions of the code ({first} and {second}).")
    if _requirements(base) != _requirements(candidate):
        notes.append("The two campaigns state different requirements; both are tested against the base's.")
    return tuple(notes)
