"""Gains are computed once on the nominal flight and replayed: on that flight they are the filter's own."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.derived_cards import gain_schedule
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.covariance.history import covariance
from lvnav_trade.filter.policies.stored_gains import GainKnot, GainSegment, schedule_digest
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.trajectory.flight import identity
from tests.building import LOOSE, MATCHED, case, flying, hop, loaded, prepare_hop

TWELVE = "base.filter.neglect=[gyro_bias]"


def scheduled(by="event", tolerance=0.02, settings=(MATCHED, LOOSE, TWELVE)):
    campaign = load("campaigns/smoke.yaml", settings)
    with flying(hop()):
        return gain_schedule(campaign, cases(campaign)[0], by, tolerance)


def test_a_schedule_says_for_which_flight_it_was_computed():
    found, card = scheduled(), loaded().trajectory
    assert (found.flight, found.flight_digest) == (card.name, identity(card))


def replayed(schedule, trajectory=None):
    base = loaded(MATCHED, LOOSE, TWELVE)
    card = base.filter.model_copy(update={"gains": schedule})
    return prepare_hop(base.model_copy(update={"filter": card}), trajectory)


@pytest.mark.parametrize("by", ["event", "time"])
def test_on_the_nominal_flight_they_do_as_well_as_the_covariance_s_own(by):
    own, theirs = covariance(case(MATCHED, LOOSE, TWELVE)), covariance(replayed(scheduled(by)))
    np.testing.assert_allclose(theirs.true_sigma[-1, :9], own.true_sigma[-1, :9], rtol=0.01)
    np.testing.assert_allclose(theirs.formal_sigma[-1, :9], own.formal_sigma[-1, :9], rtol=0.01)


def test_run_by_run_a_fine_schedule_is_the_filter_s_own_update():
    own = run_block(case(MATCHED, LOOSE, TWELVE), 1, 0, 16)
    theirs = run_block(replayed(scheduled(tolerance=1e-4)), 1, 0, 16)
    off = (theirs.err[:, -1, :9] - own.err[:, -1, :9]) / own.sigma[:, -1, :9]
    assert np.abs(off).max() < 0.05  # sigma; gains of four digits on large first errors


def test_where_the_flight_is_another_one_linear_covariance_says_what_that_costs():
    late = hop(boost=26.0)
    kept, own = (
        covariance(replayed(scheduled("time"), late)),
        covariance(prepare_hop(loaded(MATCHED, LOOSE, TWELVE), late)),
    )
    block = run_block(replayed(scheduled("time"), late), 5, 0, 400)
    ratio = np.sqrt((block.err[:, -1, 3:9] ** 2).mean(axis=0)) / kept.true_sigma[-1, 3:9]
    np.testing.assert_allclose(ratio, 1.0, atol=3.5 / np.sqrt(800))
    assert np.all(kept.true_sigma[-1, :9] > 0.999 * own.true_sigma[-1, :9])  # no gain is better than the optimal one


def test_a_schedule_of_other_states_or_of_an_event_that_is_not_flown_is_refused():
    with pytest.raises(InputError, match="the filter has"):
        replayed(scheduled(settings=(MATCHED, LOOSE)))
    found = scheduled()
    segments = (GainSegment(event="landing", knots=found.segments[0].knots),)
    moved = found.model_copy(update={"segments": segments, "digest": schedule_digest(found.states, segments)})
    with pytest.raises(InputError, match="needs the event 'landing'"):
        replayed(moved)
    assert GainKnot.model_fields.keys() == {"since", "gain"}


POINT = "base.receiver.solution={kind: bancroft, range_sigma: 2 m, rate_sigma: 0.1 m/s}"


@pytest.mark.parametrize(
    ("settings", "tolerance", "reported"),
    [
        ((MATCHED, LOOSE, POINT), 0.02, "its gains depend on the covariance of each solution"),
        ((MATCHED, LOOSE), 0.0, "give one between 0 and 1"),
        ((MATCHED, LOOSE), 1.0, "give one between 0 and 1"),
    ],
)
def test_what_has_no_schedule_is_reported(settings, tolerance, reported):
    with pytest.raises(InputError, match=reported):
        scheduled(tolerance=tolerance, settings=settings)
