"""What a study computes beside its campaigns' results: process noise of an ensemble, one flight aided and unaided."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.published import Case as Levels
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.derived.filter_cards import ProcessNoise, process_noise
from lvnav_trade.campaign.reading.study import Part
from lvnav_trade.engines.setup.prepare import prepare
from lvnav_trade.engines.simulate.montecarlo import run_block
from lvnav_trade.errors import InputError


class Behind(NamedTuple):
    """noise: estimates of process noise by the length of a step (s); single: one flight, see `flight_of`, or None."""

    noise: tuple[tuple[float, ProcessNoise], ...] = ()
    single: pd.DataFrame | None = None


def behind(part: Part, campaign: Campaign) -> Behind:
    """Return what a study asks for of a campaign beside its results."""
    noise: list[tuple[float, ProcessNoise]] = []
    if part.noise is not None:
        first = cases(campaign)[0]
        noise = [(step, process_noise(campaign, first, part.noise.runs, step)) for step in part.noise.steps]
    single = None
    if part.single is not None:
        chosen = part.single
        single = flight_of(campaign, _case(campaign, chosen.aided), _case(campaign, chosen.unaided), chosen.run)
    return Behind(tuple(noise), single)


def _case(campaign: Campaign, levels: Levels) -> Case:
    for case in cases(campaign):
        if all(case.axes.get(axis) == level for axis, level in levels.items()):
            return case
    raise InputError(f"study.yaml: {campaign.name}: no case {levels}")


def flight_of(campaign: Campaign, aided: Case, unaided: Case, run: int) -> pd.DataFrame:
    """Return one run of two cases on the same draws: t_s, and for every axis of position (m) and velocity (m/s), in the
    reporting frame, QUANTITY_AXIS_true (error of the unaided system), _estimated (what the aided one takes off), _left.
    """
    flown = [prepare(case.scenario, campaign.keep.history) for case in (aided, unaided)]
    errors = [run_block(one, campaign.seed, run, 1).err[0] for one in flown]
    if not np.array_equal(flown[0].t_hist, flown[1].t_hist):
        raise InputError(f"study.yaml: {campaign.name}: the two cases of a single flight do not fly the same flight")
    table = {"t_s": flown[0].t_hist}
    for column, output in enumerate(flown[0].outputs[:9]):
        if output.quantity == "attitude":
            continue
        left, true = errors[0][:, column], errors[1][:, column]
        name = f"{output.quantity}_{output.axis}"
        table |= {f"{name}_true": true, f"{name}_estimated": true - left, f"{name}_left": left}
    return pd.DataFrame(table)
