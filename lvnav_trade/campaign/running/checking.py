"""Checks before anything is computed: invalid trajectories, and settings without effect on any case."""

import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.interrupts import attempt
from lvnav_trade.campaign.reading import flights
from lvnav_trade.campaign.reading.effect import Effects
from lvnav_trade.campaign.running import work
from lvnav_trade.campaign.running.pool import map_items
from lvnav_trade.quantities.errors import InputError, refuse_all
from lvnav_trade.simulation.settings_read import EffectiveSettings


class TrajectoryCheck(NamedTuple):
    """Result of the checks of a campaign's trajectories."""

    events: dict[str, dict[str, float]]  # event times (s) by digest of the case
    remarks: dict[str, list[str]]  # remarks by kind, see `flights.remarks`


def check_flight(
    campaign: Campaign,
    distinct_cases: Sequence[Case],
    engine: work.Engine,
    jobs: int,
    early_tasks: Sequence[Callable[[], None]] = (),
) -> TrajectoryCheck:
    """Build every distinct trajectory of a campaign and check the campaign against them.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    distinct_cases : sequence of Case
        Cases to check.
    engine : Engine
        Functions that compute.
    jobs : int
        Worker processes.
    early_tasks : sequence of callable
        Functions for workers that have no trajectory to build, such as compilation of kernels. A failure is
        ignored, since the stage that needs the result reports it.

    Returns
    -------
    TrajectoryCheck
        Event times and remarks.

    Raises
    ------
    InputError
        A trajectory is invalid, or a fault or requirement does not fit its trajectory.
    """
    by_trajectory: dict[str, Case] = {}
    for case in distinct_cases:
        by_trajectory.setdefault(_trajectory_text(case), case)
    items: list[tuple[Any, ...]] = [(work.trajectory_summary, engine, case) for case in by_trajectory.values()]
    items += [(attempt, task) for task in early_tasks]
    results = list(map_items(jobs, operator.call, items, is_ordered=True))
    summaries = dict(zip(by_trajectory, results, strict=False))  # the results of `early_tasks` follow
    errors = []
    for text, case in by_trajectory.items():
        summary = summaries[text]
        if isinstance(summary, InputError):
            errors += flights.locate_mistakes(campaign, case, summary.records)
    refuse_all(list(dict.fromkeys(errors)))  # cases that differ in their IMU alone have the same errors
    times = {case.id: summaries[_trajectory_text(case)].events for case in distinct_cases}
    misfits = [*flights.mistakes(campaign, distinct_cases, times)]
    effects = Effects(campaign, distinct_cases)
    misfits += effects.mistakes({})
    refuse_all(misfits)
    remarks = [remark for summary in summaries.values() for remark in summary.remarks]
    return TrajectoryCheck(times, flights.remarks(distinct_cases, remarks))


def check_effect(campaign: Campaign, distinct_cases: Sequence[Case], engine: work.Engine) -> None:
    """Refuse settings that the campaign gives and no case reads.

    Cases are prepared one after the other until every setting has been read in at least one case.
    """
    effects = Effects(campaign, distinct_cases)
    effective_settings: dict[str, EffectiveSettings | None] = {}
    case = effects.next_case(effective_settings)
    while case is not None:
        try:
            _, effective_settings[case.id] = work.prepared_with(engine, case, campaign.keep.history)
        except InputError as error:
            raise InputError(records=flights.locate_mistakes(campaign, case, error.records)) from None
        case = effects.next_case(effective_settings)
    refuse_all(effects.mistakes(effective_settings))


def _trajectory_text(case: Case) -> str:
    """Return the settings on which the events and the validity of a case's trajectory depend, as text."""
    scenario = case.scenario
    text = scenario.trajectory.model_dump_json() + scenario.constellation.model_dump_json()
    if scenario.trajectory.kind == "table":  # its residual is compared with the noise of the IMU
        text += scenario.imu.model_dump_json()
    return text
