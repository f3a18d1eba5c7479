"""Evaluation of one design: its requirements by linear covariance and by Monte Carlo runs."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError
from scipy import stats

from lvnav_trade.campaign.definition.axes import get, with_value
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.running import stopping, work
from lvnav_trade.campaign.running.case_arrays import CaseArrays
from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.covariance.diagnostics.case_diagnostics import flight_events
from lvnav_trade.covariance.history import covariance
from lvnav_trade.filter.assumed import ReceiverModel
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.records import CovHistory
from lvnav_trade.quantities.units import parse
from lvnav_trade.results.evaluation.covariances import NOT_APPLICABLE, why_outside
from lvnav_trade.results.requirements.improvements import evaluate_requirement
from lvnav_trade.results.statistics.probability import success_verdict
from lvnav_trade.scenario.filter_models import filter_models, has_receiver_solution, sensor_model, used_sensors
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare
from lvnav_trade.simulation.statistics import summarise

HISTORY = 60.0  # s between history times if only events matter, which are history times too
RETUNED, FROZEN = "re-tuned", "frozen"
ALPHA = 0.01  # significance level of a disagreement between runs and linear covariance


class CovarianceVerdict(NamedTuple):
    """A requirement evaluated by linear covariance."""

    estimate: float  # P-quantile of the error, P the required probability, in `unit`; NaN if not available
    limit: float  # limit of the requirement, in `unit`; NaN if not available
    probability: float  # probability that the error is below the limit; NaN if not available
    unit: str  # display unit
    missing_reason: str = ""  # reason why the numbers are not available
    validity_remark: str = ""  # reason why linear covariance does not describe the case; empty if it does

    @property
    def ratio(self) -> float:
        """Ratio of the estimate to the limit: at most 1 if the requirement is met."""
        return self.estimate / self.limit


def evaluate_requirements(
    campaign: Campaign, scenario: Scenario, names: Sequence[str] = ()
) -> dict[str, CovarianceVerdict]:
    """Evaluate requirements in a scenario by linear covariance.

    Parameters
    ----------
    campaign : Campaign
        Campaign with the requirements.
    scenario : Scenario
        The scenario.
    names : sequence of str
        Names of the requirements; all if empty.

    Returns
    -------
    dict of str to CovarianceVerdict
        Result by name of the requirement.
    """
    return covariance_verdicts(campaign, scenario, names)[0]


def covariance_verdicts(
    campaign: Campaign, scenario: Scenario, names: Sequence[str] = ()
) -> tuple[dict[str, CovarianceVerdict], CovHistory, int]:
    """Evaluate requirements in a scenario by linear covariance, as `evaluate_requirements`.

    Parameters
    ----------
    campaign : Campaign
        Campaign with the requirements.
    scenario : Scenario
        The scenario.
    names : sequence of str
        Names of the requirements; all if empty.

    Returns
    -------
    dict of str to CovarianceVerdict, CovHistory, int
        Verdicts by name; linear covariance; number of estimated states (degrees of freedom of the NEES).
    """
    requirements = [requirement for requirement in campaign.requirements if not names or requirement.name in names]
    has_phase = any(requirement.during for requirement in requirements)
    prepared_case = prepare(scenario, campaign.keep.history if has_phase else HISTORY)
    history = covariance(prepared_case)
    results = CaseArrays(prepared_case, history)
    validity_remark = _validity_remark(prepared_case, results)
    verdicts = {}
    for requirement in requirements:
        law = evaluate_requirement(results, requirement.model_dump(mode="json"))
        if isinstance(law, str):
            verdicts[requirement.name] = CovarianceVerdict(np.nan, np.nan, np.nan, unit="", missing_reason=law)
        else:
            verdicts[requirement.name] = CovarianceVerdict(
                estimate=law.quantile(law.probability) * law.factor,
                limit=law.bound * law.factor,
                probability=law.success_probability(),
                unit=law.unit,
                validity_remark=validity_remark,
            )
    return verdicts, history, int(prepared_case.layout.n_estimated)


def _validity_remark(prepared_case: PreparedCase, results: CaseArrays) -> str:
    """Return the reason why linear covariance does not describe a scenario at every epoch; empty if it does."""
    history = results.covariance
    return why_outside(
        prepared_case.options.rules is not None, results.largest_tilt(), history.t_epoch, history.false_rejection
    )


def combined_remark(reasons: Iterable[str]) -> str:
    """Return the remark on cases that linear covariance does not describe, each reason once; empty without reasons."""
    text = "; ".join(dict.fromkeys(reason for reason in reasons if reason))
    return f"{NOT_APPLICABLE}, confirm by runs: {text}" if text else ""


def with_values(scenario: Scenario, values: Mapping[str, Any]) -> Scenario:
    """Return a scenario with other values at dotted paths.

    Parameters
    ----------
    scenario : Scenario
        The scenario.
    values : mapping
        New values, written as in a campaign, by dotted path.

    Raises
    ------
    InputError
        A path does not exist, or the changed scenario is not valid.
    """
    data = scenario.model_dump(mode="json")
    settings_text = ", ".join(f"{path}={value}" for path, value in values.items())
    try:
        for path, value in values.items():
            steps = path.removeprefix("base.").split(".")
            data = with_value(data, steps, value)
        return Scenario.model_validate(data)
    except ValidationError as error:
        first_error = error.errors()[0]
        field = ".".join(map(str, first_error["loc"]))
        raise InputError(f"{settings_text}: {field}: {first_error['msg']}") from None
    except (ValueError, IndexError) as error:
        first_line = str(error).splitlines()[0]
        raise InputError(f"{settings_text}: {first_line}") from None


def number_at(scenario: Scenario, path: str, unit: str) -> float:
    """Return the number at a dotted path of a scenario, in a unit; NaN if the value is not a number.

    Parameters
    ----------
    scenario : Scenario
        The scenario.
    path : str
        Dotted path, with or without ``base.``.
    unit : str
        Unit of the number; empty for the unit of the stored value (SI).
    """
    steps = path.removeprefix("base.").split(".")
    value = get(scenario.model_dump(mode="json"), steps)
    if value is None or isinstance(value, bool | dict | list):
        return float("nan")
    number, _, si_unit = str(value).partition(" ")
    try:
        factor = parse(f"1 {unit}", si_unit or "dimensionless") if unit else 1.0
        return float(number) / factor
    except ValueError:
        return float("nan")


def frozen_filter(scenario: Scenario) -> FilterCard:
    """Return the filter of a scenario with all its models as numbers, so that `matched` models do not follow the truth.

    In a scenario with the same measurements and rates it has the gains of the given scenario. A receiver with a
    computed navigation solution still reports the covariance of each solution.
    """
    imu, receiver, initial = filter_models(scenario)
    update: dict[str, Any] = {"imu": imu, "initial": initial}
    if isinstance(scenario.filter.receiver, str) and not has_receiver_solution(scenario):
        numbers = {name: getattr(receiver, name) for name in ReceiverModel.model_fields}
        update["receiver"] = ReceiverModel.model_construct(**numbers)
    sensors = used_sensors(scenario).values()
    models = {card.measurement: sensor_model(scenario, card) for card in sensors}
    update["sensor_models"] = scenario.filter.sensor_models.model_copy(update=models)
    return scenario.filter.model_copy(update=update)


class MonteCarloVerdict(NamedTuple):
    """A requirement evaluated by Monte Carlo runs."""

    violation_count: int  # number of runs beyond the limit
    runs: int  # number of runs
    verdict: str  # verdict of these runs
    expected_share: float  # fraction of runs beyond the limit by linear covariance


def monte_carlo_verdicts(campaign: Campaign, scenario: Scenario, runs: int) -> dict[str, MonteCarloVerdict]:
    """Evaluate all requirements of a campaign in a scenario by Monte Carlo runs.

    Parameters
    ----------
    campaign : Campaign
        Campaign with the requirements and the seed.
    scenario : Scenario
        The scenario.
    runs : int
        Number of runs.

    Returns
    -------
    dict of str to MonteCarloVerdict
        Verdicts by name of the requirement, with the share of runs expected by linear covariance.
    """
    prepared_case = prepare(scenario, campaign.keep.history)
    history = covariance(prepared_case)
    requirements = [requirement.model_dump(mode="json") for requirement in campaign.requirements]
    block_size = campaign.monte_carlo.block if campaign.monte_carlo else 40
    events = flight_events(prepared_case)
    violations = np.zeros(len(requirements), dtype=int)
    for first in range(0, runs, block_size):
        n_run = min(block_size, runs - first)
        block = work.ENGINE.run_block(prepared_case, campaign.seed, first, n_run)
        summary = summarise(block, events, history.true_sigma, prepared_case.outputs)
        block_counts = stopping.violating_runs(requirements, "", prepared_case, history, summary)
        violations += [count or 0 for count in block_counts]
    by_covariance = evaluate_requirements(campaign, scenario)
    verdicts = {}
    for requirement, count in zip(campaign.requirements, violations, strict=True):
        verdicts[requirement.name] = MonteCarloVerdict(
            violation_count=int(count),
            runs=runs,
            verdict=success_verdict(runs, int(count), requirement.probability, requirement.confidence),
            expected_share=1.0 - by_covariance[requirement.name].probability,
        )
    return verdicts


def confirm(
    campaign: Campaign, scenario: Scenario, names: Sequence[str], runs: int
) -> list[tuple[str, int, int, float, str, bool]]:
    """Compare runs with linear covariance, requirement by requirement.

    Parameters
    ----------
    campaign : Campaign
        Campaign with the requirements.
    scenario : Scenario
        The scenario.
    names : sequence of str
        Names of the requirements; all if empty.
    runs : int
        Number of runs.

    Returns
    -------
    list of tuple
        Name, runs, runs beyond the limit, fraction beyond it by linear covariance, verdict of the runs, and whether
        they agree: by a binomial test with the significance level `ALPHA`.
    """
    rows = []
    for name, result in monte_carlo_verdicts(campaign, scenario, runs).items():
        if names and name not in names:
            continue
        expected_share = min(1.0, max(0.0, result.expected_share))
        test = stats.binomtest(result.violation_count, result.runs, expected_share)
        agrees = float(test.pvalue) >= ALPHA
        row = (name, result.runs, result.violation_count, result.expected_share, result.verdict, agrees)
        rows.append(row)
    return rows


def check_names(campaign: Campaign, names: Sequence[str]) -> None:
    """Raise an InputError if a campaign has no requirement, or lacks a requirement with one of the names."""
    requirement_names = [requirement.name for requirement in campaign.requirements]
    for name in names:
        if name not in requirement_names:
            raise InputError(f"solve: no requirement {quoted(name)}{hint(name, requirement_names)}")
    if not requirement_names:
        raise InputError("solve: the campaign states no requirement")


def with_filter(scenario: Scenario, card: FilterCard) -> Scenario:
    """Return a scenario with another filter, without validation: frozen models may violate the rules of cards."""
    return scenario.model_copy(update={"filter": card})
