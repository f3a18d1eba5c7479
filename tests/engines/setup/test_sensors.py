"""Sensors beside the receiver in both engines: what they measure and when, and that the engines agree on it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.engines.analysis.observability import observability
from lvnav_trade.engines.lincov.history import adjoint, covariance
from lvnav_trade.engines.setup.sensors import for_kernels, measures, sensors_of
from lvnav_trade.engines.simulate.montecarlo import run_block
from lvnav_trade.errors import InputError
from lvnav_trade.observables.altitude import AltimeterCard
from lvnav_trade.observables.sensors import ALTIMETER, ATTITUDE_REFERENCE
from lvnav_trade.world.conditions import Course
from tests.building import INERTIAL, LOOSE, MATCHED, hop, loaded, prepare_hop, with_fields
from tests.engines.modelled import BASELINE, PUBLISHED, SETTINGS, modelled, named

RADAR = {"kind": "altimeter", "name": "test", "source": "none", "sigma": "0.3 m", "highest": "400 km"}
COURSE = Course({"liftoff": 0.0, "stage1_cutoff": 20.0})
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
    height, speed, _ = trajectory.course.sampled(SOON)
    expected = (height < 184e3) & (speed < 4650.0)
    assert 0 < expected.sum() < expected.size
    np.testing.assert_array_equal(sensor.on, expected)


def test_both_engines_take_an_altimeter_only_when_it_measures_and_agree():
    prepared = prepare_hop(radar(rate="0.5 Hz", until="15 s"))
    cov, block = covariance(prepared), run_block(prepared, 7, 0, N_RUN)
    taken = np.isfinite(block.innovation[0, :, -1])
    np.testing.assert_array_equal(prepared.t_epoch[taken] % 2.0, 0.0)
    assert 0 < prepared.t_epoch[taken].max() < 15.0
    np.testing.assert_array_equal(cov.n_row, block.n_row[0])
    ratio = np.sqrt((block.err[:, -1, 6:9] ** 2).mean(axis=0)) / cov.true_sigma[-1, 6:9]
    # three axes at once, 99.9 %: 3.5 / sqrt(2 n)
    np.testing.assert_allclose(ratio, 1.0, atol=3.5 / math.sqrt(2 * N_RUN))


def test_both_engines_take_an_attitude_reference_only_when_it_measures_and_agree():
    whole = loaded(*SETTINGS, PUBLISHED, BASELINE)
    card = whole.sensors["attitude_reference"]
    late = {"late": {**card.model_dump(mode="json"), "from": "20 s", "rate": "0.5 Hz"}}
    prepared = prepare_hop(with_fields(whole, sensors=late), named())
    cov, block = covariance(prepared), run_block(prepared, 5, 0, N_RUN)
    taken = np.isfinite(block.innovation[0, :, 6])
    np.testing.assert_array_equal(prepared.t_epoch[taken], np.arange(20.0, prepared.t_epoch[-1] + 0.5, 2.0))
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
    np.testing.assert_array_equal(below.on, height <= middle)
    assert 0 < np.count_nonzero(below.on) < t.size


def test_there_is_none_without_a_card_or_for_a_filter_that_does_not_list_it():
    assert sensors_of(without_radar(), hop(), np.zeros(1)) == ()
    assert prepare_hop(without_radar(INERTIAL)).devices == ()
    unused = without_radar().model_copy(update={"sensors": {"radar": AltimeterCard.model_validate(RADAR)}})
    assert prepare_hop(unused).devices == ()


def test_two_sensors_of_one_kind_go_by_their_own_names_and_have_channels_and_noise_of_their_own():
    one = radar()
    two = with_fields(one, sensors={"port": {**RADAR, "sigma": "1 m"}, "starboard": {**RADAR, "sigma": "2 m"}})
    prepared = prepare_hop(two)
    assert prepared.channel_names[-2:] == ("port", "starboard")
    assert [device.noise for device in prepared.devices] == ["altimeter noise port", "altimeter noise starboard"]
    numbers = for_kernels(prepared.devices, prepared.channels, np.zeros(prepared.t_epoch.size))
    assert numbers.code.tolist() == [ALTIMETER, ALTIMETER] != [ATTITUDE_REFERENCE]
    assert numbers.channel.tolist() == [6, 7]
    assert len(set(numbers.sources.tolist())) == 2
    block, cov = run_block(prepared, 7, 0, 8), covariance(prepared)
    assert np.isfinite(block.innovation[:, :, 6:]).all()
    assert not np.any(block.innovation[:, :, 6] == block.innovation[:, :, 7])
    budget = dict(zip(cov.sources, cov.budget[-1, :, DOWN], strict=True))
    assert budget["altimeter noise port"] > budget["altimeter noise starboard"] > 0.0


@pytest.mark.parametrize("settings", [(LOOSE,), ("base.filter=filters/tight",)], ids=["loose", "tight"])
def test_both_engines_agree_on_what_an_altimeter_does_bias_and_all(settings):
    prepared = prepare_hop(radar(*settings))
    cov, block = covariance(prepared), run_block(prepared, 7, 0, N_RUN)
    ratio = np.sqrt((block.err[:, -1, 6:9] ** 2).mean(axis=0)) / cov.true_sigma[-1, 6:9]
    # 1.96 / sqrt(2 n) is 95 %; three axes at once, 99.9 %: 3.5 / sqrt(2 n)
    np.testing.assert_allclose(ratio, 1.0, atol=3.5 / math.sqrt(2 * N_RUN))
    assert np.all(np.isfinite(block.innovation[:, :, -1]))
    assert int(cov.n_row[0]) == int(block.n_row[0, 0])
    assert prepared.channel_names[-1] == "altitude"


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
    prepared = prepare_hop(radar())
    cov, back = covariance(prepared), adjoint(prepared, prepared.t_hist[-1])
    np.testing.assert_allclose(back.contribution[DOWN].sum(axis=1), cov.budget[-1, :, DOWN], rtol=1e-6, atol=1e-12)
    at = cov.sources.index("altimeter noise")
    assert back.contribution[DOWN, at].sum() > 0.0
    assert "altimeter bias" in cov.sources


def test_its_rows_count_in_what_a_stretch_can_tell():
    (one,) = observability(prepare_hop(radar()), np.array([0.0, 30.0]))
    (none,) = observability(prepare_hop(without_radar()), np.array([0.0, 30.0]))
    assert one.rows == none.rows + 30


def test_an_open_loop_takes_it_too():
    closed, opened = (
        run_block(prepare_hop(with_fields(radar(), **{"filter.feedback": loop})), 3, 0, 8).err[:, -1, 6:9]
        for loop in ("closed", "open")
    )
    np.testing.assert_allclose(opened, closed, atol=0.01)  # m


def test_it_stands_beside_a_receiver_with_a_filter_of_its_own_and_one_run_is_a_lane():
    prepared = prepare_hop(with_fields(radar(), **{"receiver.solution": FILTERED, "faults": []}))
    block, alone = run_block(prepared, 7, 0, N_RUN), run_block(prepared, 7, 5, 1, lanes=False)
    off = [np.abs(getattr(block, name)[5] - getattr(alone, name)[0]) / block.sigma[5] for name in ("err", "sigma")]
    assert max(array.max() for array in off) < 1e-8
    history = covariance(prepared)
    ratio = np.sqrt((block.err[:, -1, 6:9] ** 2).mean(axis=0)) / np.hypot(
        history.true_sigma[-1, 6:9], history.mean[-1, 6:9]
    )
    np.testing.assert_allclose(ratio, 1.0, atol=3.5 / math.sqrt(2 * N_RUN))
    back = adjoint(prepared, prepared.t_hist[-1])
    np.testing.assert_allclose(back.contribution.sum(axis=(1, 2)), history.true_sigma[-1, :9] ** 2, rtol=1e-8)
