"""What is looked for before anything is computed: flights that cannot be, settings that no case reads."""

from collections.abc import Sequence
from typing import NamedTuple

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading import flights
from lvnav_trade.campaign.reading.effect import Effects
from lvnav_trade.campaign.running import work
from lvnav_trade.campaign.running.pool import each
from lvnav_trade.engines.analysis.effect import Used
from lvnav_trade.errors import InputError, refuse_all


class Checked(NamedTuple):
    """Event times (s) by case digest, and what is to be said of the cases, by kind as `flights.remarks`."""

    events: dict[str, dict[str, float]]
    remarks: dict[str, list[str]]


def check_flight(campaign: Campaign, found: Sequence[Case], engine: work.Engine, jobs: int) -> Checked:
    """Build every distinct trajectory; refuse what cannot fly, and faults and requirements that do not fit a flight."""
    distinct: dict[str, Case] = {}
    for case in found:
        distinct.setdefault(_flight_of(case), case)
    results = each(jobs, work.flown, [(engine, case) for case in distinct.values()], ordered=True)
    flown = dict(zip(distinct, results, strict=True))
    found_wrong = [
        record
        for key, case in distinct.items()
        if isinstance(flown[key], InputError)
        for record in flights.located(campaign, case, flown[key].records)
    ]
    refuse_all(list(dict.fromkeys(found_wrong)))  # cases that differ in their IMU share what is wrong with the flight
    times = {case.id: flown[_flight_of(case)].events for case in found}
    refuse_all([*flights.mistakes(campaign, found, times), *Effects(campaign, found).mistakes({})])
    return Checked(times, flights.remarks(found, [one for flight in flown.values() for one in flight.remarks]))


def check_effect(campaign: Campaign, found: Sequence[Case], engine: work.Engine) -> None:
    """Refuse what the campaign states and no case reads: as many cases are put together as it takes to see that each
    statement is read in one of them.
    """
    effects = Effects(campaign, found)
    known: dict[str, Used | None] = {}
    while (case := effects.next(known)) is not None:
        try:
            _, known[case.id] = work.prepared_with(engine, case, campaign.keep.history)
        except InputError as error:
            raise InputError(records=flights.located(campaign, case, error.records)) from None
    refuse_all(effects.mistakes(known))


def _flight_of(case: Case) -> str:
    """Return what a case's events depend on, and whether it can be flown."""
    scenario = case.scenario
    checked_against = scenario.imu.model_dump_json() if scenario.trajectory.kind == "table" else ""  # see its residual
    return scenario.trajectory.model_dump_json() + scenario.constellation.model_dump_json() + checked_against
