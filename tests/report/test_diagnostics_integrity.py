import pytest

from lvnav_trade.report.blocks import Picture, Table
from lvnav_trade.report.diagnostics import fault_test_benefit, integrity
from lvnav_trade.results.tables.read import load
from tests import synthetic


@pytest.fixture(scope="module")
def tested(tmp_path_factory):
    """Return results of filters that exclude a channel in every run at 40 s, before the fault at 60 s."""
    return load(synthetic.results(tmp_path_factory.mktemp("tested"), n_run=8, size=8, logic=True))


def test_rates_stand_with_their_intervals_and_decisions_with_their_times(tested):
    rates, decided = (block for block in integrity(tested) if isinstance(block, Table))
    first = dict(zip(rates.head, rates.rows[0], strict=True))
    assert first["case"] == "imu=fine"
    assert first["false alarm"] == "100 (63.1 to 100)"  # exact bounds of eight of eight
    assert (first["detected"], first["missed"]) == ("0 (0 to 36.9)", "100 (63.1 to 100)")
    row = dict(zip(decided.head, decided.rows[0], strict=True))
    assert (row["isolated"], row["times"], row["median (s)"], row["linear covariance"]) == ("channel", "8", "40", "1")


def test_decisions_are_drawn_over_time(tested):
    assert [block.name for block in integrity(tested) if isinstance(block, Picture)] == ["decisions-1", "decisions-2"]


def test_a_campaign_without_tests_has_no_such_section(page):
    good = load(page.parent)
    assert integrity(good) == []
    assert fault_test_benefit(good) == []
