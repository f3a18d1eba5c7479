"""Single runs, process noise and antenna gains of a case, for scripts that need more than the stored results."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.derived_cards import ProcessNoise, process_noise
from lvnav_trade.gnss.link import gain, gains
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.report.figures.published import steps as steps_figure
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import prepare
from lvnav_trade.simulation.receiver_clock import true_clock

__all__ = [
    "Case",
    "ProcessNoise",
    "case_with",
    "gain",
    "gains",
    "process_noise",
    "receiver_clock",
    "run_errors",
    "steps_figure",
]

_SAME_TIME = 1e-6  # s; times that differ by less are equal up to rounding


def case_with(campaign: Campaign, levels: Mapping[str, str]) -> Case:
    """Return the first case of a campaign with the given levels.

    Parameters
    ----------
    campaign : Campaign
        A loaded campaign.
    levels : mapping of str to str
        Level by axis; axes that are not listed may have any level.

    Returns
    -------
    Case
        Its id, label, axes and scenario.

    Raises
    ------
    InputError
        No case has these levels.
    """
    for case in cases(campaign):
        if all(case.axes.get(axis) == level for axis, level in levels.items()):
            return case
    raise InputError(f"study.yaml: {campaign.name}: no case {dict(levels)}")


def run_errors(campaign: Campaign, case: Case, run: int) -> pd.DataFrame:
    """Simulate one run of a case with its own random draws; return the errors at the history times of the campaign.

    Parameters
    ----------
    campaign : Campaign
        A loaded campaign.
    case : Case
        One of its cases.
    run : int
        Number of the run.

    Returns
    -------
    pandas.DataFrame
        Column t_s, then one column ``QUANTITY_AXIS`` for every error of the filter: SI, in the reporting frame.
    """
    prepared_case = prepare(case.scenario, campaign.keep.history)
    errors = run_block(prepared_case, campaign.seed, run, 1).err[0]
    names = [f"{output.quantity}_{output.axis}" for output in prepared_case.outputs]
    table = pd.DataFrame(errors[:, : len(names)], columns=names)
    table.insert(0, "t_s", prepared_case.t_hist)
    return table


def receiver_clock(campaign: Campaign, case: Case, run: int) -> pd.DataFrame:
    """Return the true receiver clock of one run, at the history times that coincide with an epoch of the filter.

    Parameters
    ----------
    campaign : Campaign
        A loaded campaign.
    case : Case
        One of its cases.
    run : int
        Number of the run.

    Returns
    -------
    pandas.DataFrame
        Columns t_s (s), bias_m (clock bias times the speed of light, m) and drift_m_per_s (m/s).
    """
    prepared_case = prepare(case.scenario, campaign.keep.history)
    t = prepared_case.t_hist
    # First epoch at or after each history time, up to rounding
    epoch = np.searchsorted(prepared_case.t_epoch, t - _SAME_TIME)
    epoch = np.minimum(epoch, prepared_case.t_epoch.size - 1)
    is_at_epoch = np.abs(prepared_case.t_epoch[epoch] - t) < _SAME_TIME
    clock = true_clock(prepared_case, campaign.seed, run)[epoch[is_at_epoch]]
    return pd.DataFrame(
        {
            "t_s": t[is_at_epoch],
            "bias_m": clock[:, 0],
            "drift_m_per_s": clock[:, 1],
        }
    )
