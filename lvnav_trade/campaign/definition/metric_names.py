"""The metrics that a published number or a statement can name, and their units."""

import re

from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.errors import quoted
from lvnav_trade.layout import (
    AVAILABILITY,
    EXTRAS,
    LEVELS,
    MISSION,
    MODE_METRICS,
    MOTION,
    PARAMETERS,
    PROTECTED,
    RATES,
    split_metric,
)
from lvnav_trade.observables.sensors import SENSOR_STATES

# Metrics of a vehicle under control: by how many percent less its nozzle moves with the filtered than the raw rate
MOVED = tuple(
    f"nozzle_movement_{axis}{part}" for axis in ("pitch", "yaw") for part in ("", "_burn_1", "_burn_2", "_burn_3")
)
# and the part of its ticks whose angular acceleration and lateral jerk are within the envelope that is assumed of them
INSIDE = tuple(
    f"{what}_inside_{axis}{part}"
    for what in ("turning", "jerk")
    for axis in ("pitch", "yaw")
    for part in ("", "_burn", "_coast", "_change")
)
STEERED = (*MOVED, *INSIDE)
# The least number of observable states of any stretch: beyond rounding, and by more than the tolerance of the results
RANKS = ("observable_states", "informed_states")
# Metrics that are no error of the navigation: read off the signals, the same in every run
_DELAYS = ("troposphere", "troposphere_left", "ionosphere", "ionosphere_left")
COUNTED = (
    "satellites_tracked",
    *_DELAYS,
    *(f"{delay}_change" for delay in _DELAYS),  # from an epoch to the next, of a satellite that is tracked at both
    "troposphere_change_height",  # altitude at which it is largest
    "air_crossing_height",  # altitude at which climb rate times density (7.5 km) is largest
    "reacquisition_time",
)
# Mean of the normalised estimation error squared per degree of freedom, over the events of a phase
NEES = tuple(f"{quantity}_nees" for quantity in ("attitude", "velocity", "position"))
# Time (s) after the start of a phase from which on the error of a run stays below a limit, at its events
CONVERGENCE = tuple(f"{quantity}_convergence_time" for quantity in ("attitude", "velocity", "position"))
# Share of runs with all three axes within three of the filter's own sigmas, at an event
COVERAGE = tuple(f"{quantity}_coverage" for quantity in ("attitude", "velocity", "position"))
_OF_RUNS = (*NEES, *CONVERGENCE, *LEVELS, *AVAILABILITY, *RATES, *COVERAGE, *MODE_METRICS)
_NO_ERRORS = (*MISSION, *COUNTED, *STEERED, *RANKS, *_OF_RUNS)
# Metrics of a phase with a limit
LIMITED = (*CONVERGENCE, *AVAILABILITY)

# SI unit of every quantity of which results hold an error
ERROR_UNITS = (
    {"attitude": "rad", "velocity": "m/s", "position": "m", "clock_bias": "m", "clock_drift": "m/s"}
    | {"backup_attitude": "rad", "backup_velocity": "m/s", "backup_position": "m"}
    | {"solution_velocity": "m/s", "solution_position": "m", "receiver_clock_bias": "m", "receiver_clock_drift": "m/s"}
    | {name: kind.unit for name, kind in PARAMETERS.items()}
    | {name: unit for name, (unit, *_) in EXTRAS.items()}
    | {name: state.unit for name, state in SENSOR_STATES.items()}
    | {f"{prefix}{name}": unit for prefix in ("", "raw_", "corrected_") for name, unit, *_ in MOTION}
)


def unit_of(metric: str) -> str:
    """Return the SI unit of a metric, ``%`` or ``-`` of those that have none."""
    if metric in MISSION:
        return MISSION[metric].unit
    if metric in COUNTED:
        return {COUNTED[0]: "-", COUNTED[-1]: "s"}.get(metric, "m")
    if metric in STEERED or metric in (*RANKS, *RATES, *COVERAGE):
        return "%" if metric in STEERED else "-"
    if metric in LEVELS:
        return PROTECTED[metric.partition("_")[0]]
    if metric in NEES or metric in LIMITED:
        return "s" if metric in CONVERGENCE else "-"
    if metric in MODE_METRICS:
        return MODE_METRICS[metric]
    unit = ERROR_UNITS[split_metric(metric)[0]]
    return "dimensionless" if unit == "1" else unit


def known_metric(name: str) -> str:
    """Return the name of a metric; ValueError with what may be meant where it is none."""
    stated = re.fullmatch(r"[a-z][a-z_]*_error(_[a-z0-9]+)?", name)
    if name not in _NO_ERRORS and not (stated and split_metric(name)[0] in ERROR_UNITS):
        near = hint(name, (*_NO_ERRORS, "position_error_3d", "velocity_error_3d", "attitude_error_3d"))
        raise ValueError(f"{quoted(name)} is not a metric{near}")
    return name
