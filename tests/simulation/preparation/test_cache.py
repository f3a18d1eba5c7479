"""Cases that see the same sky share it; whatever it depends on makes another."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.gnss.constellation import AlmanacConstellation
from lvnav_trade.gnss.satellites import file_digests
from lvnav_trade.quantities.reads import FieldReads
from lvnav_trade.simulation.preparation import cache
from tests.building import hop, loaded

T = np.arange(1.0, 30.0)


def seen(*settings: str, t=T, start: float = 0.0):
    return cache.cached_sky(loaded(*settings), hop(), t, start)


def test_cases_that_differ_in_nothing_that_the_sky_depends_on_share_it():
    first = seen()
    for change in ("base.imu.gyro.bias_repeatability=3 deg/h", "base.filter.gate=7", "base.receiver.channels=16"):
        assert seen(change).elevation is first.elevation
    noisy = seen("base.receiver.pseudorange_sigma=9 m")
    assert noisy.elevation is first.elevation
    assert (noisy.range_sigma > first.range_sigma).all()


@pytest.mark.parametrize(
    "setting",
    [
        "base.receiver.latency=0.5 s",
        "base.receiver.mask=15 deg",
        "base.faults=[{kind: satellite_outage, keep: 3, start: 5 s, duration: 3 s}]",
    ],
)
def test_receiver_constellation_and_faults_make_another_sky(setting):
    assert seen(setting).elevation is not seen().elevation


def test_other_epochs_another_start_and_another_flight_make_another_sky():
    own = seen()
    assert seen(t=T[:-1]) is not own
    assert seen(start=20.0) is not own
    assert cache.cached_sky(loaded(), hop(coast=11.0), T, 0.0) is not own


def test_a_sky_that_was_kept_counts_as_having_read_what_it_was_computed_from():
    found = []
    for _ in range(2):
        reads = FieldReads(loaded("base.receiver.latency=0.25 s"))
        cache.cached_sky(reads.card, hop(), T, 0.0)
        found.append(reads.paths)
    assert found[0] == found[1]
    assert {"receiver.latency", "constellation.kind"} & found[1]


def test_a_file_of_satellites_that_is_written_again_is_another_one(tmp_path):
    file = tmp_path / "own.alm"
    card = AlmanacConstellation(almanac=str(file))
    found = []
    for text in ("one", "another", "one"):
        file.write_text(text)
        found.append(file_digests(card))
    assert found[0] == found[2] != found[1]
    assert file_digests(loaded().constellation) == ""


def test_a_sky_that_is_kept_is_that_of_the_receiver_that_asks() -> None:
    """Whatever field of the receiver is changed: the sky is what it would be without anything kept."""
    from lvnav_trade.campaign.definition.axes import cases
    from lvnav_trade.campaign.reading.load import load
    from lvnav_trade.gnss.visibility import sky
    from lvnav_trade.simulation.preparation.cache import cached_sky, trajectory_of

    base = cases(load("demo"))[0].scenario
    flight, t = trajectory_of(base), np.arange(0.0, 200.0, 20.0)
    changes: list[dict[str, object]] = [
        {"pseudorange_sigma": 7.0},
        {"range_rate_sigma": 0.7},
        {"mask": 0.3},
        {"channels": 4},
        {"lever_b": (1.0, 2.0, 3.0)},
        {"antennas": base.receiver.antennas[:2]},
        {"tracking": None},
        {"frequencies": "L1_L5"},
    ]
    for change in [*changes, *reversed(changes)]:
        receiver = base.receiver.model_copy(update=change)
        scenario = base.model_copy(update={"receiver": receiver, "faults": ()})
        kept = cached_sky(scenario, flight, t, -10.0)
        alone = sky(base.constellation, receiver, flight, np.maximum(-10.0, t - receiver.latency))
        for name in ("is_tracked", "range_sigma", "rate_sigma", "phase_sigma", "cn0", "elevation", "state"):
            np.testing.assert_array_equal(getattr(kept, name), getattr(alone, name), err_msg=f"{change} {name}")
