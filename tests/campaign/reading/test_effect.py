"""What a campaign states and no case reads is an input error; what has an effect in one case is none."""

from __future__ import annotations

from pathlib import Path

import pytest

from lvnav_trade import api
from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.effect import Effects
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.settings_read import EffectiveSettings

CAMPAIGN = """\
name: whole
seed: 1
base:
  trajectory: trajectories/two_stage_leo
  imu: {card: imu/tactical_fog, rate: "20 Hz", process_rate: "10 Hz"}
  constellation: constellations/gps_24
  receiver: receivers/l1_two_metre
  filter: filters/tight
  initial: {tilt: "0.1 deg", heading: "0.05 deg", position: "1 m", velocity: "0.01 m/s"}
"""
RADAR = "sensors.radar=altimeters/radar_004"
LISTED = "filter.measurements=[pseudorange, range_rate, altitude]"
SOLUTION = "filter.measurements=[position, velocity]"
SIMULATED = "the receiver's solution is simulated, not solved from ranges"
GROWN = "{altitude: [0 km, 9 km], factor: [1, 2], of: [pseudorange]}"
INERTIAL = "filter.measurements=[]"
SOLVER = "kind: bancroft, range_sigma: 1 m, rate_sigma: 0.1 m/s"
MODEL = (
    "pseudorange_sigma: 1 m, range_rate_sigma: 1 m/s, position_sigma: 1 m, velocity_sigma: 1 m/s, clock_h0: 0, "
    "clock_h_minus2: 0"
)
CLOCKLESS = "no effect: only a filter that measures ranges has a clock"
TWO_FREQUENCIES = "filter.corrections.ionosphere: no effect: ranges of two frequencies have no ionospheric delay"
SMOOTHED = f"receiver.solution={{{SOLVER}, reported: true, smoothing: {{time: 9 s}}}}"
TDCP = "filter.measurements=[pseudorange, tdcp]"
NO_PHASE = "no effect: no carrier phase is measured"
UNREAD = "no effect: nothing that is computed for this campaign reads it"


@pytest.fixture(autouse=True)
def campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "campaign.yaml"
    file.write_text(CAMPAIGN)
    return file


def refused(*sets: str) -> list[str]:
    """Return what `check` says of the campaign."""
    try:
        api.check("campaign.yaml", sets)
    except InputError as error:
        return [str(record) for record in error.records]
    return []


@pytest.mark.parametrize(
    ("sets", "message"),
    [
        ((RADAR,), "sensors.radar: no effect: altitude is not among the measurements of any filter"),
        (
            ("filter.sensor_models={altitude: {sigma: 1 m}}",),
            "filter.sensor_models.altitude: no effect: it is not among the measurements",
        ),
        (
            (RADAR, LISTED, "filter.sensor_models={altitude: {sigma: 1 m, latency: 0.1 s}}"),
            "filter.sensor_models.altitude.latency: no effect: without delay_compensation nothing is compensated",
        ),
        (
            (RADAR, LISTED, "filter.sensor_models={altitude: {sigma: 1 m, bias: 2 m}}"),
            "filter.sensor_models.altitude.bias: no effect: no sensor that the filter uses has such an error",
        ),
        (("filter.envelope={burn: 1 deg/s^2}",), "filter.envelope"),
        (("receiver.solution.position_bias=3 m",), "receiver.solution.position_bias: no effect: the filter does not"),
        (("receiver.multipath=3 m", SOLUTION), f"receiver.multipath: {UNREAD}"),
        (("receiver.range_rate_offset=1 m/s", SOLUTION), f"receiver.range_rate_offset: {UNREAD}"),
        (("filter.corrections={ionosphere: {kind: content}}", "receiver.frequencies=L1_L2"), TWO_FREQUENCIES),
        (("filter.extra_states=[ionosphere_scale]", "atmosphere={ionosphere: {kind: content}, ionosphere_scale: 0.2}",
          "receiver.frequencies=L1_L2"), "atmosphere"),
        (("filter.as_noise=[range_bias]", f"filter.receiver={{{MODEL}, range_bias: 2 m}}"), ""),
        (("filter.extra_states=[range_bias]", f"filter.receiver={{{MODEL}, range_bias: 2 m, range_bias_time: 9 s}}"),
         ""),
        (("filter.as_noise=[range_bias]", f"filter.receiver={{{MODEL}, range_bias: 2 m, range_bias_time: 9 s}}"),
         "filter.receiver.range_bias_time: no effect: no state or measurement of the filter is of it"),
        ((f"receiver.noise_by=[{GROWN}]", SOLUTION), "receiver.noise_by.0: no effect: none of these measurements"),
        ((f"receiver.noise_by=[{GROWN}]",), ""),
        ((INERTIAL, f"receiver.solution={{{SOLVER}, reported: true}}"), ""),
        ((INERTIAL, f"receiver.solution={{{SOLVER}, reported: true, smoothing: {{time: 9 s}}}}"), ""),
        (("filter.clock=differenced", SOLUTION), f"filter.clock: {CLOCKLESS}"),
        (("filter.reference_satellite=G01",), "filter.reference_satellite: no effect: clock: differenced has one"),
        (("filter.clock=differenced", "filter.reference_satellite=A1"), ""),
        (("receiver.carrier_phase_sigma=3 mm",), f"receiver.carrier_phase_sigma: {NO_PHASE}"),
        (("receiver.cycle_slips={rate: 2 1/h}",), f"receiver.cycle_slips: {NO_PHASE}"),
        (("faults=[{kind: cycle_slip, size: 1, start: 9 s}]",), f"faults.0: {NO_PHASE}"),
        (("receiver.carrier_phase_sigma=3 mm", "receiver.cycle_slips={rate: 2 1/h}", INERTIAL, SMOOTHED), ""),
        (("faults=[{kind: cycle_slip, size: 1, start: 9 s}]", INERTIAL, SMOOTHED), ""),
        (("faults=[{kind: satellite_outage, start: 9 s, duration: 0 s}]",), "faults.0: no effect: it lasts no time"),
        (("faults=[{kind: satellite_outage, start: 9 s, duration: 1 s}]",), ""),
        (("faults=[{kind: satellite_outage, start: 9 s, duration: 1 s, keep: 2000}]",),
         "faults.0: no effect: it keeps 2000 satellites, and the constellation has 24"),
        (("faults=[{kind: satellite_outage, start: 9 s, duration: 1 s, keep: 23}]",),
         "faults.0: no effect: it keeps 23 satellites, and the receiver tracks "),
        (("faults=[{kind: satellite_outage, start: 9 s, duration: 1 s, keep: 2}, "
          "{kind: satellite_outage, start: 9 s, duration: 1 s, keep: 3}]",),
         "faults.1: no effect: the receiver tracks the same satellites without it"),
        (("imu={units: [imu/tactical_fog_matched, imu/tactical_fog_matched]}", "sensors={a: {kind: angle_difference}}",
          "filter.measurements=[pseudorange, range_rate, angle_difference]"), ""),
        (("filter.delayed_state=consider",), f"filter.delayed_state: {UNREAD}"),
        (("filter.previous_noise=estimated",), f"filter.previous_noise: {UNREAD}"),
        (("receiver.carrier_ambiguity=3 m", TDCP), f"receiver.carrier_ambiguity: {UNREAD}"),
        (("receiver.carrier_phase_sigma=3 mm", "faults=[{kind: cycle_slip, size: 1, start: 9 s}]",
          "filter.previous_noise=estimated", "filter.delayed_state=consider", TDCP), ""),
        (("receiver.frequencies=L1_L2", SOLUTION), f"receiver.frequencies: no effect: {SIMULATED}, and there is no"),
        (("filter.clock=differenced", "filter.region_noise=[{from: 9 s, clock_drift: 1 m/s, velocity: 1 m/s}]"),
         "filter.region_noise.0.clock_drift: no effect: differences forget the clock at every epoch"),
        (("filter.clock=one_state", "filter.region_noise=[{from: 9 s, clock_drift: 1 m/s, velocity: 1 m/s}]",
          "filter.measurements=[pseudorange]"), f"filter.region_noise.0.clock_drift: {UNREAD}"),
        (("filter.extra_states=[range_bias]", "constellation.range_error=1 m", "filter.measurements=[tdcp]"),
         "filter.extra_states: range_bias: no measurement of the filter depends on it"),
        (("filter.extra_states=[range_bias]", "constellation.range_error=1 m", TDCP), ""),
        (("receiver.solution.bias_time=9 s", SOLUTION), ""),
        (("filter.extra_states=[position_bias]",), "filter.extra_states: position_bias: no measurement of the filter"),
        (("filter.consider=[velocity_bias]",), "filter.consider: velocity_bias: no measurement of the filter"),
        (("filter.extra_states=[range_bias]", SOLUTION), "filter.extra_states: range_bias: no measurement of the"),
        (("filter.extra_states=[time_offset]",), "filter.extra_states: time_offset: no measurement of the filter"),
        (("filter.extra_states=[timing]", "filter.measurements=[]"), "filter.extra_states: timing: no measurement"),
        (("filter.extra_states=[altitude_bias]",), "filter.extra_states: altitude_bias: no sensor has such an error"),
        (("filter.extra_states=[timing]",), "filter.extra_states: timing: its one-sigma is zero, and nothing drives"),
        (
            ("filter.delay_compensation={kind: buffered, delay: 0 s}",),
            "filter.delay_compensation: nothing arrives late: no latency of the receiver or of a sensor",
        ),
        (
            ("filter.delay_compensation={kind: buffered, acceleration_sigma: 1 g}", "receiver.latency=0.2 s"),
            "filter.delay_compensation.acceleration_sigma: applies to extrapolated solutions only",
        ),
        (("faults=[{kind: clock_jump, start: 9 s, size: 3 m}]", SOLUTION), f"faults.0: no effect: {SIMULATED}"),
        (
            ("faults=[{kind: degraded_noise, factor: 3, elevation_below: 20 deg}]", SOLUTION),
            f"faults.0.elevation_below: no effect: {SIMULATED}",
        ),
        (("faults=[{kind: frozen_output, start: 1 h, duration: 9 s}]",), "faults.0.start: '1 h' is 3600 s, at or"),
        (("monte_carlo={runs: 40, stop: decided}",), "!monte_carlo.stop: there is no requirement that could be"),
        (("covariance={adjoint: false, at: injection}",), ""),  # errors at this event are in the report
        (("covariance={observability: false, window: 9 s}",), "!covariance.window: no effect: observability is off"),
        (("design=zip",), "!design: no effect: the campaign has no axes"),
        (("filter.gate=5",), ""),
        (("filter.feedback=open",), ""),
        ((RADAR, LISTED, "sensors.radar.bias=1 m", "filter.extra_states=[altitude_bias]"), ""),
        (("filter.extra_states=[gyro_scale_factor]", "filter.measurements=[]"), ""),
        (("sensors={radar: null}", "control=null"), ""),
    ],
)  # fmt: skip
def test_a_setting_without_effect_is_refused(sets: tuple[str, ...], message: str) -> None:
    lines = refused(*sets)
    path = message.removeprefix("!") if message.startswith("!") else f"base.{message}"
    assert [line.startswith(f"--set: {path}") for line in lines] == [True] * bool(message)


def test_a_receiver_that_solves_for_nobody_is_refused_unless_its_solution_is_reported(campaign: Path) -> None:
    text = campaign.read_text()

    def lines(more: str) -> list[str]:
        card = f"receiver: {{card: receivers/l1_two_metre, solution: {{{SOLVER}{more}}}}}"
        campaign.write_text(text.replace("receiver: receivers/l1_two_metre", card))
        return refused(INERTIAL)

    assert [line.split("base.")[1] for line in lines("")] == [
        "receiver.solution: no effect: the filter does not take the solution, and it is not reported"
    ]
    assert lines(", reported: true, smoothing: {time: 9 s}") == []
    assert "receiver.solution.smoothing" in lines(", reported: true, smoothing: {rate_interval: 0.2 s}")[0]


def test_the_place_is_that_of_what_is_stated(campaign: Path) -> None:
    filtered = "filter: {card: filters/loose, receiver: {pseudorange_sigma: 1 m, range_rate_sigma: 1 m/s,\n"
    more = "    position_sigma: 1 m, velocity_sigma: 1 m/s, clock_h0: 0, clock_h_minus2: 0, range_bias: 2 m}}"
    campaign.write_text(CAMPAIGN.replace("filter: filters/tight", filtered + more))
    # what its model cannot be without is no statement: pseudorange_sigma; the bias that is no state is one
    hint = "no effect: no state or measurement of the filter is of it"
    range_bias = f"campaign.yaml:9:81: base.filter.receiver.range_bias: {hint}"
    assert refused() == [range_bias]
    assert refused("filter.receiver.range_rate_sigma=2 m/s") == [
        f"--set: base.filter.receiver.range_rate_sigma: {hint}",
        range_bias,
    ]


def test_a_card_is_a_description_of_a_thing_and_so_is_one_of_the_users_own(campaign: Path) -> None:
    own = campaign.parent / "configs" / "receivers" / "mine.yaml"
    own.parent.mkdir(parents=True)
    own.write_text(
        "name: mine\nsource: test\npseudorange_sigma: 1 m\nrange_rate_sigma: 1 cm/s\nclock: {h0: 0, h_minus2: 0}\n"
        "solution: {kind: direct, position_sigma: 3 m, velocity_sigma: 1 cm/s, position_bias: 1 m}\n"
    )
    assert refused("receiver=receivers/mine") == []
    (line,) = refused("receiver=receivers/mine", "receiver.solution.velocity_bias=1 cm/s")
    assert line.startswith("--set: base.receiver.solution.velocity_bias: no effect")


def test_a_resolved_campaign_says_everything_and_only_what_is_set_on_top_counts(campaign: Path) -> None:
    campaign.write_text(resolved_text(load("campaign.yaml")))
    assert refused() == []
    (line,) = refused("receiver.solution.bias_time=9 s")
    assert line.startswith("--set: base.receiver.solution.bias_time: no effect")


def test_a_level_needs_an_effect_in_one_case(campaign: Path) -> None:
    biases = "  - {path: receiver.solution.position_bias, values: [1 m, 2 m]}\n"
    filters = "  - {path: filter, cards: [filters/tight, filters/loose]}\n"
    campaign.write_text(f"{CAMPAIGN}axes:\n{biases}")
    hint = "base.receiver.solution.position_bias: no effect: the filter does not take the receiver's solution"
    assert refused() == [f"campaign.yaml:11:54: {hint}", f"campaign.yaml:11:59: {hint}"]
    campaign.write_text(f"{CAMPAIGN}axes:\n{filters}{biases}")
    assert refused() == []
    campaign.write_text(f"{CAMPAIGN}design: zip\naxes:\n{filters}{biases}")
    assert refused() == [f"campaign.yaml:13:54: {hint}"]


def test_a_field_of_a_sensor_that_is_null_in_every_case_is_refused(campaign: Path) -> None:
    sensors = "  sensors: {radar: {card: altimeters/radar_004, highest: 5 km}}\n"
    axes = "axes:\n  - {path: sensors.radar, values: [null, altimeters/radar_004]}\n"
    measured = CAMPAIGN.replace("filters/tight", "{card: filters/tight, measurements: [pseudorange, altitude]}")
    campaign.write_text(measured + sensors + axes)
    message = "no case has it: the axis 'sensors.radar' replaces it; write it in the axis's values"
    assert [line.split(": ", 1)[1] for line in refused()] == [f"base.sensors.radar.highest: {message}"]


def test_a_change_to_a_card_that_every_case_replaces_is_refused_and_that_of_a_base_that_flies_is_not(
    campaign: Path,
) -> None:
    campaign.write_text(f"{CAMPAIGN}axes: [{{path: imu, cards: [imu/tactical_fog, imu/tactical_mems]}}]\n")
    found = load("campaign.yaml")
    lines = [str(one) for one in Effects(found, cases(found)).mistakes({})]
    message = "no case has it: the axis 'imu' replaces it; write it in the axis's values"
    assert lines == [
        f"campaign.yaml:5:33: base.imu.rate: {message}",
        f"campaign.yaml:5:48: base.imu.process_rate: {message}",
    ]
    found = load("campaign.yaml", ["design=one_at_a_time"])
    assert Effects(found, cases(found)).mistakes({}) == []


def test_few_cases_are_enough_where_they_read_all_that_is_stated(campaign: Path) -> None:
    gates = "  - {path: filter.gate, values: [3, 4, 5]}\n"
    sensors = "  - {path: sensors.radar, values: [altimeters/radar_004, {card: altimeters/radar_004, sigma: 2 m}]}\n"
    measured = CAMPAIGN.replace("filters/tight", "{card: filters/tight, measurements: [pseudorange, altitude]}")
    assert visited(campaign, f"{CAMPAIGN}axes:\n{gates}") == 1  # of three: values of one field
    assert visited(campaign, f"{measured}axes:\n{gates}{sensors}") == 2  # of six: a case for each sensor
    assert visited(campaign, f"{measured}design: zip\naxes:\n{gates.replace(', 5', '')}{sensors}") == 2


def visited(file: Path, text: str) -> int:
    """Return how many cases of a campaign are looked at where each of them reads everything."""
    file.write_text(text)
    found = load(file)
    effects, known = Effects(found, cases(found)), {}
    while (case := effects.next_case(known)) is not None:
        known[case.id] = EffectiveSettings(frozenset(), tuple(Scenario.model_fields), {})
    return len(known)


def test_states_of_a_card_may_be_those_of_units_with_larger_errors_but_not_of_nothing(campaign: Path) -> None:
    assert refused("filter=filters/tight_extended", "imu={card: imu/tactical_fog_matched, rate: 20 Hz}") == []
    own = campaign.parent / "configs" / "filters" / "mine.yaml"
    own.parent.mkdir(parents=True)
    own.write_text("name: mine\nsource: test\nmeasurements: [pseudorange]\nextra_states: [timing, position_bias]\n")
    message = "position_bias: no measurement of the filter depends on it"
    assert refused("filter=filters/mine") == [f"configs/filters/mine.yaml:4:24: base.filter.extra_states: {message}"]


def test_times_of_names_of_the_users_own_have_an_effect_as_a_whole(campaign: Path) -> None:
    assert refused('trajectory={card: trajectories/two_stage_leo, named_times: {minute: "60 s"}}') == []
