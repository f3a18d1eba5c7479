"""Results from Python: load, report, compare, keep a base, draw on a globe."""

from __future__ import annotations

import pytest

from lvnav_trade import api
from lvnav_trade.quantities.errors import InputError
from tests import synthetic


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return synthetic.results(tmp_path_factory.mktemp("reports"), n_run=8)


def test_a_report_is_built_again(folder):
    made = api.report(folder)
    assert made.page == folder / "report.html"
    assert made.page.is_file()
    assert made.kept is None
    assert (folder / "rms.csv").is_file()


def test_tables_are_left_out_of_a_kept_report_only(folder):
    with pytest.raises(InputError, match="left out of a kept report only"):
        api.report(folder, tables=False)


def test_results_compared_with_themselves_are_not_worse(folder, tmp_path):
    base = api.keep_base(folder, tmp_path / "base")
    found = api.compare(base, folder, ["rare=none"])
    assert found.verdict == "not worse"
    assert set(found.frame.verdict) == {"not worse"}
    assert "The candidate is not worse" in found._repr_html_()
    assert str(found).startswith("The candidate is not worse")


def test_what_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="no results here"):
        api.load(tmp_path)
    with pytest.raises(InputError, match="no results here"):
        api.report(tmp_path, keep=tmp_path / "kept")
    with pytest.raises(InputError, match="above zero"):
        api.kml(tmp_path, tmp_path / "x.kml", every=0.0)


def test_flights_of_results_are_kml(folder, tmp_path):
    assert "<kml" in api.kml(folder, tmp_path / "flights.kml").read_text()
