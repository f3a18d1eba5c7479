"""Process noise from an ensemble becomes a filter card; what cannot be estimated is reported in one line."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.derived_cards import process_noise
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.quantities.errors import InputError
from tests.building import LOOSE, MATCHED, flying, hop

RUNS = 20


def estimated(*settings, runs=RUNS, step=None):
    campaign = load(campaign_file("campaigns/smoke.yaml"), (LOOSE, *settings))
    with flying(hop()):
        return process_noise(campaign, cases(campaign)[0], runs, step)


def test_a_unit_that_the_filter_models_asks_for_next_to_no_noise_beyond_its_own():
    found = estimated(MATCHED)
    imu = found.card.model_dump()
    assert imu["velocity_noise"] < 0.5 * found.flight_densities.velocity
    assert found.card.source.startswith("estimate-q of smoke: 20 runs, steps of 1 s")


def test_errors_that_it_does_not_model_ask_for_more_the_longer_the_step():
    one, ten = estimated(), estimated(step=10.0)
    assert one.card.velocity_noise > 3.0 * estimated(MATCHED).card.velocity_noise
    assert 2.0 < ten.flight_densities.velocity / one.flight_densities.velocity < 4.0  # what lasts: the root of ten


def test_the_table_covers_the_flight_and_phases_lie_between_its_events():
    found = estimated()
    assert found.steps.t_s.iloc[-1] == 30.0
    assert [name for name, *_ in found.phases] == ["start to end0", "end0 to end1"]
    assert (found.steps.velocity_missed_m_per_s < found.steps.velocity_error_m_per_s).all()


@pytest.mark.parametrize(
    ("runs", "step", "reported"), [(5, None, "too few"), (20, 0.0, "above zero"), (20, -1.0, "above zero")]
)
def test_what_gives_no_covariance_is_refused(runs, step, reported):
    with pytest.raises(InputError, match=reported):
        estimated(runs=runs, step=step)
