"""Recorded errors of a receiver: mean, and deviation by the start of a run in the recording."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.gnss.receiver_cards import DirectSolution
from lvnav_trade.gnss.recorded_errors import ErrorTable, inertial_errors, sample_errors
from lvnav_trade.kernels.random import philox, seed_words, source_word
from lvnav_trade.quantities.frames import earth_angle
from lvnav_trade.quantities.records import Bools, Floats, Sky
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.receiver_observables import Channels
from lvnav_trade.sensors.sensor import CorrelatedError
from lvnav_trade.simulation.preparation.correlated import RECORDED, EnteringError
from lvnav_trade.simulation.preparation.signals.lines_of_sight import Lines
from lvnav_trade.simulation.preparation.signals.receiver_measurements import freeze_output

SOURCE = "recorded receiver error"
_NEGLIGIBLE = 1e-12  # of the largest singular value


class RecordedErrors(NamedTuple):
    """Recorded errors of a receiver's solution, by the start of a run in the recording.

    mean : (n_epoch, 6) m, m/s. Mean over the starts, frame i.
    errors : One error for each singular vector of the deviations.
    values : (n_component, n_start). Coefficients of these errors at each start: mean 0, variance 1, uncorrelated.
    """

    mean: Floats
    errors: tuple[EnteringError, ...]
    values: Floats


def table_of(scenario: Scenario) -> ErrorTable | None:
    """Return the recorded error table of a scenario's receiver; None without."""
    solution = scenario.receiver.solution
    return solution.error_table if isinstance(solution, DirectSolution) else None


def recorded_solution_errors(
    scenario: Scenario,
    theta0: float,
    line: Lines,
    sky: Sky,
    channels: Channels,
    frozen: Bools,
) -> RecordedErrors:
    """Return the recorded errors of the receiver's solution at the epochs of a flight; zero without a recording.

    The deviations of the starts from their mean are decomposed into singular vectors. With the coefficients of a run
    their sum is the recording of that run, to rounding. The coefficients are uncorrelated with unit variance, as linear
    covariance requires, so both engines have the same mean and covariance. The number of sources is at most the number
    of starts minus one.

    Parameters
    ----------
    scenario
        Validated model of the case.
    theta0
        rad. Earth rotation angle at lift-off.
    line, sky, channels
        Lines of sight, satellites, measurement channels.
    frozen
        (n_epoch,). Whether the receiver repeats the output, and the error, of the previous epoch.
    """
    card = table_of(scenario)
    n_epoch = sky.t.size
    if card is None or channels.tight:
        return RecordedErrors(mean=np.zeros((n_epoch, 6)), errors=(), values=np.zeros((0, 1)))
    recorded_table = sample_errors(card, sky.t)
    earth_rotation = earth_angle(theta0, sky.t)
    table = inertial_errors(recorded_table, card.frame, line.position, earth_rotation)
    freeze_output(frozen, np.swapaxes(table, 0, 1))
    mean = table.mean(axis=0)
    deviations = (table - mean).reshape(card.starts, -1)
    vectors, singular_values, shapes = np.linalg.svd(deviations, full_matrices=False)
    largest_error = float(np.max(np.abs(table)))
    largest = max(float(singular_values[0]), largest_error)
    is_significant = singular_values > _NEGLIGIBLE * largest
    count = int(np.count_nonzero(is_significant))
    root_starts = np.sqrt(card.starts)
    scaled_shapes = singular_values[:count, None] * shapes[:count] / root_starts
    by_epoch = scaled_shapes.reshape(count, n_epoch, 6)
    # error k enters the channels of the solution only, with the k-th singular vector as its derivative
    n_channel = channels.n_channel
    partials = np.pad(by_epoch, ((0, 0), (0, 0), (0, n_channel - 6)))
    is_of_solution = np.arange(n_channel) < 6
    member = np.where(is_of_solution, 0, -1)
    errors = []
    for number, partial in enumerate(partials):
        error = CorrelatedError(SOURCE, RECORDED, 1.0, "", math.inf, (str(number),))
        errors.append(EnteringError(error, member, partial))
    values = vectors[:, :count].T * root_starts
    return RecordedErrors(mean, tuple(errors), values)


def run_coefficients(recorded_errors: RecordedErrors, seed: int, runs: NDArray[Any]) -> Floats:
    """Return the coefficients (n_component, n_run) of runs, by the starts that they draw.

    Parameters
    ----------
    recorded_errors
        Recorded errors of the solution.
    seed
        Seed of the campaign.
    runs
        (n_run,). Numbers of the runs.
    """
    n_start = recorded_errors.values.shape[1]
    starts = [recording_start(seed, int(run), n_start) for run in runs]
    return recorded_errors.values[:, starts]


def recording_start(seed: int, run: int, n_start: int) -> int:
    """Return the start that a run draws, 0 to n_start - 1.

    Parameters
    ----------
    seed
        Seed of the campaign.
    run
        Number of the run.
    n_start
        Number of starts in the recording.
    """
    source = source_word(f"{SOURCE} start")
    zero = np.uint64(0)
    words = philox(zero, np.uint64(run), source, zero, *seed_words(seed))
    return int(words[0]) * n_start >> 32
