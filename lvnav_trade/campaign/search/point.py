"""One design evaluated by linear covariance: errors of its requirements over their limits; the same by runs."""

from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError
from scipy import stats

from lvnav_trade.campaign.definition.axes import get, put
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.running import stopping, work
from lvnav_trade.campaign.running.case_arrays import CaseArrays
from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.engines.analysis.explain import flown_events
from lvnav_trade.engines.lincov.history import covariance
from lvnav_trade.engines.setup.prepare import Prepared, prepare
from lvnav_trade.engines.simulate.statistics import summarise
from lvnav_trade.errors import InputError, quoted
from lvnav_trade.filter_models import filter_models, sensor_model, sensors_used, solves
from lvnav_trade.filters.base import FilterCard, ReceiverModel
from lvnav_trade.metrics.basics.probability import success_verdict
from lvnav_trade.metrics.errors.covariances import NOT_APPLICABLE, why_outside
from lvnav_trade.metrics.requirements.improvements import asked_of
from lvnav_trade.records import CovHistory
from lvnav_trade.scenario import Scenario
from lvnav_trade.units import parse

HISTORY = 60.0  # s between history times, beside events, where nothing between events is asked
RETUNED, FROZEN = "re-tuned", "frozen"
ALPHA = 0.01  # runs disagree with linear covariance where so many beyond the limit are less likely


class Looked(NamedTuple):
    """What linear covariance says of a requirement: the error that the asked fraction of flights stays below and its
    limit (in `unit`), the probability that the limit is kept. why: why it says nothing; the numbers are NaN then.
    outside: why it does not describe the case at every epoch; empty where it does.
    """

    estimate: float
    limit: float
    probability: float
    unit: str
    why: str = ""
    outside: str = ""

    @property
    def ratio(self) -> float:
        """The estimate over the limit: at most 1 where the requirement is met."""
        return self.estimate / self.limit


def look(campaign: Campaign, scenario: Scenario, names: Sequence[str] = ()) -> dict[str, Looked]:
    """Return what linear covariance says of the requirements of a campaign (those named, or all) in a scenario."""
    return looked(campaign, scenario, names)[0]


def looked(
    campaign: Campaign, scenario: Scenario, names: Sequence[str] = ()
) -> tuple[dict[str, Looked], CovHistory, int]:
    """Return the same, the linear covariance behind it, and the degrees of freedom of its NEES."""
    wanted = [one for one in campaign.requirements if not names or one.name in names]
    prepared = prepare(scenario, campaign.keep.history if any(one.during for one in wanted) else HISTORY)
    history = covariance(prepared)
    results = CaseArrays(prepared, history)
    found, outside = {}, _outside(prepared, results)
    for one in wanted:
        law = asked_of(results, one.model_dump(mode="json"))
        if isinstance(law, str):
            found[one.name] = Looked(np.nan, np.nan, np.nan, "", law)
        else:
            sizes = (law.quantile(law.probability) * law.factor, law.bound * law.factor)
            found[one.name] = Looked(*sizes, law.kept(), law.unit, outside=outside)
    return found, history, int(prepared.layout.n_estimated)


def _outside(prepared: Prepared, results: CaseArrays) -> str:
    """Say why linear covariance does not describe a scenario at every epoch; empty where it does."""
    history = results.covariance
    return why_outside(
        prepared.options.rules is not None, results.largest_tilt(), history.t_epoch, history.false_rejection
    )


def not_described(reasons: Iterable[str]) -> str:
    """Return the remark on results that linear covariance does not describe, each reason once; empty without any."""
    found = "; ".join(dict.fromkeys(one for one in reasons if one))
    return f"{NOT_APPLICABLE}, confirm by runs: {found}" if found else ""


def changed(scenario: Scenario, values: Mapping[str, Any]) -> Scenario:
    """Return a scenario with other values at dotted paths, as a campaign states them; InputError where it cannot be."""
    data = scenario.model_dump(mode="json")
    try:
        return Scenario.model_validate(
            reduce(lambda now, item: put(now, item[0].removeprefix("base.").split("."), item[1]), values.items(), data)
        )
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"{_said(values)}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    except (ValueError, IndexError) as error:
        raise InputError(f"{_said(values)}: {str(error).splitlines()[0]}") from None


def _said(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{path}={value}" for path, value in values.items())


def number_at(scenario: Scenario, path: str, unit: str) -> float:
    """Return the number at a dotted path of a scenario, in a unit; NaN where there is none."""
    value = get(scenario.model_dump(mode="json"), path.removeprefix("base.").split("."))
    if value is None or isinstance(value, bool | dict | list):
        return float("nan")
    number, _, si = str(value).partition(" ")
    try:
        return float(number) / (parse(f"1 {unit}", si or "dimensionless") if unit else 1.0)
    except ValueError:
        return float("nan")


def frozen(start: Scenario) -> FilterCard:
    """Return the filter of a scenario with its models as numbers: what was `matched` no longer follows the truth.

    With the same measurements and rates it has the gains of that scenario. A receiver that solves for itself still
    reports the covariance of its solutions.
    """
    imu, receiver, initial = filter_models(start)
    update: dict[str, Any] = {"imu": imu, "initial": initial}
    if isinstance(start.filter.receiver, str) and not solves(start):
        known = {name: getattr(receiver, name) for name in ReceiverModel.model_fields}
        update["receiver"] = ReceiverModel.model_construct(**known)
    models = {card.measurement: sensor_model(start, card) for card in sensors_used(start).values()}
    update["sensor_models"] = start.filter.sensor_models.model_copy(update=models)
    return start.filter.model_copy(update=update)


class Flown(NamedTuple):
    """Runs beyond a requirement's limit, runs, the verdict of these, and the part that linear covariance expects."""

    beyond: int
    runs: int
    verdict: str
    expected: float


def fly(campaign: Campaign, scenario: Scenario, runs: int) -> dict[str, Flown]:
    """Return what runs say of the requirements in a scenario, beside linear covariance."""
    prepared = prepare(scenario, campaign.keep.history)
    history = covariance(prepared)
    stated = [one.model_dump(mode="json") for one in campaign.requirements]
    size = campaign.monte_carlo.block if campaign.monte_carlo else 40
    events = flown_events(prepared)
    counts = np.zeros(len(stated), dtype=int)
    for first in range(0, runs, size):
        block = work.ENGINE.run_block(prepared, campaign.seed, first, min(size, runs - first))
        summary = summarise(block, events, history.true_sigma, prepared.outputs)
        counts += [one or 0 for one in stopping.beyond(stated, "", prepared, history, summary)]
    expected = look(campaign, scenario)
    return {
        one.name: Flown(
            int(count),
            runs,
            success_verdict(runs, int(count), one.probability, one.confidence),
            1.0 - expected[one.name].probability,
        )
        for one, count in zip(campaign.requirements, counts, strict=True)
    }


def confirm(
    campaign: Campaign, scenario: Scenario, names: Sequence[str], runs: int
) -> list[tuple[str, int, int, float, str, bool]]:
    """Return for each requirement (of these names, or all) its name, runs, runs beyond its limit, the part that linear
    covariance expects beyond, the verdict of the runs, and whether they agree with linear covariance: unless as many
    beyond the limit, or as few, have a chance of less than `ALPHA`.
    """
    found = []
    for name, one in fly(campaign, scenario, runs).items():
        if not names or name in names:
            chance = float(stats.binomtest(one.beyond, one.runs, min(1.0, max(0.0, one.expected))).pvalue)
            found.append((name, one.runs, one.beyond, one.expected, one.verdict, chance >= ALPHA))
    return found


def check_names(campaign: Campaign, names: Sequence[str]) -> None:
    """InputError where a campaign states no requirement, or none of a name."""
    known = [one.name for one in campaign.requirements]
    for name in names:
        if name not in known:
            raise InputError(f"solve: no requirement {quoted(name)}{hint(name, known)}")
    if not known:
        raise InputError("solve: the campaign states no requirement")


def with_filter(scenario: Scenario, card: FilterCard) -> Scenario:
    """Return a scenario with a filter of which some models are numbers that no card states."""
    return scenario.model_copy(update={"filter": card})
