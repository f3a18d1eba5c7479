"""The flight of a file of the user's own, and what is refused of it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from ruamel.yaml import YAML

from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.trajectory.files.contradiction import PRECISION, require_consistent
from lvnav_trade.trajectory.files.table_flight import residuals
from lvnav_trade.trajectory.flight import build, content, motion, refuse_contradiction
from lvnav_trade.trajectory.truth import NOTE, WARNING
from tests.trajectory.flight_cases import CONFIGS, ascent
from tests.trajectory.tables import BREAK, card, example_settings, path, write

T = np.arange(0.0, 80.25, 0.5)


def named(names, rows):
    return dict(zip(names, rows.T, strict=True))


def imu(name="navigation"):
    return ImuCard.model_validate(YAML(typ="safe").load((CONFIGS / f"imu/{name}.yaml").read_text()))


def test_the_shipped_example_is_the_flight_it_was_written_from(record_property):
    # rows at 2 Hz with 0.1 mm and 0.01 mm/s; within 0.1 s of an event its time, given to 0.1 ms, is the difference
    flight, true = build(card(example_settings())), ascent()
    t = np.linspace(0.0, 569.0, 9000)
    a, b = motion(flight, t), motion(true, t)
    away = np.min(np.abs(t[:, None] - np.array(list(true.events.values()))), axis=1) > 0.5
    force = np.linalg.norm(a.f_b - b.f_b, axis=1)
    assert np.max(np.linalg.norm(a.r_i - b.r_i, axis=1)) < 2e-3
    assert np.max(np.linalg.norm(a.v_i - b.v_i, axis=1)) < 5e-3
    assert np.max(force[away]) < 5e-3
    assert np.max(np.abs(a.w_ib_b - b.w_ib_b)) < 1e-4
    assert (flight.start, flight.end) == (-60.0, 569.0)
    assert flight.events["injection"] == pytest.approx(true.events["injection"], abs=1e-4)
    record_property("example table: median difference of specific force, m/s^2", f"{np.median(force):.1e}")


def test_the_shipped_example_passes_the_best_shipped_unit():
    refuse_contradiction(card(example_settings()), imu())


def test_without_velocity_the_position_alone_gives_the_same_flight_and_no_residual():
    own = card({**example_settings(), "velocity": None, "attitude": None})
    flight, true = build(own), ascent()
    t = np.linspace(0.0, 569.0, 5000)
    assert np.max(np.linalg.norm(motion(flight, t).r_i - motion(true, t).r_i, axis=1)) < 5e-3
    assert residuals(own) == ()
    assert flight.facts["position_misfit_rms_m"] < 1e-3
    assert 0.1 < flight.facts["implied_jerk_worst_m_s3"] < 10.0


def test_pad_and_flight_meet_in_place_velocity_and_attitude():
    flight = build(card(example_settings()))
    pad, first = flight.phases[0], flight.phases[1]
    assert (pad.name, pad.end, first.start) == ("pad", 0.0, 0.0)
    assert np.max(np.abs(pad.position(0.0) - first.position(0.0))) < 1e-7
    assert np.max(np.abs(pad.position(0.0, 1) - first.position(0.0, 1))) < 1e-6
    on_pad = motion(flight, [-30.0])
    assert np.linalg.norm(on_pad.f_b) == pytest.approx(9.80, abs=0.01)
    assert np.linalg.norm(on_pad.w_ib_b) == pytest.approx(7.292115e-5, rel=1e-3)


def test_a_pad_before_rows_of_ten_hertz_is_at_rest_to_its_start(tmp_path):
    t = np.arange(0.0, 80.05, 0.1)
    r, v = path(t)
    table = np.column_stack([t, r, v, np.tile([1.0, 0.0, 0.0, 0.0], (t.size, 1))])
    names = ["t", "x", "y", "z", "vx", "vy", "vz", "q0", "q1", "q2", "q3"]
    turned = {"form": "quaternion", "frame": "eci", "columns": names[7:], "scalar": "first", "turns": "body_to_frame"}
    settings = write(tmp_path, events={"cutoff": f"{BREAK} s"}, attitude=turned, largest_force_angle="180 deg")
    np.savetxt(tmp_path / "mine.csv", table, delimiter=",", header=",".join(names), comments="", fmt="%.12f")
    flight = build(card({**settings, "pad_hold": "60 s"}))
    at = motion(flight, np.arange(-60.0, -1.0, 0.037))
    assert np.max(np.abs(np.linalg.norm(at.w_ib_b, axis=1) - 7.292115e-5)) < 1e-7


def test_a_force_that_jumps_between_rows_is_found_at_its_event(tmp_path):
    late = np.maximum(T - BREAK - 0.2, 0.0)
    r, v = path(T)
    up = r[0] / np.linalg.norm(r[0])
    shift = np.outer(9.0 * np.maximum(T - BREAK, 0.0) ** 2 - 9.0 * late**2, up)
    rate = np.outer(18.0 * np.maximum(T - BREAK, 0.0) - 18.0 * late, up)
    columns = {**named("xyz", r + shift), **named(("vx", "vy", "vz"), v + rate)}
    own = write(tmp_path, columns, events={"cutoff": f"{BREAK + 0.2} s"})
    flight = build(card(own))
    before, after = motion(flight, [BREAK + 0.199, BREAK + 0.201]).f_b
    assert np.linalg.norm(before) - np.linalg.norm(after) == pytest.approx(18.0, abs=0.02)
    refuse_contradiction(card(own), imu())


@pytest.mark.parametrize("velocity", [True, False])
def test_a_jump_of_the_reference_point_at_an_event_is_named_and_removed(tmp_path, velocity):
    r, _ = path(T)
    shift = np.outer(T >= BREAK, [3.0, 0.0, 4.0])
    settings = write(tmp_path, named("xyz", r + shift))
    if not velocity:
        settings["velocity"] = None
    flight = build(card(settings))
    assert flight.facts["reference_change_1"] == "cutoff"
    assert flight.facts["reference_change_1_m"] == pytest.approx(5.0, abs=0.01)
    assert flight.facts["reference_change_1_at_s"] == BREAK
    assert np.max(np.abs(motion(flight, T).r_i - r)) < 0.01
    refuse_contradiction(card(settings), imu())


def paired(tmp_path, shift=(0.0, 0.0, 0.0), rate=(0.0, 0.0, 0.0), at=BREAK):
    """A file with two rows at a time, position and velocity of the second one and all behind it changed."""
    t = np.sort(np.append(T, at))
    r, v = path(t)
    behind = np.arange(t.size) > np.searchsorted(t, at)
    columns = {"t": t, **named("xyz", r + np.outer(behind, shift)), **named(("vx", "vy", "vz"), v)}
    return write(tmp_path, columns | named(("vx", "vy", "vz"), v + np.outer(behind, rate)))


@pytest.mark.parametrize("velocity", [True, False])
def test_two_rows_at_an_event_are_the_states_before_and_after_it(tmp_path, velocity):
    settings = paired(tmp_path, [3.0, 0.0, 4.0])
    if not velocity:
        settings["velocity"] = None
    flight = build(card(settings))
    assert flight.facts["reference_change_1"] == "cutoff"
    assert flight.facts["reference_change_1_m"] == pytest.approx(5.0, abs=0.01)
    assert np.max(np.abs(motion(flight, T).r_i - path(T)[0])) < 0.01


def test_a_velocity_that_jumps_between_two_rows_at_an_event_is_named(tmp_path):
    with pytest.raises(InputError, match=r":83: the velocity jumps by 2 m/s at event 'cutoff', between the two rows"):
        build(card(paired(tmp_path, rate=[0.0, 2.0, 0.0])))


def test_two_rows_at_a_time_that_is_no_event_are_named_with_the_event_that_they_may_be(tmp_path):
    with pytest.raises(InputError, match=r":123: time 60 s repeats .* with another state.*events: \{NAME: 60 s\}"):
        build(card(paired(tmp_path, [3.0, 0.0, 4.0], at=60.0)))


def test_a_jump_where_no_event_is_declared_is_refused(tmp_path):
    r, _ = path(T)
    settings = write(tmp_path, named("xyz", r + np.outer(T >= 60.0, [3.0, 0.0, 4.0])))
    with pytest.raises(
        InputError, match=r"position steps by 5 m more than its velocity between 59\.5 and 60 s, where no"
    ):
        build(card(settings))
    write(tmp_path, named("xyz", r + np.outer(T >= 60.0, [300.0, 0.0, 400.0])))
    with pytest.raises(InputError, match=r"specific force of [\d.]+ g at (59|60).* is an event missing there"):
        build(card({**settings, "velocity": None}))


def drifting(tmp_path, rate=0.2):
    """A file whose reference point moves at a rate (m/s) until the event."""
    r, _ = path(T)
    shift = np.outer(np.minimum(T, BREAK) * rate, [0.6, 0.0, 0.8])
    return write(tmp_path, named("xyz", r + shift))


def test_a_contradiction_beyond_a_tenth_of_the_units_drift_is_refused_with_place_and_size(tmp_path):
    own = card(drifting(tmp_path))
    with pytest.raises(InputError, match=r"mine.csv: .* by 8 m at 40 s \(from 0 s on\); allowed are 0\.08"):
        refuse_contradiction(own, imu())
    # 2 mg over 40 s are 16 m, a tenth 1.6 m: at a twentieth of the rate the file passes that unit, not the other
    slow = card(drifting(tmp_path, 0.01))
    refuse_contradiction(slow, imu("tactical_fog"))
    with pytest.raises(InputError, match=r"by 0\.4 m at 40 s"):
        refuse_contradiction(slow, imu())


def test_a_movement_of_the_reference_point_that_is_declared_is_named_and_removed(tmp_path):
    own = card(drifting(tmp_path), moving_reference=[["liftoff", "cutoff"]])
    refuse_contradiction(own, imu())
    flight = build(own)
    assert flight.facts["reference_change_1"] == "liftoff to cutoff"
    assert flight.facts["reference_change_1_m"] == pytest.approx(8.0, abs=1e-3)
    assert np.max(np.abs(motion(flight, T).r_i - path(T)[0])) < 1e-3


def test_a_velocity_in_the_wrong_frame_is_refused(tmp_path):
    own = write(tmp_path)
    own["velocity"] = {**own["velocity"], "frame": "ecef"}
    with pytest.raises(InputError, match="is one missing, or a frame or unit wrong"):
        build(card(own))


def test_coarse_digits_are_smoothed_and_no_contradiction(tmp_path):
    # 0.1 m and 0.01 m/s at 2 Hz: interpolated they would shake the force by 0.02 m/s^2
    own = card(write(tmp_path, digits=2, position_noise="0.05 m"))
    refuse_contradiction(own, imu())
    t = np.linspace(5.0, 35.0, 300)
    exact = build(card(write(tmp_path, name="exact.csv")))
    assert np.std(np.linalg.norm(motion(build(own), t).f_b - motion(exact, t).f_b, axis=1)) < 0.005


def test_a_parquet_file_is_the_same_flight(tmp_path):
    own = write(tmp_path)
    pd.read_csv(own["file"]).to_parquet(tmp_path / "mine.parquet")
    a, b = (motion(build(card({**own, "file": str(tmp_path / name)})), T) for name in ("mine.csv", "mine.parquet"))
    assert np.max(np.abs(a.r_i - b.r_i)) == 0.0
    assert np.max(np.abs(a.f_b - b.f_b)) == 0.0


def test_a_changed_file_is_read_again_by_the_same_card(tmp_path):
    own = card(write(tmp_path))
    first, digest = build(own), content(own)
    r, _ = path(T)
    write(tmp_path, named("xyz", r + np.array([100.0, 0.0, 0.0])))
    assert content(own) != digest
    assert motion(build(own), [0.0]).r_i[0] - motion(first, [0.0]).r_i[0] == pytest.approx([100.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"events": {"late": "81 s"}}, "event 'late' at 81 s is outside the rows, 0 to 80 s"),
        ({"moving_reference": [["cutoff", "liftoff"]]}, "'cutoff' does not come before 'liftoff'"),
        ({"file": "/nowhere/mine.csv"}, "mine.csv: cannot be read: No such file"),
        ({"time": {"column": "t", "unit": "s", "liftoff": -20.0}, "events": {"cutoff": "60 s"}}, None),
        (
            {"time": {"column": "t", "unit": "s", "liftoff": 20.0}, "pad_hold": "0 s", "events": {"cutoff": "20 s"}},
            None,
        ),
    ],
)
def test_an_event_or_file_that_is_not_there_is_refused(tmp_path, changes, fault):
    own = card(write(tmp_path, **changes))
    if fault is None:  # rows that begin before or after lift-off are as good as others
        assert {"start", "end"} <= set(build(own).events)
        return
    with pytest.raises(InputError, match=fault):
        build(own)


def test_a_moving_first_row_has_no_pad_before_it(tmp_path):
    r, v = path(T)
    fast = v + 50.0 * r[0] / np.linalg.norm(r[0])
    far = r + np.outer(T, 50.0 * r[0] / np.linalg.norm(r[0]))
    columns = {**named("xyz", far), **named(("vx", "vy", "vz"), fast)}
    with pytest.raises(InputError, match="the first row moves at 50 m/s over the Earth, so it is not on a pad"):
        build(card(write(tmp_path, columns, pad_hold="60 s")))


def test_an_attitude_that_turns_the_wrong_way_is_refused_unless_the_card_insists():
    own = example_settings()
    own["attitude"] = {**own["attitude"], "turns": "frame_to_body"}
    with pytest.raises(
        InputError,
        match=r"forces above 1 g lie 52.79 deg off the body's x axis \(median\) as .*with turns: body_to_frame: state",
    ):
        build(card(own))
    assert np.all(np.isfinite(matrices(motion(build(card(own, largest_force_angle="180 deg")), T).q_b_i)))


def test_an_attitude_noisier_than_stated_is_a_residual(tmp_path):
    # one row of the example turned by 0.1 deg, where the noise is the rounding of nine digits: the spline takes it, and
    # the rows beside tell; with a stated noise of an arc minute the spline leaves it
    own = example_settings()
    table = pd.read_csv(own["file"], comment="#")
    k = 400
    q = table.loc[k, ["q0", "q1", "q2", "q3"]].to_numpy()
    table.loc[k, ["q0", "q1", "q2", "q3"]] = q + np.array([-q[1], q[0], q[3], -q[2]]) * 0.5 * np.radians(0.1)
    table.to_csv(tmp_path / "bent.csv", index=False)
    own |= {"file": str(tmp_path / "bent.csv")}
    assert build(card(own)).facts["attitude_from_half_the_rows_worst_rad"] > np.radians(0.05)
    smooth = card(own, attitude_noise="0.2 arcsec")
    worst = max((one for one in residuals(smooth) if one.quantity == "attitude"), key=lambda one: one.size)
    assert worst.time == pytest.approx(200.0, abs=1.0)
    with pytest.raises(InputError, match=r"the spline and its attitude part by .* deg at "):
        require_consistent(residuals(smooth), imu(), "bent.csv")


IDEAL = ImuCard.model_validate(
    {
        "name": "ideal",
        "source": "test",
        "gyro": {"random_walk": 0, "bias_repeatability": 0},
        "accel": {"random_walk": 0, "bias_repeatability": 0},
    }
)


@pytest.mark.parametrize("rate", [2.0, 10.0, 50.0])
def test_rows_that_carry_all_digits_pass_an_ideal_unit(tmp_path, rate, record_property):
    t = np.arange(0.0, 80.0 + 0.5 / rate, 1.0 / rate)
    r, v = path(t)
    turn = 0.5 * 0.02 * t
    q = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * t, 0.0 * t])
    columns = {"t": t, **named("xyz", r), **named(("vx", "vy", "vz"), v), **named(("q0", "q1", "q2", "q3"), q)}
    attitude = {"form": "quaternion", "frame": "eci", "columns": ["q0", "q1", "q2", "q3"], "scalar": "first"}
    settings = write(tmp_path, columns, attitude={**attitude, "turns": "body_to_frame"})
    own = card(settings, largest_force_angle="180 deg")
    worst = {what: max(one.size for one in residuals(own) if one.quantity == what) for what in PRECISION}
    assert worst["position"] > 0.0
    record_property(f"rows of all digits at {rate:g} Hz, worst residuals", worst)
    refuse_contradiction(own, IDEAL)


def test_a_file_without_events_suggests_them_where_its_force_jumps(tmp_path):
    flight = build(card(write(tmp_path, events={})))
    (line,) = (one.text for one in flight.remarks if one.category == WARNING)
    assert line.endswith("as YAML: events: {fall_1: 40.00 s}")
    assert build(card(write(tmp_path))).remarks == ()
    assert build(card(example_settings())).remarks == ()
    with pytest.raises(
        InputError, match=r"does the reference point move\? the specific force jumps .*fall_1: 40\.00 s"
    ):
        refuse_contradiction(card(write(tmp_path, events={})), imu())


def test_a_refusal_of_the_shipped_example_without_events_brings_those_that_let_it_fly():
    own = example_settings()
    with pytest.raises(InputError, match=r"the position steps by .* where no event is declared") as caught:
        build(card(own, events={}))
    found = YAML(typ="safe").load(str(caught.value).partition("as YAML: ")[2])["events"]
    times = {"stage1_cutoff": 150.4932, "stage2_ignition": 158.4932, "stage2_cutoff": 549.3082}
    assert list(found) == list(times)
    assert all(float(found[name].split()[0]) == pytest.approx(time, abs=0.05) for name, time in times.items())
    assert build(card(own, events=found)).remarks == ()
    (line,) = (one.text for one in build(card(own, events={**found, "stage2_ignition": "200 s"})).remarks)
    assert "events: {stage2_ignition: 158.49 s}" in line


def test_a_step_at_an_undeclared_event_is_refused_with_the_events_that_the_force_suggests(tmp_path):
    r, _ = path(T)
    settings = write(tmp_path, named("xyz", r + np.outer(T >= BREAK, [3.0, 0.0, 4.0])), events={})
    with pytest.raises(InputError, match=r"where no event is declared: .* events: \{fall_1: 40\.00 s\}"):
        build(card(settings))


def test_holes_are_said_and_a_gap_after_the_last_event_ends_the_flight(tmp_path):
    t = np.arange(0.0, 80.0, 1.0 / 30.0)
    t = t[~((t > 20.0) & (t < 20.8)) & ~((t > 60.0) & (t < 75.0))]
    r, v = path(t)
    flight = build(card(write(tmp_path, {"t": t, **named("xyz", r), **named(("vx", "vy", "vz"), v)})))
    first, second = (one.text for one in flight.remarks if one.category == NOTE)
    assert first.startswith("no data from 20 to 20.8 s")
    assert second.startswith("no data from 60 to 75 s, after the last event: the flight ends there")
    assert flight.end == pytest.approx(60.0)
    between = np.linspace(20.0, 20.8, 9)
    assert np.max(np.linalg.norm(motion(flight, between).r_i - path(between)[0], axis=1)) < 1e-3
