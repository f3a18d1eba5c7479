"""Filter cards derived from a case: process noise, stored gains."""

import math
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.covariance.diagnostics.case_diagnostics import flown_events
from lvnav_trade.covariance.diagnostics.ensemble import Densities, StepErrors, densities, step_errors
from lvnav_trade.covariance.history import forward_tape
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.filter.policies.stored_gains import GainHistory, GainSchedule, schedule_of
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.per_axis import rms
from lvnav_trade.quantities.state_layout import state_names
from lvnav_trade.scenario.filter_models import filter_models, has_covariance
from lvnav_trade.simulation.preparation.prepare import Prepared, prepare
from lvnav_trade.trajectory.flight import identity

_SHORTEST = 5.0  # s; a shorter phase is merged with the next
_LEAST_RUNS = 10
_SAME_TIME = 1e-6  # s


class ProcessNoise(NamedTuple):
    """Process noise of a case, estimated from an ensemble of runs."""

    whole: Densities  # root spectral densities of the whole flight, SI
    phases: tuple[tuple[str, float, float, Densities], ...]  # by phase: name, start and end (s), densities
    steps: pd.DataFrame  # error per step over the flight, see `steps_table`
    card: FilterCard  # filter card with the estimated noise


def process_noise(campaign: Campaign, case: Case, runs: int, step: float | None = None) -> ProcessNoise:
    """Estimate the process noise of a case's filter from an ensemble of unaided runs.

    Parameters
    ----------
    campaign : Campaign
        The campaign; its seed determines the random draws.
    case : Case
        One of its cases.
    runs : int
        Number of runs of the ensemble.
    step : float, optional
        Length of a step (s); the filter's interval between measurement updates if absent.

    Returns
    -------
    ProcessNoise
        Densities of the whole flight and of each phase, error per step, filter card.

    Raises
    ------
    InputError
        There are fewer than ten runs, or the step is not above zero.

    Notes
    -----
    The variance per step of a constant error, such as a scale factor, grows with the square of the step; that of white
    noise grows with the step. A longer step therefore gives a density that covers more of the constant errors.
    """
    if runs < _LEAST_RUNS:
        raise InputError(f"{runs} runs are too few for a covariance; give {_LEAST_RUNS} at least")
    length = 1.0 / case.scenario.filter.update_rate if step is None else step
    if not length > 0.0:
        raise InputError(f"a step of {length:g} s; give one above zero")
    prepared = prepare(case.scenario, history=length)
    errors = step_errors(prepared, campaign.seed, runs)
    phases = tuple(
        (f"{first} to {second}", start, end, densities(errors, prepared, start, end))
        for (first, start), (second, end) in pairwise(_phase_boundaries(prepared))
    )
    whole = densities(errors, prepared)
    words = f"estimate-q of {campaign.name}{f', {case.label}' if case.axes else ''}: {runs} runs, steps of {length:g} s"
    return ProcessNoise(whole, phases, steps_table(errors), _card(case, whole, words))


def _phase_boundaries(prepared: Prepared) -> list[tuple[str, float]]:
    """Return the boundaries of the phases, name and time (s), from the start of the flight to its end."""
    marks = [("start", float(prepared.t_hist[0]))]
    for name, t in sorted(flown_events(prepared).items(), key=lambda item: item[1]):
        if t - marks[-1][1] >= _SHORTEST:
            marks.append((name, t))
    if prepared.t_hist[-1] - marks[-1][1] >= _SHORTEST:
        marks.append(("end", float(prepared.t_hist[-1])))
    return marks


def _card(case: Case, noise: Densities, words: str) -> FilterCard:
    """Return the case's filter card with the estimated noise in excess of the IMU noise that the filter models.

    The filter adds the random walks of its IMU card to the noise of its own card, so the variances are subtracted here.
    """
    imu, _, _ = filter_models(case.scenario)
    card = case.scenario.filter
    beyond = {
        "attitude_noise": math.sqrt(max(0.0, noise.attitude**2 - rms(imu.gyro_random_walk) ** 2)),
        "velocity_noise": math.sqrt(max(0.0, noise.velocity**2 - rms(imu.accel_random_walk) ** 2)),
    }
    return card.model_copy(update={**beyond, "name": f"{card.name}, process noise of an ensemble", "source": words})


def steps_table(errors: StepErrors) -> pd.DataFrame:
    """Return the statistics of the error per step over the flight.

    Parameters
    ----------
    errors : StepErrors
        Ensemble statistics, SI, frame i.

    Returns
    -------
    pandas.DataFrame
        Columns t_s (end of the step) and seconds_s (its length). For attitude (rad), velocity (m/s) and position (m)
        three columns each: ``NAME_error``, the RMS of the error over runs and axes; ``NAME_missed``, the RMS of the
        part that the filter's transition did not predict within the step; ``NAME_missed_mean``, the norm of the mean
        of this part.
    """
    table = {"t_s": errors.t, "seconds_s": errors.seconds}
    variance = np.diagonal(errors.covariance, axis1=1, axis2=2)
    for name, at, unit in (("attitude", ATT, "rad"), ("velocity", VEL, "m_per_s"), ("position", POS, "m")):
        axes = slice(at, at + 3)
        mean_square = variance[:, axes] + errors.mean[:, axes] ** 2
        table[f"{name}_error_{unit}"] = np.sqrt((errors.error[:, axes] ** 2).mean(axis=1))
        table[f"{name}_missed_{unit}"] = np.sqrt(mean_square.mean(axis=1))
        table[f"{name}_missed_mean_{unit}"] = np.linalg.norm(errors.mean[:, axes], axis=1)
    return pd.DataFrame(table)


def gain_schedule(campaign: Campaign, case: Case, by: Literal["event", "time"], tolerance: float) -> GainSchedule:
    """Return the Kalman gains of a case's filter on its nominal flight, computed by linear covariance.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    case : Case
        One of its cases.
    by : {"event", "time"}
        Origin of the stored times: the last event, or lift-off.
    tolerance : float
        Largest interpolation error between knots, as a fraction of the largest magnitude of each gain in the segment.

    Returns
    -------
    GainSchedule
        Segments with as few knots as the tolerance permits.

    Raises
    ------
    InputError
        The filter takes no measurement, its gains depend on the covariance reported with each solution, or the
        tolerance is not between 0 and 1.
    """
    if has_covariance(case.scenario):
        raise InputError(
            f"case {case.label}: its gains depend on the covariance of each solution: no schedule has them"
        )
    if not 0.0 < tolerance < 1.0:
        raise InputError(f"a tolerance of {tolerance:g}; give one between 0 and 1")
    prepared = prepare(case.scenario, history=campaign.keep.history)
    tape, n = forward_tape(prepared), prepared.layout.n_state
    used = int(tape.used[0])  # number of recorded measurement updates; the arrays of the tape are longer
    names = prepared.channels.names
    gains, updated = np.zeros((prepared.t_epoch.size, len(names), n)), np.zeros(prepared.t_epoch.size, dtype=np.bool_)
    gains[tape.epoch[:used], tape.channel[:used]] = tape.gain[:used, :n]
    updated[tape.epoch[:used]] = True
    taken = np.unique(tape.channel[:used])
    if not np.any(updated):
        raise InputError(f"case {case.label}: the filter uses no measurement on this trajectory")
    label = f", {case.label}" if case.axes else ""
    nominal = GainHistory(
        states=state_names(prepared.layout),
        measurements=[names[channel] for channel in taken],
        t=prepared.t_epoch[updated],
        gains=gains[updated][:, taken],
    )
    schedule = schedule_of(
        f"Gains of {case.scenario.filter.name}, {case.scenario.trajectory.name}, by {by}",
        f"schedule-gains of {campaign.name}{label}: nominal flight, linear to {tolerance:g} between knots",
        by,
        nominal,
        flown_events(prepared),
        tolerance,
    )
    card = case.scenario.trajectory
    return schedule.model_copy(update={"flight": card.name, "flight_digest": identity(card)})
