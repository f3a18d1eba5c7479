"""Every metric that a requirement or a statement can name, with its unit and meaning."""

from typing import NamedTuple

from lvnav_trade.campaign.definition.metric_names import (
    CONVERGENCE,
    COUNTED,
    COVERAGE,
    INSIDE,
    MOVED,
    NEES,
    RANKS,
    unit_of,
)
from lvnav_trade.campaign.definition.schema import METRICS
from lvnav_trade.layout import AVAILABILITY, BACKUP, EXTRAS, LEVELS, MISSION, MOTION, PARAMETERS, split_metric
from lvnav_trade.observables.sensors import SENSOR_STATES

BOTH, STATEMENTS = "requirements, statements", "statements"
_QUANTITIES = {
    "attitude": "attitude, small rotation from estimate to truth",
    "velocity": "velocity over the ground",
    "position": "position",
}
_MISSION = {
    "semi_major_axis_error": "semi-major axis, averaged over a revolution",
    "eccentricity_error": "eccentricity, averaged",
    "eccentricity_vector_error": "eccentricity vector, length of the difference",
    "perigee_error": "height of perigee, averaged",
    "apogee_error": "height of apogee, averaged",
    "inclination_error": "inclination, averaged",
    "node_error": "right ascension of the ascending node, averaged",
    "correction_delta_v": "least sum of impulses that corrects the orbit",
    "impact_error": "instantaneous point of impact, distance",
    "impact_error_down": "point of impact along the velocity over the ground",
    "impact_error_cross": "point of impact across it",
}
_OTHERS = {
    COUNTED[0]: "satellites that are tracked",
    "troposphere": "tropospheric delay of the signals",
    "troposphere_left": "tropospheric delay after the filter's correction",
    "ionosphere": "ionospheric delay of the signals",
    "ionosphere_left": "ionospheric delay after the filter's correction",
    "troposphere_change": "change of the tropospheric delay from an epoch to the next",
    "troposphere_left_change": "the same after the filter's correction",
    "ionosphere_change": "change of the ionospheric delay from an epoch to the next",
    "ionosphere_left_change": "the same after the filter's correction",
    "troposphere_change_height": "altitude at which the change of the tropospheric delay is largest",
    "air_crossing_height": "altitude at which climb rate times density of the air is largest",
    "reacquisition_time": "time until lost satellites are tracked again",
    RANKS[0]: "least number of observable states of any stretch",
    RANKS[1]: "least number of states about which any stretch has more than the tolerance of information",
    **dict.fromkeys(MOVED, "reduction of the nozzle's movement by the filtered rate"),
    **dict.fromkeys(INSIDE, "part of ticks with the motion within the envelope that is assumed of it"),
    **{name: f"normalised error squared of {name[:-5]}, per degree of freedom" for name in NEES},
    **{name: f"time until the error of {name.split('_')[0]} stays below a limit" for name in CONVERGENCE},
    **{
        name: f"share of time for which the protection level of {name.split('_')[0]} keeps a limit"
        for name in AVAILABILITY
    },
    **{name: f"share of runs with {name.split('_')[0]} within three of the filter's sigmas" for name in COVERAGE},
    "mode_entry_time": "time from the start of a phase until the filter's logic enters a mode",
    "mode_entry_share": "share of runs in which the filter's logic enters a mode",
    "mode_duration": "time that the filter's logic is in a mode",
    "mode_changes": "how often the filter's logic enters a mode",
}


class Known(NamedTuple):
    """A metric: name, SI unit, meaning, and which blocks of a campaign can name it."""

    metric: str
    unit: str
    meaning: str
    named_by: str


def known_metrics() -> list[Known]:
    """Return every metric that can be named: those of requirements first, then those of statements alone.

    ``_x`` stands for any axis of the reporting frame, of the body, or of a sensor.
    """
    found = [Known(name, unit_of(name), _meaning(name), BOTH) for name in METRICS]
    found += [Known(name, unit_of(name), meaning, STATEMENTS) for name, meaning in _OTHERS.items()]
    states = {name: kind.unit for name, kind in PARAMETERS.items()}
    states |= {name: unit for name, (unit, *_) in EXTRAS.items()} | {name: s.unit for name, s in SENSOR_STATES.items()}
    states |= {name: unit for name, unit, *_ in MOTION} | {"clock_bias": "m", "clock_drift": "m/s"}
    return found + [
        Known(f"{name}_error_x", unit, f"estimate of {name.replace('_', ' ')}, where it is a state", STATEMENTS)
        for name, unit in states.items()
    ]


def _meaning(name: str) -> str:
    if name in MISSION:
        return f"error of the mission: {_MISSION[name]}"
    if name in LEVELS:
        return f"protection level of {name.split('_')[0]}, the box of three axes"
    quantity, axis = split_metric(name)
    of_backup = " of the strapdown that is never corrected" if quantity.startswith(BACKUP) else ""
    size = "length of the three-axis error" if axis == "3d" else f"{axis} component of the error"
    return f"{size} of {_QUANTITIES[quantity.removeprefix(BACKUP)]}{of_backup}"
