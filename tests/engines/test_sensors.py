"""When sensors measure: rate and window, in both engines."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.engines.lincov.history import covariance
from lvnav_trade.engines.montecarlo import run_block
from lvnav_trade.engines.sensors import measures, window
from lvnav_trade.errors import InputError
from tests.building import LOOSE, MATCHED, loaded, prepare_hop, with_fields
from tests.engines.modelled import BASELINE, PUBLISHED, SETTINGS, modelled, named

RADAR = {"kind": "altimeter", "name": "test", "source": "none", "sigma": "0.3 m", "highest": "400 km"}
EVENTS = {"liftoff": 0.0, "stage1_cutoff": 20.0}
T = np.arange(-3.0, 31.0)
N_RUN = 400


def radar(**fields):
    base = loaded(MATCHED, LOOSE)
    listed = [*base.filter.measurements, "altitude"]
    return with_fields(base, **{"sensors": {"radar": {**RADAR, **fields}}, "filter.measurements": listed})


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
    np.testing.assert_array_equal(T[measures(case, case.sensors["radar"], EVENTS, T)], expected)


def test_a_window_without_ends_is_the_whole_flight_and_an_unknown_event_is_named():
    assert window(radar().sensors["radar"], EVENTS) == (-math.inf, math.inf)
    with pytest.raises(InputError, match="no event 'stage9_cutoff'"):
        window(radar(**{"from": "stage9_cutoff"}).sensors["radar"], EVENTS)


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
