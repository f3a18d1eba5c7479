"""Definition of the error: what is recorded or fed back wrongly is found."""

from __future__ import annotations

from lvnav_trade.covariance.selfcheck import state_checks
from lvnav_trade.covariance.selfcheck.state_checks import round_trip
from tests.building import MATCHED, case
from tests.covariance.diagnostics.checked import failed


def test_an_error_that_is_fed_back_with_the_wrong_sign_is_found(monkeypatch):
    sound = state_checks.correct

    def wrong(work, state_history, delays, model):
        work.x[3:6] *= -1.0
        sound(work, state_history, delays, model)

    monkeypatch.setattr(state_checks, "correct", wrong)
    assert [what for what, *_ in failed(round_trip(case(MATCHED)))] == ["velocity"]


def test_an_error_that_is_recorded_of_another_size_is_found(monkeypatch):
    sound = state_checks.record

    def wrong(work, *args):
        sound(work, *args)
        work.err[args[-1], 9:12] *= 1.01

    monkeypatch.setattr(state_checks, "record", wrong)
    assert [what for what, *_ in failed(round_trip(case(MATCHED)))] == ["gyro_bias"]
