"""A radar altimeter in both engines: what it measures and when, and that they agree on what it does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.engines.adjoint import Backward
from lvnav_trade.engines.altimeter import NOISE, altimeter_of, height_of
from lvnav_trade.engines.lincov import adjoint, covariance
from lvnav_trade.engines.montecarlo import run_block
from lvnav_trade.engines.observability import observability
from lvnav_trade.observables.altitude import AltimeterCard
from lvnav_trade.scenario import Scenario
from lvnav_trade.store.tables import _channel_names
from tests.building import INERTIAL, LOOSE, MATCHED, hop, loaded, prepare_hop, with_fields

RADAR = {"kind": "altimeter", "name": "test", "source": "none", "sigma": "0.3 m", "bias": "1 m", "highest": "400 km"}
N_RUN = 400
DOWN = 8


def scenario(*settings, radar=RADAR, **fields):
    base = loaded(MATCHED, *settings)
    listed = [*base.filter.measurements, *(["altitude"] if radar else [])]
    card = with_fields(base.filter, measurements=listed, **fields)
    return base.model_copy(update={"sensors": {"radar": radar and AltimeterCard.model_validate(radar)}, "filter": card})


def modelled(**numbers):
    """Filter fields: the altimeter is modelled by these numbers."""
    return {"sensor_models": {"altitude": numbers}}


def sigma_down(case):
    return covariance(prepare_hop(case)).true_sigma[-1, DOWN]


def test_it_measures_between_its_lowest_and_highest_height_and_noise_grows_with_height():
    prepared = prepare_hop(scenario(LOOSE))
    t, card = prepared.t_epoch, AltimeterCard.model_validate({**RADAR, "share": "1 percent"})
    found = height_of(scenario(LOOSE).model_copy(update={"sensors": {"radar": card}}), hop(), t)
    np.testing.assert_allclose(found.sigma, np.hypot(0.3, 0.01 * found.true))
    np.testing.assert_allclose(found.variance, found.sigma**2)
    middle = float(np.median(found.true))
    card = card.model_copy(update={"highest": middle})
    below = height_of(scenario(LOOSE).model_copy(update={"sensors": {"radar": card}}), hop(), t)
    np.testing.assert_array_equal(below.on, below.true <= middle)
    assert 0 < np.count_nonzero(below.on) < t.size


def test_there_is_none_without_a_card_or_for_an_inertial_system():
    assert altimeter_of(height_of(scenario(LOOSE, radar=None), hop(), np.zeros(1))) is None
    assert prepare_hop(scenario(INERTIAL, radar=None)).options.altimeter is None
    unused = scenario(LOOSE, radar=None).model_copy(update={"sensors": scenario(LOOSE).sensors})
    assert prepare_hop(unused).options.altimeter is None


@pytest.mark.parametrize("settings", [(LOOSE,), ()], ids=["loose", "tight"])
def test_both_engines_agree_on_what_it_does_bias_and_all(settings):
    prepared = prepare_hop(scenario(*settings))
    cov, block = covariance(prepared), run_block(prepared, 7, 0, N_RUN)
    ratio = np.sqrt((block.err[:, -1, 6:9] ** 2).mean(axis=0)) / cov.true_sigma[-1, 6:9]
    # 1.96 / sqrt(2 n) is 95 %; three axes at once, 99.9 %: 3.5 / sqrt(2 n)
    np.testing.assert_allclose(ratio, 1.0, atol=3.5 / math.sqrt(2 * N_RUN))
    assert np.all(np.isfinite(block.innovation[:, :, -1]))
    assert int(cov.n_row[0]) == int(block.n_row[0, 0])
    assert _channel_names(prepared, block.innovation.shape[2])[-1] == "height"


def test_a_good_one_improves_the_height_and_a_bad_one_is_told_by_linear_covariance():
    without = sigma_down(scenario(LOOSE, radar=None))
    good = sigma_down(scenario(LOOSE, radar={**RADAR, "bias": "0 m", "sigma": "0.1 m"}))
    assert good < 0.3 * without
    assert sigma_down(scenario(LOOSE, radar={**RADAR, "bias": "5 m"})) > 2.0 * without
    unknown = scenario(LOOSE, radar={**RADAR, "bias": "5 m"}, **modelled(sigma="50 m"))
    assert sigma_down(unknown) == pytest.approx(without, rel=0.1)  # a filter that does not trust it


def test_what_the_filter_believes_of_it_decides_how_it_is_weighed():
    trusted, doubted = (
        sigma_down(scenario(LOOSE, **modelled(sigma=sigma, share=share)))
        for sigma, share in (("0.3 m", "0 percent"), ("0.3 m", "1 percent"))
    )
    assert trusted != doubted


def test_the_budget_backwards_is_the_budget_forwards():
    prepared = prepare_hop(scenario(LOOSE))
    cov, back = covariance(prepared), adjoint(prepared, prepared.t_hist[-1])
    np.testing.assert_allclose(back.contribution[DOWN].sum(axis=1), cov.budget[-1, :, DOWN], rtol=1e-6, atol=1e-12)
    at = cov.sources.index(NOISE)
    assert back.contribution[DOWN, at].sum() > 0.0
    assert "altimeter bias" in cov.sources
    assert Backward._fields[0] == "e"


def test_its_rows_count_in_what_a_stretch_can_tell():
    (one,) = observability(prepare_hop(scenario(LOOSE)), np.array([0.0, 30.0]))
    (none,) = observability(prepare_hop(scenario(LOOSE, radar=None)), np.array([0.0, 30.0]))
    assert one.rows == none.rows + 30


def test_an_open_loop_takes_it_too():
    closed, opened = (
        run_block(prepare_hop(scenario(LOOSE, feedback=loop)), 3, 0, 8).err[:, -1, 6:9] for loop in ("closed", "open")
    )
    np.testing.assert_allclose(opened, closed, atol=0.01)  # m


@pytest.mark.parametrize(
    "setting",
    [
        "receiver.solution={kind: bancroft, range_sigma: 2 m, rate_sigma: 0.1 m/s}",
        "filter.delay_compensation={kind: extrapolated}",
    ],
)
def test_where_it_is_not_modelled_is_told_in_one_line(setting):
    case = load("campaigns/smoke.yaml", [LOOSE, f"base.{setting}"]).base
    data = {**case.model_dump(mode="json"), "sensors": {"radar": RADAR}}
    data["filter"]["measurements"].append("altitude")
    with pytest.raises(ValueError, match="altitude: not with"):
        Scenario.model_validate(data)
