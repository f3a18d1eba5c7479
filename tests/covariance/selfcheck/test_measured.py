"""Draws of receiver and sensors: numbers that are not the cards' are found."""

from __future__ import annotations

import pytest

from lvnav_trade.covariance.selfcheck.measured import measurement_checks
from tests.building import LOOSE, MATCHED, loaded, prepare_hop, with_fields
from tests.covariance.diagnostics.checked import SEED, failed, rich


@pytest.mark.parametrize(
    ("field", "factor", "found"),
    [
        ("sigma", 1.1, "pseudorange noise, variance"),
        ("clock_step", 1.2, "step of clock drift, variance"),
        ("clock_start", 1.5, "clock bias, variance"),
    ],
)
def test_draws_of_the_receiver_that_are_not_the_cards_are_found(field, factor, found):
    prepared_case = rich()
    wrong = prepared_case._replace(
        signals=prepared_case.signals._replace(**{field: factor * getattr(prepared_case.signals, field)})
    )
    assert found in {what for what, *_ in failed(measurement_checks(wrong, SEED))}


@pytest.mark.parametrize(
    ("field", "factor", "found"), [("initial_sigma", 1.5, "variance"), ("decay", 0.8, "correlation")]
)
def test_errors_that_measurements_share_and_are_not_the_cards_are_found(field, factor, found):
    prepared_case = rich()
    shared = prepared_case.signals.correlated_errors._replace(
        **{field: factor * getattr(prepared_case.signals.correlated_errors, field)}
    )
    wrong = prepared_case._replace(signals=prepared_case.signals._replace(correlated_errors=shared))
    assert f"multipath, {found}" in {what for what, *_ in failed(measurement_checks(wrong, SEED))}


def test_noise_of_a_sensor_that_is_not_the_cards_is_found():
    sensor = {"kind": "altimeter", "name": "a", "source": "test", "sigma": "20 m", "highest": "1000 km"}
    scenario = with_fields(loaded(MATCHED, LOOSE), sensors={"altimeter": sensor},
                           **{"filter.measurements": ["position", "velocity", "altitude"]})  # fmt: skip
    prepared_case = prepare_hop(scenario)
    assert failed(measurement_checks(prepared_case, SEED)) == []
    sigma = prepared_case.signals.sigma.copy()
    sigma[:, 6] *= 1.4
    wrong = prepared_case._replace(signals=prepared_case.signals._replace(sigma=sigma))
    assert [what for what, *_ in failed(measurement_checks(wrong, SEED))] == ["altimeter noise, variance"]
