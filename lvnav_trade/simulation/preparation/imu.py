"""True IMU of a case: error terms, increments, deterministic profiles, and the IMUs of an array."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.gnss.fault_cards import (
    AccelBiasStep,
    AccelScaleFactorStep,
    AnyFault,
    GyroBiasStep,
    GyroScaleFactorStep,
)
from lvnav_trade.gnss.faults import periods
from lvnav_trade.imu.array import ImuSet, imu_error_terms, list_triads
from lvnav_trade.imu.equivalent import equivalent
from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.kernels.random import source_word
from lvnav_trade.kernels.transition import ACCEL, CONSTANT, GYRO, OWN_0
from lvnav_trade.quantities.conditions import FlightProfile
from lvnav_trade.quantities.error_sources import IMU_NOISE
from lvnav_trade.quantities.per_axis import axes
from lvnav_trade.quantities.records import Reference
from lvnav_trade.quantities.state_layout import ErrorTerm, StateLayout
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.imu_arrays import (
    band_limited_increments,
    combined_increments,
    elements,
    imu_array_of,
    noise_sigmas,
)
from lvnav_trade.simulation.preparation.imu_inputs import ImuArray, ImuTruth
from lvnav_trade.simulation.preparation.redundancy_plan import Profile, add_redundancy
from lvnav_trade.simulation.preparation.true_flight import TrueFlight
from lvnav_trade.trajectory.disturbances import disturbance

_STEPS = {
    "gyro_bias_step": (GYRO, CONSTANT),
    "accel_bias_step": (ACCEL, CONSTANT),
    "gyro_scale_factor_step": (GYRO, OWN_0),
    "accel_scale_factor_step": (ACCEL, OWN_0),
}
# A step is a profile that grows within this time (s), far less than an IMU tick.
STEP = 1e-6
_ROUNDING = 1e-6  # of a tick


class TrueImu(NamedTuple):
    """True IMU of a case.

    terms : Error terms of all IMUs, then of the gravity disturbance.
    unit : The IMU as arrays; for an array, the combined triad.
    units : IMUs of an array and their combination; None for one IMU.
    """

    terms: tuple[ErrorTerm, ...]
    unit: ImuTruth
    units: ImuArray | None


def imu_of(scenario: Scenario, flight: TrueFlight, layout: StateLayout) -> TrueImu:
    """Return the true IMU of a case.

    Parameters
    ----------
    scenario, flight
        Validated model of the case, and its true flight.
    layout
        States of the filter, which may include differences of two IMUs.
    """
    ref = flight.reference
    flight_profile = flight.trajectory.flight_profile
    card = scenario.imu
    terms = (*imu_error_terms(card), *disturbance(scenario.gravity))
    units = imu_array_of(scenario, ref, flight_profile, flight.devices, layout)
    profiles = profiles_of(card, scenario.faults, flight_profile)
    planned_handover_tick = hand_over_tick(card, ref, flight_profile)
    units = add_redundancy(card, units, ref, profiles, planned_handover_tick)
    unit = imu_truth_of(scenario, ref, terms, flight_profile, units)
    return TrueImu(terms, unit, units)


def hand_over_tick(card: ImuCard | ImuSet, ref: Reference, flight_profile: FlightProfile) -> int:
    """Return the first tick after the hand-over of a prime IMU at a given time; -1 without.

    Parameters
    ----------
    card
        Card of the IMU or of the array.
    ref
        True motion at the ticks.
    flight_profile
        Conditions of the trajectory.
    """
    if isinstance(card, ImuCard) or card.hand_over is None:
        return -1
    t_hand_over = flight_profile.time(card.hand_over, "imu.hand_over")
    seconds = t_hand_over - ref.t[0]
    return math.ceil(seconds * card.rate - _ROUNDING)


def profiles_of(card: ImuCard | ImuSet, faults: Sequence[AnyFault], flight_profile: FlightProfile) -> list[Profile]:
    """Return the deterministic errors of the IMUs: warm-up ramps, and faults that begin and end with a step.

    Parameters
    ----------
    card
        Card of the IMU or of the array.
    faults
        Faults of the case; only those of IMUs are read.
    flight_profile
        Conditions of the trajectory.

    Returns
    -------
    list of Profile
        Sensor (2 triad + sensor), driver, start and end (s since lift-off), amplitude by axis (SI).
    """
    if isinstance(card, ImuCard):
        owners = [0]
        units: Sequence[ImuCard] = (card,)
    else:
        owners = [triad.unit for triad in list_triads(card)]
        units = card.units
    profiles: list[Profile] = []
    for triad, owner in enumerate(owners):
        unit = units[owner]
        ramps = ((GYRO, unit.gyro.temperature), (ACCEL, unit.accel.temperature))
        for sensor, ramp in ramps:
            if ramp is not None:
                code = 2 * triad + sensor
                profiles.append((code, CONSTANT, ramp.start, ramp.end, ramp.amplitude))
    for number, fault in enumerate(faults):
        if isinstance(fault, GyroBiasStep | AccelBiasStep | GyroScaleFactorStep | AccelScaleFactorStep):
            sensor, driver = _STEPS[fault.kind]
            first_triad = owners.index(fault.unit - 1)
            code = 2 * first_triad + sensor
            x, y, z = fault.size
            step = (x, y, z)
            opposite_step = (-x, -y, -z)
            for start, end in periods(number, fault, flight_profile):
                begin = start if math.isfinite(start) else flight_profile.begin(start) - STEP
                profiles.append((code, driver, begin, begin + STEP, step))
                if math.isfinite(end):
                    profiles.append((code, driver, end, end + STEP, opposite_step))
    return profiles


def imu_truth_of(
    scenario: Scenario,
    ref: Reference,
    terms: Sequence[ErrorTerm],
    flight_profile: FlightProfile,
    units: ImuArray | None = None,
) -> ImuTruth:
    """Return the true IMU as arrays for the kernels.

    Parameters
    ----------
    scenario, ref
        Validated model of the case; true motion and ideal increments.
    terms
        Error terms of all IMUs, then of the gravity disturbance.
    flight_profile, units
        Conditions of the trajectory; IMUs of an array, whose combined triad is returned, None for one IMU.
    """
    card = scenario.imu
    equivalent_card = equivalent(card)
    inertial = [term for term in terms if term.sensor >= 0]
    dt = 1.0 / card.rate
    process_ticks = max(1, round(card.rate / card.process_rate))
    step = process_ticks * dt
    walk = np.array([_step_noise(term, step) for term in terms]).reshape(-1, 3)
    if units is None:
        ideal_increments = band_limited_increments(ref, equivalent_card, scenario.faults, flight_profile)
        dtheta, dvel = elements(
            ideal_increments, equivalent_card, np.eye(3), 0, scenario.faults, flight_profile, ref.t[1:]
        )
    else:
        dtheta, dvel = combined_increments(units, dt)
    profiles = profiles_of(card, scenario.faults, flight_profile)
    profile_sensor, profile_driver, profile_start, profile_end, amplitudes = _columns(profiles, 5)
    has_biases_only = all(driver == CONSTANT for driver in [*(term.driver for term in inertial), *profile_driver])
    return ImuTruth(
        dt=dt,
        noise_source=source_word(IMU_NOISE),
        biases_only=has_biases_only,
        dtheta=dtheta,
        dvel=dvel,
        white=noise_sigmas(equivalent_card, dt),
        process_ticks=process_ticks,
        is_drifting=bool(np.any(walk > 0.0)) or bool(profiles),
        sigma=np.array([axes(term.sigma) for term in terms], dtype=float).reshape(-1, 3),
        decay=np.array([math.exp(-step / term.time_constant) for term in terms]),
        walk=walk,
        sources=np.array([source_word(f"{term.name} {term.term_index}") for term in terms], dtype=np.uint64),
        sensors=np.array([term.sensor for term in inertial], dtype=np.int64),
        drivers=np.array([term.driver for term in inertial], dtype=np.int64),
        profile_sensor=np.array(profile_sensor, dtype=np.int64),
        profile_driver=np.array(profile_driver, dtype=np.int64),
        profile_start=np.array(profile_start, dtype=float),
        profile_end=np.array(profile_end, dtype=float),
        profile=np.array(amplitudes, dtype=float).reshape(len(profiles), 3),
        gravity=len(inertial) if len(terms) > len(inertial) else -1,
        start=float(ref.t[0]),
    )


def _columns(rows: Sequence[tuple[Any, ...]], n_column: int) -> list[list[Any]]:
    """Return the columns of a table; empty columns if it has no rows."""
    return [[row[column] for row in rows] for column in range(n_column)]


def _step_noise(term: ErrorTerm, step: float) -> list[float]:
    """Return the sigma by axis of the noise that drives an error term over a step (s).

    A random walk grows by w sqrt(step). A Gauss-Markov process stays stationary with s sqrt(1 - exp(-2 step / T)).
    """
    decayed_share = -math.expm1(-2.0 * step / term.time_constant)
    root_share = math.sqrt(decayed_share)
    root_step = math.sqrt(step)
    pairs = zip(axes(term.walk), axes(term.sigma), strict=True)
    return [math.hypot(walk * root_step, sigma * root_share) for walk, sigma in pairs]
