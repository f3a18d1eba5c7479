"""Innovations and gate: a filter that assumes something else than linear covariance knows of is found."""

from __future__ import annotations

from lvnav_trade.covariance.history import covariance
from lvnav_trade.covariance.selfcheck import innovation_checks
from lvnav_trade.covariance.selfcheck.innovation_checks import innovations
from tests.covariance.diagnostics.checked import SEED, failed, rich


def test_a_filter_that_assumes_less_noise_than_linear_covariance_knows_of_is_found():
    prepared_case = rich()
    history = covariance(prepared_case)
    quieter = prepared_case._replace(
        signals=prepared_case.signals._replace(variance=0.5 * prepared_case.signals.variance)
    )
    assert {what for what, *_ in failed(innovations(quieter, history, SEED))} == {"mean square", "refused by the gate"}


def test_a_gate_of_another_size_is_found(monkeypatch):
    prepared_case = rich()
    history = covariance(prepared_case)
    sound = innovation_checks.run_block

    def narrower(*args):
        block = sound(*args)
        return block._replace(innovation=1.4 * block.innovation)

    monkeypatch.setattr(innovation_checks, "run_block", narrower)
    assert {what for what, *_ in failed(innovations(prepared_case, history, SEED))} == {
        "mean square",
        "refused by the gate",
    }
