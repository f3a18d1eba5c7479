"""Filter cards derived from a case: process noise, stored gains."""

import math
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.engines.analysis.ensemble import Densities, StepErrors, densities, step_errors
from lvnav_trade.engines.analysis.explain import flown_events
from lvnav_trade.engines.lincov.history import forward_tape
from lvnav_trade.engines.setup.prepare import Prepared, prepare
from lvnav_trade.errors import InputError
from lvnav_trade.filter_models import filter_models, has_covariance
from lvnav_trade.filters.base import FilterCard
from lvnav_trade.filters.scheduled import FlownGains, GainSchedule, schedule_of
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.layout import state_names
from lvnav_trade.per_axis import rms
from lvnav_trade.world.flight.trajectory import identity

_SHORTEST = 5.0  # seconds: a shorter phase is joined to the one after it
_LEAST_RUNS = 10
_SAME_TIME = 1e-6  # seconds


class ProcessNoise(NamedTuple):
    """Process noise of a case: densities over the whole flight and by phase (name, start and end s, densities); steps:
    the error per step over the flight, see `steps_table`; card: the filter's, with the noise in it.
    """

    whole: Densities
    phases: tuple[tuple[str, float, float, Densities], ...]
    steps: pd.DataFrame
    card: FilterCard


def process_noise(campaign: Campaign, case: Case, runs: int, step: float | None = None) -> ProcessNoise:
    """Return the process noise that an ensemble of a case's unaided runs shows.

    Parameters
    ----------
    runs
        Runs of the ensemble; draws are those of the campaign's seed.
    step
        Length of a step in s; the filter's time between updates if absent. An error that lasts (a scale factor) grows
        with the length of the step, one that is white does not: the longer the step, the more of what lasts is covered.

    Raises
    ------
    InputError
        With fewer than ten runs, or a filter without an inertial unit to model.
    """
    if runs < _LEAST_RUNS:
        raise InputError(f"{runs} runs are too few for a covariance; give {_LEAST_RUNS} at least")
    length = 1.0 / case.scenario.filter.update_rate if step is None else step
    if not length > 0.0:
        raise InputError(f"a step of {length:g} s; give one above zero")
    prepared = prepare(case.scenario, history=length)
    found = step_errors(prepared, campaign.seed, runs)
    phases = tuple(
        (f"{first} to {second}", start, end, densities(found, prepared, start, end))
        for (first, start), (second, end) in pairwise(_marks(prepared))
    )
    whole = densities(found, prepared)
    words = f"estimate-q of {campaign.name}{f', {case.label}' if case.axes else ''}: {runs} runs, steps of {length:g} s"
    return ProcessNoise(whole, phases, steps_table(found), _card(case, whole, words))


def _marks(prepared: Prepared) -> list[tuple[str, float]]:
    """Return names and times (s) between which the phases lie, from the start of the flight to its end."""
    marks = [("start", float(prepared.t_hist[0]))]
    for name, t in sorted(flown_events(prepared).items(), key=lambda item: item[1]):
        if t - marks[-1][1] >= _SHORTEST:
            marks.append((name, t))
    if prepared.t_hist[-1] - marks[-1][1] >= _SHORTEST:
        marks.append(("end", float(prepared.t_hist[-1])))
    return marks


def _card(case: Case, noise: Densities, words: str) -> FilterCard:
    """Return the case's filter with the noise that its inertial unit does not stand for already."""
    imu, _, _ = filter_models(case.scenario)
    card = case.scenario.filter
    beyond = {
        "attitude_noise": math.sqrt(max(0.0, noise.attitude**2 - rms(imu.gyro_random_walk) ** 2)),
        "velocity_noise": math.sqrt(max(0.0, noise.velocity**2 - rms(imu.accel_random_walk) ** 2)),
    }
    return card.model_copy(update={**beyond, "name": f"{card.name}, process noise of an ensemble", "source": words})


def steps_table(found: StepErrors) -> pd.DataFrame:
    """Return the error per step over the flight: t_s, seconds_s, and for attitude (rad), velocity (m/s), position (m)
    the root mean square over runs and axes of the error itself, of what the transition missed of it in the step, and
    the norm of the miss's mean.
    """
    table = {"t_s": found.t, "seconds_s": found.seconds}
    variance = np.diagonal(found.covariance, axis1=1, axis2=2)
    for name, at, unit in (("attitude", ATT, "rad"), ("velocity", VEL, "m_per_s"), ("position", POS, "m")):
        three = slice(at, at + 3)
        missed = variance[:, three] + found.mean[:, three] ** 2
        table[f"{name}_error_{unit}"] = np.sqrt((found.error[:, three] ** 2).mean(axis=1))
        table[f"{name}_missed_{unit}"] = np.sqrt(missed.mean(axis=1))
        table[f"{name}_missed_mean_{unit}"] = np.linalg.norm(found.mean[:, three], axis=1)
    return pd.DataFrame(table)


def gain_schedule(campaign: Campaign, case: Case, by: Literal["event", "time"], tolerance: float) -> GainSchedule:
    """Return the gains of a case's filter on its nominal flight, as linear covariance finds them, between as few knots
    as a tolerance (of each gain's largest size in the segment) allows.

    InputError for a filter without measurements, or with solutions whose own covariance decides the gains.
    """
    if has_covariance(case.scenario):
        raise InputError(
            f"case {case.label}: its gains depend on the covariance of each solution: no schedule has them"
        )
    if not 0.0 < tolerance < 1.0:
        raise InputError(f"a tolerance of {tolerance:g}; give one between 0 and 1")
    prepared = prepare(case.scenario, history=campaign.keep.history)
    tape, n = forward_tape(prepared), prepared.layout.n_state
    used = int(tape.used[0])
    names = prepared.channels.names
    gains, updated = np.zeros((prepared.t_epoch.size, len(names), n)), np.zeros(prepared.t_epoch.size, dtype=np.bool_)
    gains[tape.epoch[:used], tape.channel[:used]] = tape.gain[:used, :n]
    updated[tape.epoch[:used]] = True
    taken = np.unique(tape.channel[:used])
    if not np.any(updated):
        raise InputError(f"case {case.label}: the filter takes no measurement on this flight")
    label = f", {case.label}" if case.axes else ""
    flown = FlownGains(
        states=state_names(prepared.layout),
        measurements=[names[channel] for channel in taken],
        t=prepared.t_epoch[updated],
        gains=gains[updated][:, taken],
    )
    schedule = schedule_of(
        f"Gains of {case.scenario.filter.name}, {case.scenario.trajectory.name}, by {by}",
        f"schedule-gains of {campaign.name}{label}: nominal flight, linear to {tolerance:g} between knots",
        by,
        flown,
        flown_events(prepared),
        tolerance,
    )
    card = case.scenario.trajectory
    return schedule.model_copy(update={"flight": card.name, "flight_digest": identity(card)})
