"""Sensors beside the receiver in both engines: what they measure and when, and that the engines agree on it."""

from __future__ import annotations

import math
from unittest.mock import patch

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics.observability import observability
from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.quantities.conditions import FlightProfile
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.sensors.altimeter import AltimeterCard
from lvnav_trade.sensors.attitude_reference import AttitudeReferenceCard
from lvnav_trade.sensors.family import SENSORS
from lvnav_trade.sensors.sensor import CorrelatedError, each_scalar
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.sensors import flight_view, measures, sensor_arrays, sensors_of
from lvnav_trade.trajectory.flight import motion
from tests.both_engines.modelled import BASELINE, PUBLISHED, SETTINGS, modelled, named
from tests.building import INERTIAL, LOOSE, MATCHED, hop, loaded, prepare_hop, with_fields

RADAR = {"kind": "altimeter", "name": "test", "source": "none", "sigma": "0.3 m", "highest": "400 km"}
COURSE = FlightProfile({"liftoff": 0.0, "stage1_cutoff": 20.0})
T = np.arange(-3.0, 31.0)
SOON = T[T > 0.0]
N_RUN = 400
DOWN = 8
FILTERED = {
    "kind": "filtered", "range_sigma": "2 m", "rate_sigma": "0.1 m/s", "jerk": "10 m/s^3",
    "clock_noise": "0.1 m/s^2", "start_acceleration": "50 m/s^2",
}  # fmt: skip


def radar(*settings, model=None, **fields):
    """The short flight's scenario with a radar altimeter; model: the filter's numbers of it, where they are its own."""
    base = loaded(MATCHED, *(settings or (LOOSE,)))
    changed = {"filter.measurements": [*base.filter.measurements, "altitude"]}
    if model:
        changed["filter.sensor_models"] = {"altitude": model}
    return with_fields(base, **{"sensors": {"radar": {**RADAR, "bias": "1 m", **fields}}, **changed})


def without_radar(*settings):
    return loaded(MATCHED, *(settings or (LOOSE,)))


def sigma_down(case):
    return covariance(prepare_hop(case)).true_sigma[-1, DOWN]


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({}, T),
        ({"from": "stage1_cutoff"}, T[T >= 20.0]),
        ({"from": "4 s", "until": "stage1_cutoff - 2 s"}, np.arange(4.0, 18.0)),
        ({"rate": "0.2 Hz"}, np.arange(0.0, 31.0, 5.0)),
        ({"rate": "0.5 Hz", "from": "5 s", "until": "9 s"}, [6.0, 8.0]),
        ({"rate": "1 Hz"}, T),
    ],
)
def test_it_measures_within_its_window_at_multiples_of_its_interval(fields, expected):
    case = radar(**fields)
    np.testing.assert_array_equal(T[measures(case, case.sensors["radar"], COURSE, T)], expected)


def test_a_window_without_ends_is_the_whole_flight_and_an_unknown_event_is_named():
    assert COURSE.window(radar().sensors["radar"]) == (-math.inf, math.inf)
    case = radar(**{"from": "stage9_cutoff"})
    with pytest.raises(InputError, match="no event 'stage9_cutoff'"):
        measures(case, case.sensors["radar"], COURSE, T)


def test_it_measures_where_the_flight_meets_its_conditions_and_nowhere_else():
    case = radar(below="184 km", speed_below="4.65 km/s")
    trajectory = hop()
    (sensor,) = sensors_of(case, trajectory, SOON)
    height, speed, _ = trajectory.flight_profile.values_at(SOON)
    expected = (height < 184e3) & (speed < 4650.0)
    assert 0 < expected.sum() < expected.size
    np.testing.assert_array_equal(sensor.is_measuring, expected)


@pytest.mark.slow  # kernels of its own
def test_both_engines_take_an_altimeter_only_when_it_measures_and_agree():
    prepared_case = prepare_hop(radar(rate="0.5 Hz", until="15 s"))
    cov, block = covariance(prepared_case), run_block(prepared_case, 7, 0, N_RUN)
    taken = np.isfinite(block.innovation[0, :, -1])
    np.testing.assert_array_equal(prepared_case.t_epoch[taken] % 2.0, 0.0)
    assert 0 < prepared_case.t_epoch[taken].max() < 15.0
    np.testing.assert_array_equal(cov.n_row, block.n_row[0])
    ratio = np.sqrt((block.err[:, -1, 6:9] ** 2).mean(axis=0)) / cov.true_sigma[-1, 6:9]
    # three axes at once, 99.9 %: 3.5 / sqrt(2 n)
    np.testing.assert_allclose(ratio, 1.0, atol=3.5 / math.sqrt(2 * N_RUN))


@pytest.mark.slow  # a kernel of its own, most of half a minute to compile
def test_both_engines_take_an_attitude_reference_only_when_it_measures_and_agree():
    whole = loaded(*SETTINGS, PUBLISHED, BASELINE)
    card = whole.sensors["attitude_reference"]
    late = {"late": {**card.model_dump(mode="json"), "from": "20 s", "rate": "0.5 Hz"}}
    prepared_case = prepare_hop(with_fields(whole, sensors=late), named())
    cov, block = covariance(prepared_case), run_block(prepared_case, 5, 0, N_RUN)
    taken = np.isfinite(block.innovation[0, :, 6])
    np.testing.assert_array_equal(prepared_case.t_epoch[taken], np.arange(20.0, prepared_case.t_epoch[-1] + 0.5, 2.0))
    np.testing.assert_array_equal(cov.n_row, block.n_row[0])
    ratio = np.sqrt((block.err[:, -1, :3] ** 2).mean(axis=0)) / cov.true_sigma[-1, :3]
    np.testing.assert_allclose(ratio, 1.0, atol=3.5 / math.sqrt(2 * N_RUN))
    assert cov.true_sigma[-1, 0] != covariance(modelled(BASELINE)).true_sigma[-1, 0]


def test_it_measures_between_its_lowest_and_highest_height_and_noise_grows_with_height():
    t = prepare_hop(radar()).t_epoch
    (found,) = sensors_of(radar(share="1 percent"), hop(), t)
    height = found.truth[:, 0]
    np.testing.assert_allclose(found.sigma[:, 0], np.hypot(0.3, 0.01 * height))
    np.testing.assert_allclose(found.variance, found.sigma**2)
    middle = float(np.median(height))
    (below,) = sensors_of(radar(highest=f"{middle} m"), hop(), t)
    np.testing.assert_array_equal(below.is_measuring, height <= middle)
    assert 0 < np.count_nonzero(below.is_measuring) < t.size


def test_there_is_none_without_a_card_or_for_a_filter_that_does_not_list_it():
    assert sensors_of(without_radar(), hop(), np.zeros(1)) == ()
    assert prepare_hop(without_radar(INERTIAL)).devices == ()
    unused = without_radar().model_copy(update={"sensors": {"radar": AltimeterCard.model_validate(RADAR)}})
    assert prepare_hop(unused).devices == ()


def test_two_sensors_of_one_kind_go_by_their_own_names_and_have_channels_and_noise_of_their_own():
    one = radar()
    two = with_fields(one, sensors={"port": {**RADAR, "sigma": "1 m"}, "starboard": {**RADAR, "sigma": "2 m"}})
    prepared_case = prepare_hop(two)
    assert prepared_case.channel_names[-2:] == ("port", "starboard")
    assert [device.noise for device in prepared_case.devices] == ["altimeter noise port", "altimeter noise starboard"]
    numbers = sensor_arrays(prepared_case.devices, prepared_case.channels, prepared_case.t_epoch.size)
    assert [SENSORS[code] for code in numbers.code] == [AltimeterCard, AltimeterCard]
    assert numbers.channel.tolist() == [6, 7]
    assert len(set(numbers.source_keys.tolist())) == 2
    block, cov = run_block(prepared_case, 7, 0, 8), covariance(prepared_case)
    assert np.isfinite(block.innovation[:, :, 6:]).all()
    assert not np.any(block.innovation[:, :, 6] == block.innovation[:, :, 7])
    budget = dict(zip(cov.sources, cov.budget[-1, :, DOWN], strict=True))
    assert budget["altimeter noise port"] > budget["altimeter noise starboard"] > 0.0


@pytest.mark.parametrize("settings", [(LOOSE,), ("base.filter=filters/tight",)], ids=["loose", "tight"])
def test_both_engines_agree_on_what_an_altimeter_does_bias_and_all(settings):
    prepared_case = prepare_hop(radar(*settings))
    cov, block = covariance(prepared_case), run_block(prepared_case, 7, 0, N_RUN)
    ratio = np.sqrt((block.err[:, -1, 6:9] ** 2).mean(axis=0)) / cov.true_sigma[-1, 6:9]
    # 1.96 / sqrt(2 n) is 95 %; three axes at once, 99.9 %: 3.5 / sqrt(2 n)
    np.testing.assert_allclose(ratio, 1.0, atol=3.5 / math.sqrt(2 * N_RUN))
    assert np.all(np.isfinite(block.innovation[:, :, -1]))
    assert int(cov.n_row[0]) == int(block.n_row[0, 0])
    assert prepared_case.channel_names[-1] == "altitude"


def test_a_good_one_improves_the_height_and_a_bad_one_is_reported_by_linear_covariance():
    without = sigma_down(without_radar())
    assert sigma_down(radar(bias="0 m", sigma="0.1 m")) < 0.3 * without
    assert sigma_down(radar(bias="5 m")) > 2.0 * without
    unknown = radar(bias="5 m", model={"sigma": "50 m"})
    assert sigma_down(unknown) == pytest.approx(without, rel=0.1)  # a filter that does not trust it


def test_what_the_filter_assumes_of_it_decides_how_it_is_weighed():
    trusted, doubted = (
        sigma_down(radar(model={"sigma": sigma, "share": share}))
        for sigma, share in (("0.3 m", "0 percent"), ("0.3 m", "1 percent"))
    )
    assert trusted != doubted


def test_the_budget_backwards_is_the_budget_forwards():
    prepared_case = prepare_hop(radar())
    cov, back = covariance(prepared_case), adjoint(prepared_case, prepared_case.t_hist[-1])
    np.testing.assert_allclose(back.contribution[DOWN].sum(axis=1), cov.budget[-1, :, DOWN], rtol=1e-6, atol=1e-12)
    at = cov.sources.index("altimeter noise")
    assert back.contribution[DOWN, at].sum() > 0.0
    assert "altimeter bias" in cov.sources


def test_its_rows_count_in_what_a_stretch_can_tell():
    (one,) = observability(prepare_hop(radar()), np.array([0.0, 30.0]))
    (none,) = observability(prepare_hop(without_radar()), np.array([0.0, 30.0]))
    assert one.measurement_count == none.measurement_count + 30


@pytest.mark.slow  # a kernel of its own; a late sensor in an open loop is below
def test_an_open_loop_takes_it_too():
    closed, opened = (
        run_block(prepare_hop(with_fields(radar(), **{"filter.feedback": loop})), 3, 0, 8).err[:, -1, 6:9]
        for loop in ("closed", "open")
    )
    np.testing.assert_allclose(opened, closed, atol=0.01)  # m


@pytest.mark.slow
def test_it_stands_beside_a_receiver_with_a_filter_of_its_own_and_one_run_is_a_lane():
    prepared_case = prepare_hop(with_fields(radar(), **{"receiver.solution": FILTERED, "faults": []}))
    block, alone = run_block(prepared_case, 7, 0, N_RUN), run_block(prepared_case, 7, 5, 1, uses_lanes=False)
    off = [np.abs(getattr(block, name)[5] - getattr(alone, name)[0]) / block.sigma[5] for name in ("err", "sigma")]
    assert max(array.max() for array in off) < 1e-8
    history = covariance(prepared_case)
    ratio = np.sqrt((block.err[:, -1, 6:9] ** 2).mean(axis=0)) / np.hypot(
        history.true_sigma[-1, 6:9], history.mean[-1, 6:9]
    )
    np.testing.assert_allclose(ratio, 1.0, atol=3.5 / math.sqrt(2 * N_RUN))
    back = adjoint(prepared_case, prepared_case.t_hist[-1])
    np.testing.assert_allclose(back.contribution.sum(axis=(1, 2)), history.true_sigma[-1, :9] ** 2, rtol=1e-8)


def agree(prepared_case, columns, runs=N_RUN, seed=7):
    """Both engines at the end of the flight; mean and spread of Monte Carlo are those of linear covariance."""
    cov, block = covariance(prepared_case), run_block(prepared_case, seed, 0, runs)
    expected = np.hypot(cov.true_sigma[-1, columns], cov.mean[-1, columns])
    ratio = np.sqrt((block.err[:, -1, columns] ** 2).mean(axis=0)) / expected
    # a handful of columns at once, 99.9 %: 3.5 / sqrt(2 n)
    np.testing.assert_allclose(ratio, 1.0, atol=3.5 / math.sqrt(2 * runs))
    back = adjoint(prepared_case, prepared_case.t_hist[-1])
    np.testing.assert_allclose(back.contribution.sum(axis=(1, 2)), cov.true_sigma[-1, :9] ** 2, rtol=1e-7)
    return cov, block


@pytest.mark.parametrize("field", ["extra_states", "consider"])
@pytest.mark.parametrize("settings", [(LOOSE,), ("base.filter=filters/tight",)], ids=["loose", "tight"])
def test_a_bias_is_a_state_or_considered_and_both_engines_agree(field, settings):
    case = radar(*settings, bias="5 m")
    known = prepare_hop(with_fields(case, **{f"filter.{field}": ["altitude_bias"]}))
    (at,) = [k for k, output in enumerate(known.outputs) if output.quantity == "altitude_bias"]
    assert known.outputs[at][1:3] == ("all", "m")
    cov, _ = agree(known, [6, 7, 8, at])
    assert cov.true_sigma[-1, DOWN] < 0.5 * sigma_down(case)  # a filter that knows nothing of it follows it
    np.testing.assert_allclose(cov.formal_sigma[-1, [8, at]], cov.true_sigma[-1, [8, at]], rtol=1e-3)


def test_a_state_follows_the_numbers_of_the_filter_card():
    own = {"altitude": {"sigma": "0.3 m", "bias": "0.01 m", "bias_time": "20 s"}}
    fields = {"filter.extra_states": ["altitude_bias"], "filter.sensor_models": own}
    prepared_case = prepare_hop(with_fields(radar(bias="5 m"), **fields))
    (block,) = prepared_case.layout.extras
    assert (block.sigma, block.time_constant, block.labels) == (0.01, 20.0, ("",))
    assert prepare_hop(with_fields(radar(bias="5 m"), **{"filter.sensor_models": own})).layout.extras == ()


OWN = {"kind": "attitude_reference", "name": "test", "source": "none", "sigma": "1 mrad"}
FIXED = CorrelatedError("mount", "mount", 2e-3, "sigma", math.inf, ("x", "y"), each_scalar(3, 0, 1))
SLOW = CorrelatedError("drift", "drift", 1e-3, "sigma", 5.0, ("a", "b", "c"), lambda view: matrices(view.q_b_i))


def referenced(**fields):
    base = loaded(MATCHED, LOOSE)
    listed = [*base.filter.measurements, "attitude"]
    return with_fields(base, **{"sensors": {"one": {**OWN, **fields}}, "filter.measurements": listed})


def test_lasting_errors_act_on_scalars_of_their_own_or_by_partials_in_both_engines():
    """FIXED: a constant error of each of two axes; SLOW: Gauss-Markov errors of body axes, seen in frame i."""
    only = with_fields(referenced(), **{"filter.measurements": ["attitude"]})
    alone = covariance(prepare_hop(only))
    with patch.object(AttitudeReferenceCard, "correlated_errors", lambda _: (FIXED, SLOW)):
        prepared_case = prepare_hop(only)
        shared = prepared_case.signals.correlated_errors
        assert shared.initial_sigma.tolist() == [2e-3] * 2 + [1e-3] * 3
        assert len({*zip(shared.source_keys.tolist(), shared.satellite_keys.tolist(), strict=True)}) == 5
        np.testing.assert_array_equal(
            shared.member[:, 6:9] >= 0, [[1, 0, 0], [0, 1, 0], [1, 1, 1], [1, 1, 1], [1, 1, 1]]
        )
        body = matrices(flight_view(prepared_case.trajectory, prepared_case.t_epoch).q_b_i)
        np.testing.assert_array_equal(np.moveaxis(shared.partial[2:, :, 6:9], 0, 2), body)
        cov, _ = agree(prepared_case, [0, 1, 2])
    budget = dict(zip(cov.sources, cov.budget[-1], strict=True))
    assert budget["mount"][:3].sum() == pytest.approx(2.0 * 2e-3**2, rel=0.2)  # constant: not averaged
    assert 0.0 < budget["drift"][:3].sum() < 3.0 * 1e-3**2
    assert "mount" not in alone.sources


def test_two_sensors_of_one_kind_draw_lasting_errors_of_their_own():
    case = with_fields(radar(), sensors={name: {**RADAR, "bias": "2 m"} for name in ("port", "starboard")})
    prepared_case = prepare_hop(case)
    assert len(set(prepared_case.signals.correlated_errors.source_keys[-2:].tolist())) == 2
    cov, _ = agree(prepared_case, [6, 7, 8])
    assert {"altimeter bias port", "altimeter bias starboard"} < set(cov.sources)


LATENCY = 0.13


def test_a_latency_that_is_not_compensated_acts_in_both_engines_as_an_error():
    now, then = (prepare_hop(referenced(latency=f"{late} s", sigma="0.1 mrad")) for late in (0.0, LATENCY))
    turned = then.devices[0].truth
    np.testing.assert_allclose(turned, motion(then.trajectory, then.t_epoch - LATENCY).q_b_i, atol=1e-15)
    cov, block = agree(then, [0, 1, 2], runs=48)
    # the body turns by 4 deg/s about its x axis and by 1 deg/s across it: a measurement of before is behind by as much
    behind = np.linalg.norm(motion(then.trajectory, np.array([25.0])).w_ib_b) * LATENCY
    assert np.linalg.norm(block.err[:, -1, :3].mean(axis=0)) == pytest.approx(behind, rel=0.05)
    assert np.linalg.norm(cov.mean[-1, :3]) == pytest.approx(behind, rel=0.05)
    assert np.linalg.norm(covariance(now).mean[-1, :3]) < 1e-9


@pytest.mark.slow  # a kernel each
@pytest.mark.parametrize("feedback", ["closed", "open"])
@pytest.mark.parametrize("latency", [LATENCY, 0.333, 1.4])
def test_a_buffered_sensor_is_compared_with_the_state_of_its_time(feedback, latency):
    """333 ms are between two ticks, 1.4 s are more than an interval of the filter."""
    case = referenced(latency=f"{latency} s", sigma="0.5 mrad")
    on_time = covariance(prepare_hop(referenced(sigma="0.5 mrad")))
    case = with_fields(case, **{"filter.delay_compensation": {"kind": "buffered"}, "filter.feedback": feedback})
    prepared_case = prepare_hop(case)
    delays = prepared_case.options.delay_processing
    assert delays.n_ring.tolist() == [1, math.floor(latency) + 1]
    assert delays.line.tolist() == [0] * 6 + [1] * 3
    cov, _ = agree(prepared_case, [0, 1, 2, 3, 4, 5])
    assert np.linalg.norm(cov.mean[-1, :3]) < 2e-6  # 0.4 arcsec
    np.testing.assert_allclose(cov.true_sigma[-1, :3], on_time.true_sigma[-1, :3], rtol=0.2)


def test_a_latency_of_a_sensor_alone_is_compensated_and_what_the_filter_takes_it_for_is_its_own():
    case = referenced(latency="0.2 s")
    alone = {"filter.measurements": ["attitude"], "filter.delay_compensation": {"kind": "buffered"}}
    own = {"filter.sensor_models": {"attitude": {"sigma": "1 mrad", "latency": "0.1 s"}}}
    matched, stated = (prepare_hop(with_fields(case, **alone, **more)) for more in ({}, own))
    assert matched.options.delay_processing.line.tolist() == [-1] * 6 + [0] * 3
    assert np.linalg.norm(covariance(matched).mean[-1, :3]) < 2e-6
    behind = np.linalg.norm(motion(stated.trajectory, np.array([25.0])).w_ib_b) * 0.1
    assert np.linalg.norm(agree(stated, [0, 1, 2], runs=48)[0].mean[-1, :3]) == pytest.approx(behind, rel=0.05)
