"""Filter cards derived from a case: process noise, stored gains."""

import math
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.covariance.diagnostics.case_diagnostics import flight_events
from lvnav_trade.covariance.diagnostics.ensemble import Densities, StepErrors, densities, step_errors
from lvnav_trade.covariance.history import forward_tape
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.filter.policies.stored_gains import GainHistory, GainSchedule, build_gain_schedule
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.per_axis import rms
from lvnav_trade.quantities.state_layout import state_names
from lvnav_trade.scenario.filter_models import filter_models, has_covariance
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare
from lvnav_trade.trajectory.flight import identity

_SHORTEST_PHASE = 5.0  # s; a shorter phase is merged with the next
_LEAST_RUNS = 10


class ProcessNoise(NamedTuple):
    """Process noise of a case, estimated from an ensemble of runs."""

    flight_densities: Densities  # root spectral densities of the whole flight, SI
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
    prepared_case = prepare(case.scenario, history=length)
    errors = step_errors(prepared_case, campaign.seed, runs)
    phases = []
    for (first, start), (second, end) in pairwise(_phase_boundaries(prepared_case)):
        phases.append((f"{first} to {second}", start, end, densities(errors, prepared_case, start, end)))
    flight_densities = densities(errors, prepared_case)
    case_text = f", {case.label}" if case.axes else ""
    source = f"estimate-q of {campaign.name}{case_text}: {runs} runs, steps of {length:g} s"
    return ProcessNoise(
        flight_densities=flight_densities,
        phases=tuple(phases),
        steps=steps_table(errors),
        card=_filter_card(case, flight_densities, source),
    )


def _phase_boundaries(prepared_case: PreparedCase) -> list[tuple[str, float]]:
    """Return the boundaries of the phases, name and time (s), from the start of the flight to its end."""
    first_time = float(prepared_case.t_hist[0])
    last_time = float(prepared_case.t_hist[-1])
    boundaries = [("start", first_time)]
    previous_time = first_time
    for name, t in sorted(flight_events(prepared_case).items(), key=lambda item: item[1]):
        if t - previous_time >= _SHORTEST_PHASE:
            boundaries.append((name, t))
            previous_time = t
    if last_time - previous_time >= _SHORTEST_PHASE:
        boundaries.append(("end", last_time))
    return boundaries


def _filter_card(case: Case, noise: Densities, source: str) -> FilterCard:
    """Return the case's filter card with the estimated noise in excess of the IMU noise that the filter models.

    The filter adds the random walks of its IMU card to the noise of its own card, so the variances are subtracted here.
    """
    imu, _, _ = filter_models(case.scenario)
    card = case.scenario.filter
    gyro_walk = rms(imu.gyro_random_walk)
    accel_walk = rms(imu.accel_random_walk)
    attitude_excess = noise.attitude**2 - gyro_walk**2
    velocity_excess = noise.velocity**2 - accel_walk**2
    update = {
        "attitude_noise": math.sqrt(max(0.0, attitude_excess)),
        "velocity_noise": math.sqrt(max(0.0, velocity_excess)),
        "name": f"{card.name}, process noise of an ensemble",
        "source": source,
    }
    return card.model_copy(update=update)


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
    for name, first_state, unit in (("attitude", ATT, "rad"), ("velocity", VEL, "m_per_s"), ("position", POS, "m")):
        axes = slice(first_state, first_state + 3)
        error_square = errors.error[:, axes] ** 2
        mean = errors.mean[:, axes]
        mean_square = variance[:, axes] + mean**2  # E[x^2] = var x + (E x)^2
        error_rms = np.sqrt(error_square.mean(axis=1))
        missed_rms = np.sqrt(mean_square.mean(axis=1))
        table[f"{name}_error_{unit}"] = error_rms
        table[f"{name}_missed_{unit}"] = missed_rms
        table[f"{name}_missed_mean_{unit}"] = np.linalg.norm(mean, axis=1)
    return pd.DataFrame(table)


def gain_schedule(
    campaign: Campaign, case: Case, time_origin: Literal["event", "time"], tolerance: float
) -> GainSchedule:
    """Return the Kalman gains of a case's filter on its nominal flight, computed by linear covariance.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    case : Case
        One of its cases.
    time_origin : {"event", "time"}
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
    prepared_case = prepare(case.scenario, history=campaign.keep.history)
    nominal_gains = _gain_history(prepared_case)
    if not nominal_gains.t.size:
        raise InputError(f"case {case.label}: the filter uses no measurement on this trajectory")
    case_text = f", {case.label}" if case.axes else ""
    trajectory = case.scenario.trajectory
    schedule = build_gain_schedule(
        f"Gains of {case.scenario.filter.name}, {trajectory.name}, by {time_origin}",
        f"schedule-gains of {campaign.name}{case_text}: nominal flight, linear to {tolerance:g} between knots",
        time_origin,
        nominal_gains,
        flight_events(prepared_case),
        tolerance,
    )
    return schedule.model_copy(update={"flight": trajectory.name, "flight_digest": identity(trajectory)})


def _gain_history(prepared_case: PreparedCase) -> GainHistory:
    """Return the Kalman gains of linear covariance at the epochs with a measurement update."""
    tape = forward_tape(prepared_case)
    n_state = prepared_case.layout.n_state
    n_epoch = prepared_case.t_epoch.size
    n_update = int(tape.n_recorded[0])  # the arrays of the tape are longer
    epoch, channel = tape.epoch[:n_update], tape.channel[:n_update]
    names = prepared_case.channels.names
    gains = np.zeros((n_epoch, len(names), n_state))
    gains[epoch, channel] = tape.gain[:n_update, :n_state]
    is_updated = np.zeros(n_epoch, dtype=np.bool_)
    is_updated[epoch] = True
    channels_used = np.unique(channel)
    return GainHistory(
        states=state_names(prepared_case.layout),
        measurements=[names[k] for k in channels_used],
        t=prepared_case.t_epoch[is_updated],
        gains=gains[is_updated][:, channels_used],
    )
