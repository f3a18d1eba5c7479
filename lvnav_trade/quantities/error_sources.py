"""Error sources: the key of their random draws, the label in error budgets, and the fields with their sigma.

A key must not change, because it determines the draws. A label may be reworded at any time.
"""

import re
from typing import NamedTuple

# Path of a field in a scenario, and the power of the sigma that it contains; `*`: every item of a tuple
Field = tuple[tuple[str, ...], int]

# Keys of draws that do not belong to a single source.
IMU_NOISE = "inertial unit white noise"
CLOCK_STEP, RANGE_NOISE, SOLUTION_NOISE, CLOCK_START, PHASE_NOISE = (
    "receiver clock",
    "range noise",
    "solution noise",
    "receiver clock start",
    "carrier-phase noise",
)


class Source(NamedTuple):
    """An error source.

    key : Key of its random draws.
    label : Name in error budgets.
    fields : Fields of a scenario with its sigma.
    """

    key: str
    label: str
    fields: tuple[Field, ...] = ()


def _linear(*paths: str) -> tuple[Field, ...]:
    fields = [tuple(path.split(".")) for path in paths]
    return tuple((field, 1) for field in fields)


_IMU = {
    "random walk": "random_walk",
    "bias repeatability": "bias_repeatability",
    "bias instability": "bias_instability",
    "rate random walk": "rate_random_walk",
    "scale factor": "scale_factor",
    "scale-factor drift": "scale_factor_drift",
    "misalignment": "misalignment",
    "nonlinearity": "nonlinearity",
    "quantisation": "quantisation",
}
_OTHERS = {
    "gyro g-sensitivity": _linear("imu.gyro.g_sensitivity"),
    "initial attitude": _linear("initial.tilt", "initial.heading"),
    "initial velocity": _linear("initial.velocity"),
    "initial position": _linear("initial.position"),
    "receiver clock start": _linear("receiver.clock.initial_bias", "receiver.clock.initial_drift"),
    # h0 and h-2 are variances
    "receiver clock": ((("receiver", "clock", "h0"), 2), (("receiver", "clock", "h_minus2"), 2)),
    "pseudorange noise": _linear("receiver.pseudorange_sigma"),
    "range-rate noise": _linear("receiver.range_rate_sigma"),
    "carrier-phase noise": _linear("receiver.carrier_phase_sigma"),
    "carrier ambiguity": _linear("receiver.carrier_ambiguity"),
    "position solution noise": _linear("receiver.solution.position_sigma"),
    "velocity solution noise": _linear("receiver.solution.velocity_sigma"),
    "solution position bias": _linear("receiver.solution.position_bias"),
    "solution velocity bias": _linear("receiver.solution.velocity_bias"),
    "range-rate offset": _linear("receiver.range_rate_offset"),
    "range-rate instability": _linear("receiver.range_rate_instability"),
    "multipath": _linear("receiver.multipath"),
    "latency error": _linear("receiver.latency_error"),
    "latency jitter": _linear("receiver.latency_sigma"),
    "lever arm": _linear("receiver.lever_error"),
    "troposphere scale": _linear("atmosphere.troposphere_scale"),
    "ionosphere scale": _linear("atmosphere.ionosphere_scale"),
    "gravity disturbance": _linear("gravity.sigma"),
    "satellite clock and ephemeris": _linear("constellation.range_error"),
    "system time offset": _linear("constellation.time_offset"),
    "recorded receiver error": (),
    "wild samples": (),
}


def _all_sources() -> dict[str, Source]:
    sources = {}
    for label, sensor in (("gyro", "gyro"), ("accelerometer", "accel")):
        for term, field in _IMU.items():
            key = f"{label} {term}"
            sources[key] = Source(key, key, _linear(f"imu.{sensor}.{field}"))
    for key, fields in _OTHERS.items():
        sources[key] = Source(key, key, fields)
    return sources


# Every source except those of sensors, by key
SOURCES = _all_sources()


def label_of(key: str) -> str:
    """Return the label of a source in error budgets; for an error of a sensor that is the key."""
    return SOURCES[key].label if key in SOURCES else key


def fields_of(label: str) -> tuple[Field, ...]:
    """Return the fields with the sigma of the source of a label; an empty tuple if there are none.

    The fields of an IMU of an array, such as `unit 2 gyro random walk`, are those of its card.
    """
    unit_match = re.fullmatch(r"unit (\d+) (.+)", label)
    if unit_match:
        index = int(unit_match[1]) - 1
        place = ("imu", "units", str(index))
        card_fields = fields_of(unit_match[2])
        return tuple(((*place, *path[1:]), power) for path, power in card_fields)
    for source in SOURCES.values():
        if source.label == label:
            return source.fields
    return ()
