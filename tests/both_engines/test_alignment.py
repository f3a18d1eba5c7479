"""Alignment on the pad against its closed forms, and both engines against each other while the vehicle sways."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.covariance.history import covariance
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.kernels.transition import GYRO
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import prepare_hop, with_fields
from tests.standing import STILL, aligned, pad, prepared_case

DEG, G = np.pi / 180.0, 9.80665
ANDOYA = 69.29
ROLL, PITCH, YAW = range(3)
"""Of an upright vehicle: heading, tilt about its y axis (east), tilt about its z axis (north)."""


FINE = {"sensors.zero_velocity.sigma": "0.05 mm/s", "sensors.zero_velocity.jitter": "0.05 mm/s"}


def at_liftoff(scenario, latitude=0.0, duration=600.0):
    """Linear covariance at lift-off: one-sigma of attitude (3,) in deg, and by source."""
    history = covariance(prepared_case(scenario, latitude, duration))
    by_source = dict(zip(history.sources, np.sqrt(np.maximum(history.budget[-1, :, :3], 0.0)) / DEG, strict=True))
    return history.true_sigma[-1, :3] / DEG, by_source


def joined(*sigmas):
    """One-sigma of what several independent sources tell of one number."""
    return sum(sigma**-2.0 for sigma in sigmas) ** -0.5


def test_tilt_is_accelerometer_bias_over_gravity():
    # gyros without bias would tell the tilt about east by the Earth's vertical rate, e_N / (W sin L)
    unit = {**STILL, "accel.bias_repeatability": "2 mg", "gyro.bias_repeatability": "10 deg/h"}
    sigma, _ = at_liftoff(aligned("zero_velocity", imu=unit, **FINE), 45.0, 120.0)
    expected = 2e-3 / DEG  # 0.115 deg; 1 mg is a thousandth of 9.80665 m/s^2, g at 45 deg 9.806
    assert sigma[[PITCH, YAW]] == pytest.approx(joined(1.0, expected), rel=2e-3)


@pytest.mark.parametrize("latitude", [0.0, -38.6, 60.0])
def test_heading_is_east_gyro_bias_over_the_earths_horizontal_rate(latitude):
    bias = 0.5 * np.cos(latitude * DEG)  # deg/h
    sigma, _ = at_liftoff(
        aligned("zero_velocity", imu={**STILL, "gyro.bias_repeatability": f"{bias} deg/h"}, **FINE), latitude
    )
    expected = bias / 3600.0 / (OMEGA * np.cos(latitude * DEG))
    assert expected == pytest.approx(1.904, abs=1e-3)
    assert sigma[ROLL] == pytest.approx(joined(4.0, expected), rel=5e-3)


def test_two_mg_of_accelerometer_bias_add_three_tenths_of_a_degree_at_andoya():
    unit = {**STILL, "accel.bias_repeatability": "2 mg"}
    # a tilt that is known beforehand would tell the bias from it
    sigma, _ = at_liftoff(aligned("zero_velocity", imu=unit, **FINE, **{"initial.tilt": "4 deg"}), ANDOYA)
    expected = 2e-3 * np.tan(ANDOYA * DEG) / DEG
    assert expected == pytest.approx(0.30, abs=0.005)
    assert sigma[ROLL] == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize(
    ("duration", "latitude", "published"), [(600.0, 0.0, 0.28), (150.0, 0.0, 0.56), (600.0, ANDOYA, 0.79)]
)
def test_heading_by_random_walk_falls_with_the_root_of_time(duration, latitude, published):
    unit = {**STILL, "gyro.random_walk": "0.03 deg/sqrt(h)"}
    _, by_source = at_liftoff(aligned("zero_velocity", imu=unit, **FINE), latitude, duration)
    walk = 0.03 / 60.0 * DEG
    expected = walk / (OMEGA * np.cos(latitude * DEG) * np.sqrt(duration)) / DEG
    assert expected == pytest.approx(published, abs=0.005)
    weight = joined(4.0, expected) ** 2 / expected**2  # of the alignment, beside the start
    assert by_source["gyro random walk"][ROLL] == pytest.approx(weight * expected, rel=2e-2)


def test_white_motion_that_is_taken_for_none_tells_heading_by_a_parabola():
    """Velocity that grows by g W cos L psi t^2 / 2: the coefficient of t^2 of a parabola, sqrt(180 / n) sigma / T^2."""
    noise, duration = 0.05, 600.0
    moved = aligned("zero_velocity", imu=STILL, **{"sensors.zero_velocity.sigma": f"{noise} m/s",
                                                  "sensors.zero_velocity.jitter": f"{noise} m/s"})  # fmt: skip
    sigma, _ = at_liftoff(moved, 60.0, duration)
    slope = 0.5 * G * OMEGA * np.cos(60.0 * DEG)
    expected = noise * np.sqrt(180.0 / duration) / duration**2 / slope / DEG
    assert sigma[ROLL] == pytest.approx(expected, rel=2e-2)


def test_an_azimuth_gives_heading_to_its_bias_and_its_averaged_noise():
    seen = aligned("zero_velocity", "azimuth", imu=STILL, **{"sensors.azimuth.bias": "60 arcsec"})
    sigma, by_source = at_liftoff(seen, 45.0, 100.0)
    noise, bias = 20.0 / 3600.0 / 10.0, 60.0 / 3600.0
    assert by_source["azimuth noise"][ROLL] == pytest.approx(noise, rel=1e-2)
    assert by_source["azimuth bias"][ROLL] == pytest.approx(bias, rel=1e-2)
    assert sigma[ROLL] == pytest.approx(np.hypot(noise, bias), rel=1e-2)


def test_zero_rotation_tells_the_gyro_bias_along_the_earths_axis_to_its_random_walk():
    """Of the rates that gyros show while nothing turns, that along the axis of the Earth no attitude explains."""
    duration = 600.0
    unit = {**STILL, "gyro.random_walk": "0.03 deg/sqrt(h)", "gyro.bias_repeatability": "10 deg/h"}
    still = {"sensors.zero_rotation.sigma": "0.01 mrad", "sensors.zero_rotation.jitter": "0.01 mrad"}
    p = prepared_case(aligned("zero_rotation", imu=unit, **still), 50.0, duration)
    history = covariance(p)
    at = next(block.offset for block in p.layout.parameters if block.sensor == GYRO)
    # body axes: x up, y east, z north
    axis = np.array([np.sin(50.0 * DEG), 0.0, np.cos(50.0 * DEG)])
    found = np.sqrt(axis @ history.true_cov[-1, at : at + 3, at : at + 3] @ axis)
    assert found == pytest.approx(0.03 / 60.0 * DEG / np.sqrt(duration), rel=1e-2)


def test_a_known_position_is_known_to_its_survey_and_its_averaged_jitter():
    known = aligned("zero_velocity", "pad_position", imu=STILL, **FINE, **{"sensors.pad_position.survey": "5 cm"})
    history = covariance(prepared_case(known, 45.0, 100.0))
    noise = 0.01 / 10.0
    assert history.true_sigma[-1, 6:9] == pytest.approx(np.hypot(0.05, noise), rel=5e-3)
    assert history.formal_sigma[-1, 6:9] == pytest.approx(noise, rel=5e-2)


SWAY = json.dumps({"start": "start", "end": "liftoff", "ramp": "2 s", "modes": [
    {"frequency": "0.35 Hz", "axis": "y", "angle": "0.1 mrad", "lever": ["30 m", "0 m", "0 m"], "damping": 0.02},
    {"frequency": "1.1 Hz", "axis": "x", "angle": "0.3 mrad", "lever": ["0 m", "1 m", "0 m"]},
]})  # fmt: skip
NONE = {"zero_velocity": "0 m/s", "zero_rotation": "0 rad", "pad_position": "0 m"}
EVERY = ("zero_velocity", "zero_rotation", "pad_position", "azimuth")


@pytest.mark.parametrize("sensors", [("zero_velocity",), ("pad_position",), EVERY], ids=" ".join)
def test_a_sway_that_is_taken_for_none_is_the_same_error_in_both_engines(sensors):
    """The vehicle moves, the measurement says that it does not: in every run an error by the filter's own gains."""
    exact = {f"sensors.{name}.jitter": none for name, none in NONE.items() if name in sensors}
    start = {"tilt": "1e-6 deg", "heading": "1e-6 deg", "position": "1e-6 m", "velocity": "1e-6 m/s"}
    assumed = {"tilt": "1 deg", "heading": "4 deg", "position": "1 m", "velocity": "0.1 m/s"}
    known = {"initial": start, "filter.initial": assumed | {"clock_bias": "0 m", "clock_drift": "0 m/s"}}
    if "azimuth" in sensors:
        exact["sensors.azimuth.sigma"] = exact["sensors.zero_rotation.attitude"] = "1e-3 arcsec"
        # not what the filter assumes: rows that turn by 0.1 mrad would then tell as much as the measurement itself
        exact["filter.sensor_models"] = {
            "azimuth": {"sigma": "20 arcsec"}, "zero_rotation": {"sigma": "0.5 mrad", "attitude": "1 deg"}
        }  # fmt: skip
    p = prepared_case(aligned(*sensors, imu=STILL, **exact, **known), -38.6, 120.0, SWAY)
    history, block = covariance(p), run_block(p, 1, 0, 1)
    late = history.t > -90.0
    for first, size in ((0, 1e-8), (3, 1e-5), (6, 1e-5)):
        moved = history.mean[late, first : first + 3]
        assert np.abs(moved).max() > size, first
        np.testing.assert_allclose(
            block.err[0, late, first : first + 3], moved, rtol=0, atol=0.03 * np.abs(moved).max() + 1e-6
        )


@pytest.mark.parametrize("sensors", [("zero_velocity",), EVERY], ids=" ".join)
def test_both_engines_agree_at_lift_off(sensors):
    p = prepared_case(aligned(*sensors), -38.6, 120.0, SWAY)
    runs = 64
    history, block = covariance(p), run_block(p, 20261122, 0, runs)
    expected = np.hypot(history.true_sigma, history.mean)[-1]
    ratio = np.sqrt(np.mean(block.err[:, -1] ** 2, axis=0)) / expected
    low, high = np.sqrt(chi2.ppf([5e-4 / ratio.size, 1.0 - 5e-4 / ratio.size], runs) / runs)
    assert low < ratio.min(), ratio
    assert ratio.max() < high, ratio


def test_a_filter_that_assumes_no_more_than_the_sway_believes_that_the_sway_tells_it_heading():
    """Innovations are the sway itself: its direction seems to be known, to sigma / (v sqrt(n)). Nothing is learnt: the
    gain times what the sway leaves is of first order in heading too, and linear covariance has the nominal gain.
    """
    duration, rate, angle, arm = 240.0, 0.35, 1e-3, 20.0
    modes = [{"frequency": f"{rate} Hz", "axis": axis, "angle": f"{angle} rad", "lever": [f"{arm} m", "0 m", "0 m"],
              "damping": 0.02} for axis in "yz"]  # fmt: skip
    sway = json.dumps({"start": "start", "end": "liftoff", "modes": modes})
    speed, sigma = np.sqrt(2.0) * angle * arm * 2.0 * np.pi * rate, 0.03
    unit = {**STILL, "gyro.bias_repeatability": "5 deg/h"}  # so that the Earth's rate tells nothing
    assumed = {"sensors.zero_velocity.sigma": f"{sigma} m/s", "sensors.zero_velocity.jitter": "0 m/s"}
    p = prepared_case(aligned("zero_velocity", imu=unit, **assumed), 45.0, duration, sway)
    history, block = covariance(p), run_block(p, 3, 0, 32)
    seeming = sigma / (speed * np.sqrt(duration)) / DEG
    assert history.formal_sigma[-1, ROLL] / DEG == pytest.approx(joined(4.0, seeming), rel=0.15)
    rms = np.sqrt(np.mean(block.err[:, -1, ROLL] ** 2)) / DEG
    assert rms > 1.5 * joined(4.0, seeming)


def test_the_sensors_of_the_pad_end_with_it():
    p = prepared_case(aligned("zero_velocity"), 45.0, 30.0)
    assert p.devices[0].is_measuring.all()


def test_a_sensor_of_the_pad_in_a_flight_that_never_stands_is_an_input_error():
    with pytest.raises(InputError, match="at none of its times is the vehicle on the pad") as caught:
        prepare_hop(aligned("zero_velocity"))
    assert caught.value.records[0].path == "sensors.zero_velocity"


def test_a_flight_that_begins_with_its_lift_off_has_no_pad():
    with pytest.raises(ValueError, match=r"pad_hold.*begins with its lift-off"):
        with_fields(aligned("zero_velocity"), **{"trajectory.pad_hold": "0 s"})


def test_zero_rotation_needs_the_attitude_that_stays_as_a_state():
    with pytest.raises(ValueError, match="standing_attitude is an extra state"):
        with_fields(aligned("zero_rotation"), **{"filter.extra_states": []})


def test_a_vehicle_stands_where_it_stands_although_it_sways():
    swaying, still = (prepare_hop(aligned("pad_position"), pad(45.0, 60.0, sway)) for sway in (SWAY, ""))
    assert swaying.devices[0].is_measuring.all()
    np.testing.assert_allclose(swaying.devices[0].truth, still.devices[0].truth, atol=1e-6)
    moved = np.abs(swaying.reference.r_i - still.reference.r_i).max()
    assert moved > 2e-3


def closed_form(scenario, item):
    """What docs/alignment.md says of tilt and heading (rad) at lift-off of a case in still air."""
    gyro, accel, duration = scenario.imu.gyro, scenario.imu.accel, scenario.trajectory.pad_hold
    latitude, tilt = scenario.trajectory.site.latitude, accel.bias_repeatability / G
    if item == "tilt":
        return joined(scenario.initial.tilt, np.hypot(tilt, accel.rate_random_walk / G * np.sqrt(duration)))
    level = OMEGA * np.cos(latitude)
    parts = [
        gyro.bias_repeatability / level,
        tilt * np.tan(latitude),
        gyro.random_walk / (level * np.sqrt(duration)),
        accel.rate_random_walk / G / (level * np.sqrt(duration)),
        gyro.rate_random_walk * np.sqrt(duration / 3.0) / level,
        np.sqrt(12.0) * accel.random_walk / G / (level * duration**1.5),
    ]
    heading = np.linalg.norm(parts)
    return heading if "without a start" in item else joined(scenario.initial.heading, heading)


def test_the_lines_of_the_campaign_are_the_closed_forms():
    campaign = load(campaign_file("campaigns/world/alignment.yaml"), ())
    found = cases(campaign)
    assert {line.item for line in campaign.references} == {"tilt", "heading", "heading without a start"}
    for line in campaign.references:
        (case,) = [one for one in found if line.case.items() <= one.axes.items()]
        assert line.value == pytest.approx(closed_form(case.scenario, line.item) / DEG, rel=2e-3), line
