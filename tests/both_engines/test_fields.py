"""Every field of the cards that the engines read changes a result, or its value is refused."""

from __future__ import annotations

from functools import lru_cache
from typing import get_args

import numpy as np
import pytest
from pydantic import BaseModel

from lvnav_trade.covariance.history import covariance
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.gnss.constellation import CombinedConstellation
from lvnav_trade.gnss.delay_cards import AtmosphereCard
from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.scenario.scenario import InitialErrors, Scenario
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import LOOSE, loaded, prepare_hop, with_fields

# What names a card and says where it is from; both stand in the report, no engine reads them.
LABELS = {"name", "source", "resources", "assumed", "second_hand"}

# Hearing and tracking: tests/gnss/test_reception.py walks these cards, the sky shows all that they do.
HEARING = {"antennas", "link", "loops", "tracking"}
# Models of delays: tests/delays walks their fields, tests/simulation/preparation/signals/test_atmospheric_delays.py
# what engines
# make of them.
DELAYS = {"corrections"}
# Tables of factors on noise: tests/quantities/test_shared_cards.py,
# tests/simulation/preparation/signals/test_noise.py walk their fields.
NOISE = {"noise_by"}
# Noise of the carrier, of a receiver that smooths its ranges: tests/simulation/preparation/signals/test_smoothing.py.
PHASE = {
    "carrier_phase_sigma", "carrier_ambiguity", "cycle_slips", "ambiguity", "delayed_state", "previous_noise",
}  # fmt: skip
# What tunes and reports a filter: tests/filters/test_tuning, test_residuals, test_backup.
TUNING = {
    "as_noise",
    "transition_rate",
    "underweighting",
    "fading_memory",
    "h_infinity",
    "region_noise",
    "process_noise_by",
    "backup",
}
# Flicker noise by fitted processes: tests/imu/test_error_model.py walks its fields.
FITTED = {"instability_fit"}
# A recording in a file: tests/gnss/test_recorded_errors.py walks its fields.
RECORDED = {"error_table"}
# A model of the vehicle and its attitude reference: tests/simulation/preparation/test_vehicle_model.py walks them on
# such a filter.
MODELLED = {"envelope", "report_imu_samples"}
# Models of sensors: tests/sensors/test_altimeter.py, tests/simulation/preparation/test_vehicle_model.py.
SENSORS = {"sensor_models"}
# States of a difference of two units: tests/sensors/test_imu_difference.py.
RELATIVE = {f"{kind}_relative_bias{end}" for kind in ("gyro", "accel") for end in ("", "_walk", "_correlation")}
# Policies: walked in tests/filters/test_{late,feedforward,monitor}.py, tests/campaign/test_gains.py,
# tests/simulation/preparation/signals/test_clocks.py, which walks the filter's clock too; tests/filters/integrity.
POLICIES = {
    "delay_compensation", "feedback", "logic", "integrity", "init", "gains", "reference_satellite", "iterations",
}  # fmt: skip

RAMP = {"start": "1 s", "end": "20 s", "amplitude": ["10 deg/h", "0 deg/h", "5 deg/h"]}
ACCEL_RAMP = {"start": "1 s", "end": "20 s", "amplitude": ["1 mg", "0 mg", "2 mg"]}
IMU = {
    "gyro.rate_random_walk": "1 deg/h/sqrt(h)", "gyro.bias_instability": "1 deg/h", "gyro.nonlinearity": "100 ppm",
    "gyro.quantisation": "1e-6 rad", "gyro.bandwidth": "100 Hz", "gyro.temperature": RAMP,
    "accel.nonlinearity": "300 ppm", "accel.quantisation": "1 mm/s", "accel.bandwidth": "100 Hz",
    "accel.temperature": ACCEL_RAMP,
}  # fmt: skip
RECEIVER = {
    "rate": "2 Hz", "lever_b": ["1 m", "0.5 m", "-0.3 m"], "latency_error": "2 ms", "multipath": "1 m", "channels": 32,
    "range_rate_offset": "0.1 m/s", "range_rate_instability": "0.1 m/s",
    "solution.position_bias": "2 m", "solution.velocity_bias": "0.1 m/s",
}  # fmt: skip
OWN_IMU = {
    "gyro_random_walk": "0.05 deg/sqrt(h)", "accel_random_walk": "0.1 mg/sqrt(Hz)", "gyro_bias": "2 deg/h",
    "gyro_bias_walk": "1 deg/h/sqrt(h)", "gyro_bias_time": "60 s", "accel_bias": "3 mg",
    "accel_bias_walk": "1 mg/sqrt(h)", "accel_bias_time": "60 s", "gyro_scale_factor": "500 ppm",
    "accel_scale_factor": "2000 ppm", "gyro_misalignment": "1 mrad", "accel_misalignment": "1 mrad",
    "gyro_g_sensitivity": "1 deg/h/g", "gyro_nonlinearity": "200 ppm", "accel_nonlinearity": "600 ppm",
    "gyro_scale_factor_walk": "1 percent/sqrt(h)", "accel_scale_factor_walk": "1 percent/sqrt(h)",
}  # fmt: skip
OWN_RECEIVER = {
    "pseudorange_sigma": "3 m", "range_rate_sigma": "0.2 m/s", "position_sigma": "3 m", "velocity_sigma": "0.2 m/s",
    "clock_h0": 2e-20, "clock_h_minus2": 3e-23, "range_bias": "2 m", "range_bias_time": "50 s",
    "time_offset": "3 m", "time_offset_time": "500 s", "range_rate_offset": "0.2 m/s", "range_rate_offset_time": "90 s",
    "timing": "3 ms", "timing_time": "500 s",
    "troposphere_scale": "10 percent", "troposphere_scale_time": "500 s", "ionosphere_scale": "30 percent",
    "ionosphere_scale_time": "500 s", "position_bias": "3 m", "position_bias_time": "30 s",
    "velocity_bias": "0.2 m/s", "velocity_bias_time": "30 s",
}  # fmt: skip
OWN_INITIAL = {
    "tilt": "0.2 deg", "heading": "0.2 deg", "position": "5 m", "velocity": "0.1 m/s", "clock_bias": "500 m",
    "clock_drift": "5 m/s",
}  # fmt: skip
CORRECTIONS = {"troposphere": {"kind": "spilker"}, "ionosphere": {"kind": "content"}}
FILTER = {
    "extra_states": [
        "gyro_scale_factor", "accel_scale_factor", "gyro_misalignment", "accel_misalignment", "gyro_g_sensitivity",
        "gyro_nonlinearity", "accel_nonlinearity",
        "range_bias", "time_offset", "range_rate_offset", "timing", "troposphere_scale", "ionosphere_scale",
        "position_bias", "velocity_bias",
    ],
}  # fmt: skip

# Another value for every field; a field without one fails the test below.
OTHER = {
    "imu": {
        "rate": "100 Hz", "process_rate": "5 Hz",
        "gyro.bandwidth": "20 Hz", "gyro.misalignment": "1 mrad", "gyro.random_walk": "0.1 deg/sqrt(h)",
        "gyro.rate_random_walk": "2 deg/h/sqrt(h)", "gyro.bias_repeatability": "2 deg/h",
        "gyro.bias_instability": "2 deg/h", "gyro.instability_time": "30 s", "gyro.g_sensitivity": "1 deg/h/g",
        "gyro.scale_factor": "500 ppm", "gyro.scale_factor_drift": "1 percent/sqrt(year)",
        "gyro.nonlinearity": "200 ppm",
        "gyro.full_scale": "300 deg/s", "gyro.quantisation": "2e-6 rad", "gyro.temperature.start": "0 s",
        "gyro.temperature.end": "15 s", "gyro.temperature.amplitude": ["9 deg/h", "0 deg/h", "5 deg/h"],
        "accel.bandwidth": "20 Hz", "accel.misalignment": "1 mrad", "accel.random_walk": "0.2 mg/sqrt(Hz)",
        "accel.rate_random_walk": "2 mg/sqrt(h)", "accel.bias_repeatability": "3 mg", "accel.bias_instability": "1 mg",
        "accel.instability_time": "30 s", "accel.scale_factor": "500 ppm",
        "accel.scale_factor_drift": "1 percent/sqrt(year)", "accel.nonlinearity": "200 ppm", "accel.full_scale": "20 g",
        "accel.quantisation": "2 mm/s", "accel.temperature.start": "0 s", "accel.temperature.end": "15 s",
        "accel.temperature.amplitude": ["2 mg", "0 mg", "2 mg"],
    },
    "receiver": {
        "rate": "0.5 Hz", "mask": "40 deg", "mask_height": "100 km", "latency": "0.1 s", "latency_error": "4 ms",
        "latency_per_satellite": "10 ms", "latency_sigma": "3 ms", "multipath": "3 m", "multipath_time": "20 s",
        "lever_error": "0.5 m", "lever_b": ["1 m", "0.5 m", "0.3 m"], "channels": 5,
        "range_rate_offset": "0.2 m/s", "range_rate_instability": "0.2 m/s", "range_rate_instability_time": "9 s",
        "frequencies": "L1_L5", "doppler_interval": "30 ms",
        "pseudorange_sigma": "3 m", "range_rate_sigma": "0.2 m/s", "solution.kind": "bancroft",
        "solution.position_bias": "3 m", "solution.velocity_bias": "0.3 m/s", "solution.bias_time": "20 s",
        "solution.position_sigma": "4 m", "solution.velocity_sigma": "0.3 m/s", "clock.h0": 2e-19,
        "clock.h_minus2": 2e-20, "clock.initial_bias": "100 m", "clock.initial_drift": "1 m/s",
    },
    "filter": {
        "measurements": [], "extra_states": ["gyro_scale_factor"], "covariance_rate": "5 Hz", "update_rate": "2 Hz",
        "strapdown.algorithm": "summed", "strapdown.ratio": 2, "mechanisation": "earth",
        "consider": ["gyro_scale_factor"], "neglect": ["accel_bias"], "update": "joseph", "transition_order": 1,
        "algorithm": "unscented",
        "gate": 1.5, "gravity": "point", "attitude_noise": "0.1 deg/sqrt(h)", "velocity_noise": "1 mg/sqrt(Hz)",
        "position_noise": "1 m/sqrt(s)",
        "imu.gyro_random_walk": "0.06 deg/sqrt(h)", "imu.accel_random_walk": "0.2 mg/sqrt(Hz)",
        "imu.gyro_bias": "3 deg/h", "imu.gyro_bias_walk": "2 deg/h/sqrt(h)", "imu.gyro_bias_time": "30 s",
        "imu.accel_bias": "4 mg", "imu.accel_bias_walk": "2 mg/sqrt(h)", "imu.accel_bias_time": "30 s",
        "imu.gyro_scale_factor": "600 ppm", "imu.accel_scale_factor": "3000 ppm", "imu.gyro_misalignment": "2 mrad",
        "imu.accel_misalignment": "2 mrad", "imu.gyro_g_sensitivity": "2 deg/h/g",
        "imu.gyro_nonlinearity": "400 ppm", "imu.gyro_full_scale": "300 deg/s", "imu.accel_nonlinearity": "900 ppm",
        "imu.accel_full_scale": "20 g", "imu.gyro_scale_factor_walk": "2 percent/sqrt(h)",
        "imu.accel_scale_factor_walk": "2 percent/sqrt(h)",
        "receiver.pseudorange_sigma": "4 m", "receiver.range_rate_sigma": "0.3 m/s", "receiver.position_sigma": "4 m",
        "receiver.velocity_sigma": "0.3 m/s", "receiver.clock_h0": 2e-19, "receiver.clock_h_minus2": 3e-22,
        "receiver.range_bias": "3 m", "receiver.range_bias_time": "40 s", "receiver.time_offset": "4 m",
        "receiver.time_offset_time": "400 s",
        "receiver.range_rate_offset": "0.4 m/s", "receiver.range_rate_offset_time": "50 s",
        "receiver.timing": "4 ms", "receiver.timing_time": "400 s",
        "receiver.troposphere_scale": "20 percent", "receiver.troposphere_scale_time": "400 s",
        "receiver.ionosphere_scale": "20 percent", "receiver.ionosphere_scale_time": "400 s",
        "receiver.position_bias": "4 m", "receiver.position_bias_time": "20 s", "receiver.velocity_bias": "0.3 m/s",
        "receiver.velocity_bias_time": "20 s",
        "initial.tilt": "0.3 deg", "initial.heading": "0.3 deg", "initial.position": "6 m",
        "initial.velocity": "0.2 m/s", "initial.clock_bias": "600 m", "initial.clock_drift": "6 m/s",
    },
    "initial": {"tilt": "0.2 deg", "heading": "0.1 deg", "position": "2 m", "velocity": "0.02 m/s"},
}  # fmt: skip
CARDS = {"imu": ImuCard, "receiver": ReceiverCard, "filter": FilterCard, "initial": InitialErrors}


def leaves(model, before=""):
    """Yield the dotted names of all fields of a card and the cards within, labels left out."""
    for name, field in model.model_fields.items():
        within = [a for a in (field.annotation, *get_args(field.annotation)) if isinstance(a, type)]
        inner = [a for a in within if issubclass(a, BaseModel)]
        if (
            name in DELAYS | NOISE | PHASE | TUNING | FITTED | RECORDED | POLICIES | MODELLED | SENSORS | RELATIVE
            or ((model is ReceiverCard and name in HEARING) or (model is FilterCard and name == "clock"))
            or (name in LABELS and not before)
        ):
            continue
        if inner:
            yield from leaves(inner[0], f"{before}{name}.")
        else:
            yield before + name


FIELDS = [(card, name) for card, model in CARDS.items() for name in leaves(model)]


@lru_cache(maxsize=2)
def base(coupling):
    """A scenario in which every error, model and state is there."""
    scenario = loaded(*([LOOSE] if coupling == "loose" else []))
    gps = scenario.constellation
    galileo = loaded("base.constellation=constellations/galileo_24").constellation.model_dump(mode="json")
    parts = {
        "imu": with_fields(scenario.imu, **IMU),
        "receiver": with_fields(scenario.receiver, **RECEIVER),
        "filter": with_fields(
            scenario.filter, **FILTER, imu=OWN_IMU, receiver=OWN_RECEIVER, initial=OWN_INITIAL, consider=["gyro_bias"]
        ),
        "atmosphere": AtmosphereCard(troposphere={"kind": "ray_traced"}, ionosphere={"kind": "content"}),
        "constellation": CombinedConstellation(parts=[gps.model_dump(mode="json"), galileo]),
    }
    parts["filter"] = with_fields(parts["filter"], corrections=CORRECTIONS)
    return scenario.model_copy(update=parts)


def numbers(scenario):
    """Bytes of everything that the engines say about the scenario on the short flight."""
    prepared_case = prepare_hop(scenario)
    block, cov = run_block(prepared_case, 1, 0, 8), covariance(prepared_case)
    arrays = (
        block.err,
        block.sigma,
        block.nees,
        block.innovation,
        cov.formal_sigma,
        cov.true_sigma,
        cov.mean,
        cov.budget,
    )
    return b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)


@lru_cache(maxsize=2)
def base_numbers(coupling):
    return numbers(base(coupling))


def coupling_of(name):
    solution = name.startswith(("solution.", "receiver.position_", "receiver.velocity_"))
    return "loose" if solution else "tight"


@pytest.mark.parametrize(("card", "name"), FIELDS, ids=[f"{card}.{name}" for card, name in FIELDS])
def test_a_field_changes_a_result_or_is_refused(card, name):
    assert name in OTHER[card], "give this new field another value here"
    if (card, name) == ("receiver", "rate"):  # which must be in step with the filter's: a matter of the whole campaign
        with pytest.raises(InputError, match="receiver rate"):
            loaded(f"base.receiver.rate={OTHER[card][name]}")
        return
    coupling = coupling_of(name)
    scenario = base(coupling)
    try:
        part = with_fields(getattr(scenario, card), **{name: OTHER[card][name]})
        other = numbers(Scenario.model_validate(scenario.model_copy(update={card: part}).model_dump(mode="json")))
    except ValueError:
        return
    changes = other != base_numbers(coupling)  # not in the assertion: the bytes are long
    assert changes


def test_every_other_value_belongs_to_a_field():
    known = set(FIELDS)
    assert {(card, name) for card, values in OTHER.items() for name in values} == known


@pytest.mark.parametrize(
    "settings", [{"frame": "ecef"}, {"frame": "inertial"}, {"frame": "orbital"}, {"frame": "pad"}, {"diverged": "1 m"}]
)
def test_a_field_of_the_scenario_itself_changes_a_result(settings):
    scenario = base("tight")
    prepared_case = prepare_hop(scenario), prepare_hop(with_fields(scenario, **settings))
    one, two = (run_block(p, 1, 0, 8) for p in prepared_case)
    assert not np.array_equal(one.err, two.err) or not np.array_equal(one.failed, two.failed)
