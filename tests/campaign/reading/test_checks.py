"""What must fit together is checked where it was written: rates, events, times of faults."""

from __future__ import annotations

from typing import Any

import pytest

from lvnav_trade import api
from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading import flights
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.quantities.errors import InputError, Mistake

RANGES, SOLUTION = "[pseudorange, range_rate]", "[position, velocity]"
EVENTS = {"liftoff": 0.0, "stage1_cutoff": 150.0, "injection": 540.0}  # the climb holds 60 s and coasts 20 s


def reported(study: Any, sets: tuple[str, ...] = (), name: str = "campaign.yaml") -> list[str]:
    """Return what is wrong with the study's campaign in a flight of these events."""
    campaign = load(name, sets)
    found = cases(campaign)
    return [str(mistake) for mistake in flights.mistakes(campaign, found, {case.id: EVENTS for case in found})]


def with_fault(study: Any, start: str, duration: str = "5 s") -> None:
    text = f"  imu: imu/good\n  faults: [{{start: {start}, duration: {duration}, kind: satellite_outage}}]"
    study.edit("campaign.yaml", "  imu: imu/good", text)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ("stage1_cutof + 20 s", "'stage1_cutof + 20 s': no event 'stage1_cutof' (did you mean 'stage1_cutoff'?)"),
        ("injection + 30 s", "'injection + 30 s' is 570 s, at or after the end of the flight (560 s)"),
        ("liftoff - 100 s", "'liftoff - 100 s' is -100 s: the fault is over before the flight begins (-60 s)"),
    ],
)  # fmt: skip
def test_a_fault_that_does_not_fit_the_flight_is_reported_at_its_start(study, start: str, message: str) -> None:
    with_fault(study, start)
    assert reported(study) == [f"campaign.yaml:6:20: base.faults.0.start: {message}"]


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ("stage1_cutoff + 20", "'20' has no unit; write it as a quantity in a unit of time (s, ms, min)"),
        ("stage1_cutoff + 20 deg", "'20 deg' has the wrong unit; expected time (s, ms, min)"),
        ("5 furlongs", "'5 furlongs' has no unit that is known ('furlongs'); expected time (s, ms, min)"),
    ],
)
def test_a_start_of_a_fault_with_a_wrong_unit_is_refused_without_a_flight(study, start: str, message: str) -> None:
    with_fault(study, start)
    with pytest.raises(InputError) as caught:
        load(study.path)
    assert str(caught.value) == f"campaign.yaml:6:20: base.faults.0.start: {start!r} is not a time: {message}"


@pytest.mark.parametrize("start", ["liftoff - 60 s", "stage1_cutoff + 20 s", "injection + 10 s", "100 s"])
def test_a_fault_on_the_pad_in_flight_or_in_the_coast_is_good(study, start: str) -> None:
    with_fault(study, start)
    assert reported(study) == []


def test_an_outage_of_no_length_is_a_level_like_any_other(study) -> None:
    with_fault(study, "100 s")
    text = "axes: [{path: faults.0.duration, values: [0 s, 30 s]}]\n"
    study.path.write_text(study.path.read_text() + text)
    assert reported(study) == []


def test_a_fault_that_an_axis_brings_is_reported_in_the_axis(study) -> None:
    study.append(
        "axes:\n  - path: faults\n    values:\n      - []\n      - [{start: 100 s, "
        "duration: 5 s, kind: satellite_outage}]\n"
        "      - [{start: 100 min, duration: 5 s, kind: satellite_outage}]\n"
    )
    place = "campaign.yaml:15:18: base.faults.0.start"
    assert reported(study) == [f"{place}: '100 min' is 6000 s, at or after the end of the flight (560 s)"]


def test_a_field_of_a_fault_that_an_axis_varies_is_reported_in_the_axis(study) -> None:
    with_fault(study, "100 s")
    text = "axes: [{path: faults.0.start, values: [150 s, 600 s]}]\n"
    study.path.write_text(study.path.read_text() + text)
    assert reported(study) == [
        "campaign.yaml:11:47: base.faults.0.start: '600 s' is 600 s, at or after the end of the flight (560 s)"
    ]


def test_a_fault_given_on_the_command_line_is_reported_there(study) -> None:
    assert reported(study, ("faults=[{start: 600 s, duration: 5 s, kind: satellite_outage}]",)) == [
        "--set: base.faults.0.start: '600 s' is 600 s, at or after the end of the flight (560 s)"
    ]


def test_what_a_fault_takes_and_a_case_does_not_have_is_reported_where_it_was_named(study) -> None:
    text = "  imu: imu/good\n  faults:\n" + "".join(
        f"    - {{start: 100 s, duration: 5 s, {what}}}\n"
        for what in ("kind: range_bias, size: 5 m, satellites: [A1, G05]", "kind: antenna_failure, antennas: [2]")
    )
    study.edit("campaign.yaml", "  imu: imu/good\n", text)
    assert reported(study) == [
        "campaign.yaml:7:78: base.faults.0.satellites: 'G05' is not in the constellation (it has A1, A2)",
        "campaign.yaml:8:70: base.faults.1.antennas: the receiver has no antennas; it sees all satellites above its"
        " mask",
    ]


def test_a_mistake_that_shows_when_a_case_is_put_together_is_reported_where_it_was_written(study) -> None:
    campaign = load("campaign.yaml")
    (case,) = cases(campaign)
    shown = flights.locate_mistakes(
        campaign, case, [Mistake("too late", "filter.gate"), Mistake("broken", "", "my.csv", 3, 1)]
    )
    assert [str(one) for one in shown] == [
        "configs/filters/near.yaml:1:1: base.filter.gate: too late",
        "my.csv:3:1: broken",
    ]


def test_a_requirement_at_an_unknown_event_is_reported_at_the_word(study) -> None:
    study.append(
        "requirements:\n  - {name: a, metric: position_error_3d, at: injektion, probability: 0.5, below: 1 m}\n"
    )
    assert reported(study) == [
        "campaign.yaml:11:46: requirements.0.at: 'injektion' is not an event of the trajectory"
        " (did you mean 'injection'?)"
    ]


def test_a_phase_that_does_not_fit_is_reported_at_the_word(study) -> None:
    bound = "metric: position_error_3d, probability: 0.5, below: 1 m}\n"
    study.append(
        "requirements:\n"
        f"  - {{name: a, during: liftoff to injektion, {bound}"
        f"  - {{name: b, during: injection to liftoff, {bound}"
        f"  - {{name: c, during: start to end, {bound}"
    )
    assert reported(study) == [
        "campaign.yaml:11:23: requirements.0.during: 'injektion' is not an event of the trajectory"
        " (did you mean 'injection'?)",
        "campaign.yaml:12:23: requirements.1.during: the phase from injection (540 s) to liftoff (0 s) has no length",
    ]


def test_a_default_that_does_not_fit_is_reported_where_it_was_left_out(study) -> None:
    study.append("requirements:\n  - {name: a, metric: position_error_3d, probability: 0.5, below: 1 m}\n")
    campaign = load("campaign.yaml")
    found = cases(campaign)
    mistakes = flights.mistakes(campaign, found, {case.id: {"liftoff": 0.0, "meco": 540.0} for case in found})
    assert [str(mistake) for mistake in mistakes] == [
        "campaign.yaml:11:5: requirements.0.at: 'injection' is not an event of the trajectory (it has liftoff, meco)"
    ]


def test_the_same_mistake_in_many_cases_is_reported_once(study) -> None:
    with_fault(study, "600 s")
    text = "axes: [{path: imu, cards: [imu/good, imu/poor]}, {path: filter.gate, values: [4, 5]}]\n"
    study.path.write_text(study.path.read_text() + text)
    assert len(reported(study)) == 1


def test_a_mistake_in_a_resolved_campaign_stands_in_that_file(study) -> None:
    with_fault(study, "600 s")
    study.write("frozen.yaml", resolved_text(load("campaign.yaml")))
    (line,) = reported(study, name="frozen.yaml")
    assert line.startswith("frozen.yaml:")
    assert line.endswith("base.faults.0.start: '600 s' is 600 s, at or after the end of the flight (560 s)")


def test_a_rule_between_rates_is_reported_at_the_mapping_where_the_slower_one_has_its_default(study) -> None:
    study.edit("configs/imu/good.yaml", '"200 Hz"', "125 Hz")
    with pytest.raises(InputError) as caught:
        load("campaign.yaml")
    assert str(caught.value).splitlines() == [
        "configs/filters/near.yaml:1:1: base.filter.covariance_rate: 10 Hz does not divide the IMU rate of 125 Hz",
        "configs/imu/good.yaml:1:1: base.imu.process_rate: 10 Hz does not divide the IMU rate of 125 Hz",
    ]


@pytest.mark.parametrize(("fast", "slow"), [(200.0, 0.1), (200.0, 200.0), (100.0 / 3.0, 100.0 / 9.0)])
def test_a_rate_divides_another_whatever_the_rounding(study, fast: float, slow: float) -> None:
    slower = ("imu.process_rate", "filter.covariance_rate", "filter.update_rate", "receiver.rate")
    load("campaign.yaml", [f"imu.rate={fast} Hz", *(f"{path}={slow} Hz" for path in slower)])


def test_an_inertial_filter_asks_nothing_of_the_receiver(study) -> None:
    load("campaign.yaml", ["filter.measurements=[]", "receiver.rate=3 Hz"])
    with pytest.raises(InputError, match="1 Hz does not divide the receiver rate of 1\\.5 Hz"):
        load("campaign.yaml", ["receiver.rate=1.5 Hz"])


@pytest.mark.parametrize(
    ("listed", "assignment", "path"),
    [
        (RANGES, "receiver.pseudorange_sigma=0 m", "base.receiver.pseudorange_sigma"),
        (SOLUTION, "receiver.solution.velocity_sigma=0", "base.receiver.solution.velocity_sigma"),
        (SOLUTION, "filter.receiver={pseudorange_sigma: 1 m, range_rate_sigma: 1 m/s, position_sigma: 0,"
         " velocity_sigma: 1 m/s, clock_h0: 0, clock_h_minus2: 0}", "base.filter.receiver.position_sigma"),
    ],
)  # fmt: skip
def test_a_measurement_that_the_filter_would_model_without_noise_is_refused(study, listed, assignment, path) -> None:
    with pytest.raises(InputError) as caught:
        load("campaign.yaml", [f"filter.measurements={listed}", assignment])
    assert str(caught.value) == (
        f"--set: {path}: the filter cannot model {path.rpartition('.')[2].removesuffix('_sigma')} without noise; "
        "should be greater than 0"
    )


def test_a_measurement_that_is_not_used_may_be_perfect(study) -> None:
    load("campaign.yaml", [f"filter.measurements={SOLUTION}", "receiver.pseudorange_sigma=0 m"])


@pytest.mark.parametrize(
    ("listed", "message"), [("[]", "the filter has no measurement; an error bound needs some"), (RANGES, "")]
)
def test_a_filter_that_has_no_bound_to_tell_is_reported_where_it_was_asked(study, listed: str, message: str) -> None:
    found = reported(study, ("covariance.error_bound=true", f"base.filter.measurements={listed}"))
    assert [message in line and "covariance.error_bound" in line for line in found] == [True] * bool(message)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("base.filter=filters/tight", ""),
        ("base.filter=filters/loose", "takes no ranges"),
        ("base.filter.clock=differenced", "no sub-filter is without"),
        ("base.filter.consider=[gyro_scale_factor]", "that of optimal filters"),
    ],
)
def test_protection_levels_are_of_filters_that_have_sub_filters(study, setting, message):
    found = reported(study, ("covariance.protection={integrity_risk: 0.001}", "base.filter=filters/tight", setting))
    assert [message in line and "covariance.protection" in line for line in found] == [True] * bool(message)


@pytest.mark.parametrize("start", ["start", "start + 10 s", "end - 20 s"])
def test_a_fault_may_begin_at_an_end_of_the_flight_as_a_phase_does(study, start: str) -> None:
    study.edit("configs/vehicles/small.yaml", '"300 kg"', '"150 kg"')
    fault = f"{{kind: satellite_outage, start: {start}, duration: 10 s}}"
    study.edit("campaign.yaml", "imu: imu/good", f"imu: imu/good\n  faults: [{fault}]")
    assert api.check("campaign.yaml").campaign.base.faults[0].start == start


def test_a_fault_at_the_end_of_the_flight_is_refused(study) -> None:
    study.edit("configs/vehicles/small.yaml", '"300 kg"', '"150 kg"')
    fault = "{kind: satellite_outage, start: end, duration: 10 s}"
    study.edit("campaign.yaml", "imu: imu/good", f"imu: imu/good\n  faults: [{fault}]")
    with pytest.raises(InputError, match="at or after the end of the flight"):
        api.check("campaign.yaml")


def test_a_step_of_the_strapdown_is_not_longer_than_one_of_the_covariance(study) -> None:
    measured = "measurements: [pseudorange, range_rate]"
    study.edit("configs/filters/near.yaml", measured, f"{measured}\ncovariance_rate: 50 Hz\nstrapdown: {{ratio: 5}}")
    with pytest.raises(InputError, match=r"ratio: a step longer than a covariance step of 4 increments; at most 4 fit"):
        load("campaign.yaml")


def test_a_requirement_on_the_backup_needs_one_in_every_case(study):
    stated = (
        "requirements: [{name: a, metric: backup_velocity_error_north, probability: 0.9, below: 1 m/s, at: liftoff}]"
    )
    study.edit("campaign.yaml", "seed: 7", f"seed: 7\n{stated}")
    (found,) = reported(study)
    assert "requirements.0.metric: 'backup_velocity_error_north': a case has no such strapdown (filter.backup)" in found
    assert not reported(study, ("base.filter.backup=true",))
