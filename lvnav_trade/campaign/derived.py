"""Computed from a case: process noise and gains as filter cards, and what a study's report shows of them."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.published import Case as Levels
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.study import Part
from lvnav_trade.engines.analysis.ensemble import Densities, StepErrors, densities, step_errors
from lvnav_trade.engines.analysis.explain import flown_events
from lvnav_trade.engines.lincov.history import forward_tape
from lvnav_trade.engines.setup.prepare import Prepared, prepare
from lvnav_trade.engines.simulate.clock import true_clock
from lvnav_trade.engines.simulate.montecarlo import run_block
from lvnav_trade.errors import InputError
from lvnav_trade.filters.base import FilterCard
from lvnav_trade.filters.scheduled import GainSchedule, schedule_of
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.layout import state_names
from lvnav_trade.per_axis import rms
from lvnav_trade.scenario import filter_models, has_covariance
from lvnav_trade.world.flight.trajectory import identity
from lvnav_trade.world.receiver.link import gain, gains

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
        raise InputError(f"a step of {length:g} s has no length")
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
        raise InputError(f"case {case.label}: the covariance that comes with each solution decides the gains")
    if not 0.0 < tolerance < 1.0:
        raise InputError(f"a tolerance of {tolerance:g} is no share between 0 and 1")
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
    schedule = schedule_of(
        f"Gains of {case.scenario.filter.name}, {case.scenario.trajectory.name}, by {by}",
        f"schedule-gains of {campaign.name}{label}: nominal flight, linear to {tolerance:g} between knots",
        by,
        state_names(prepared.layout),
        prepared.t_epoch[updated],
        gains[updated][:, taken],
        flown_events(prepared),
        tolerance,
        measurements=[names[channel] for channel in taken],
    )
    card = case.scenario.trajectory
    return schedule.model_copy(update={"flight": card.name, "flight_digest": identity(card)})


class Behind(NamedTuple):
    """noise: estimates of process noise by the length of a step (s); drawn: table of each figure that results alone do
    not give, by its place among the figures, see `flight_of`, `clocks_of`, `antennas_of`.
    """

    noise: tuple[tuple[float, ProcessNoise], ...] = ()
    drawn: Mapping[int, pd.DataFrame] = MappingProxyType({})


def behind(part: Part, campaign: Campaign) -> Behind:
    """Return what a study asks for of a campaign beside its results."""
    noise: tuple[tuple[float, ProcessNoise], ...] = ()
    if (asked := part.noise) is not None:
        noise = tuple((step, process_noise(campaign, cases(campaign)[0], asked.runs, step)) for step in asked.steps)
    drawn = {}
    for place, figure in enumerate(part.figures):
        chosen = [_case(campaign, levels) for levels in figure.cases]
        if figure.plot == "single":
            drawn[place] = flight_of(campaign, chosen, figure.run)
        elif figure.plot == "clocks":
            drawn[place] = clocks_of(campaign, chosen, figure.run)
        elif figure.plot == "antennas":
            drawn[place] = antennas_of(_case(campaign, figure.case))
    return Behind(noise, drawn)


def _case(campaign: Campaign, levels: Levels) -> Case:
    for case in cases(campaign):
        if all(case.axes.get(axis) == level for axis, level in levels.items()):
            return case
    raise InputError(f"study.yaml: {campaign.name}: no case {levels}")


def flight_of(campaign: Campaign, chosen: Sequence[Case], run: int) -> pd.DataFrame:
    """Return one run of two cases, aided and unaided, on the same draws: t_s, and for every axis of position (m) and
    velocity (m/s), in the reporting frame, QUANTITY_AXIS_true (error of the unaided system), _estimated (what the aided
    one takes off), _left.
    """
    flown = [prepare(case.scenario, campaign.keep.history) for case in chosen]
    errors = [run_block(one, campaign.seed, run, 1).err[0] for one in flown]
    if not np.array_equal(flown[0].t_hist, flown[1].t_hist):
        raise InputError(f"study.yaml: {campaign.name}: the two cases of a single flight do not fly the same flight")
    table = {"t_s": flown[0].t_hist}
    for column, output in enumerate(flown[0].outputs[3:9], start=3):  # behind attitude
        left, true = errors[0][:, column], errors[1][:, column]
        name = f"{output.quantity}_{output.axis}"
        table |= {f"{name}_true": true, f"{name}_estimated": true - left, f"{name}_left": left}
    return pd.DataFrame(table)


def clocks_of(campaign: Campaign, chosen: Sequence[Case], run: int) -> pd.DataFrame:
    """Return one run of cases on the same draws: t_s of the epochs, bias_m and drift_m_per_s of the receiver's clock,
    and bias_m CASE and drift_m_per_s CASE as its own solution has them; InputError where a case reports none.
    """
    table: dict[str, Any] = {}
    for case in chosen:
        prepared = prepare(case.scenario, campaign.keep.history)
        at = {one.quantity: column for column, one in enumerate(prepared.outputs)}
        if "receiver_clock_bias" not in at:
            raise InputError(f"study.yaml: {campaign.name}: {case.label} reports no solution of the receiver's own")
        epoch = np.searchsorted(prepared.t_epoch, prepared.t_hist - _SAME_TIME)
        epoch = np.minimum(epoch, prepared.t_epoch.size - 1)
        shown = np.abs(prepared.t_epoch[epoch] - prepared.t_hist) < _SAME_TIME
        clock = true_clock(prepared, campaign.seed, run)[epoch[shown]]
        error = run_block(prepared, campaign.seed, run, 1).err[0, shown]
        table |= {"t_s": prepared.t_hist[shown], "bias_m": clock[:, 0], "drift_m_per_s": clock[:, 1]}
        for k, name in enumerate(("bias_m", "drift_m_per_s")):
            table[f"{name} {case.label}"] = clock[:, k] - error[:, at["receiver_clock_bias"] + k]
    return pd.DataFrame(table)


def antennas_of(case: Case) -> pd.DataFrame:
    """Return the gain (dBi) of a receiver's antennas, -inf where nothing is heard: angle_deg, off_boresight (of the
    first antenna, by the angle to its axis), and each antenna across the body axis, by the angle from y to z.
    """
    cards = case.scenario.receiver.antennas
    if not cards:
        raise InputError(f"study.yaml: {case.label}: the receiver has no antennas, and hears all directions alike")
    angle = np.radians(np.arange(361.0))
    across = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=-1)
    heard = gains(cards, across)
    table = {"angle_deg": np.degrees(angle), "off_boresight": gain(cards[0], np.minimum(angle, 2.0 * math.pi - angle))}
    return pd.DataFrame(table | {card.name: heard[:, k] for k, card in enumerate(cards)})
