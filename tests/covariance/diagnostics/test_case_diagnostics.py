"""What is behind a case's linear covariance adds up to it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics import case_diagnostics as room
from lvnav_trade.covariance.diagnostics.case_diagnostics import FACTORS, diagnose, scale_source, sensitivity
from lvnav_trade.covariance.history import covariance
from lvnav_trade.covariance.sources import source_names
from lvnav_trade.quantities.error_sources import SOURCES
from lvnav_trade.quantities.records import CovarianceRequest
from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.scenario.scenario import Scenario
from tests.building import INERTIAL, LOOSE, MATCHED, case, flying, hop, loaded, prepare_hop, with_fields

WHOLE_TRIAD = {
    "misalignment": "1 mrad", "bias_repeatability": None, "bias_instability": None, "scale_factor": "300 ppm",
    "scale_factor_drift": "100 ppm/sqrt(year)", "nonlinearity": "50 ppm", "random_walk": None,
    "rate_random_walk": None, "quantisation": None,
}  # fmt: skip
GYRO = {"bias_repeatability": "1 deg/h", "bias_instability": "0.5 deg/h", "random_walk": "0.03 deg/sqrt(h)",
        "rate_random_walk": "0.1 deg/h/sqrt(h)", "quantisation": "1 urad", "g_sensitivity": "1 deg/h/g"}  # fmt: skip
ACCEL = {"bias_repeatability": "1 mg", "bias_instability": "0.1 mg", "random_walk": "50 ug/sqrt(Hz)",
         "rate_random_walk": "0.1 mg/sqrt(h)", "quantisation": "1 mm/s"}  # fmt: skip

RECEIVER = {
    "clock.initial_bias": "100 m", "clock.initial_drift": "1 m/s", "multipath": "1 m", "latency_error": "1 ms",
    "latency_sigma": "1 ms", "lever_error": "0.1 m", "solution.position_bias": "1 m",
    "solution.velocity_bias": "0.1 m/s", "range_rate_offset": "0.1 m/s", "range_rate_instability": "0.1 m/s",
}  # fmt: skip
ELSEWHERE = {
    "troposphere scale", "ionosphere scale", "satellite clock and ephemeris", "system time offset",
    "recorded receiver error", "wild samples", "carrier-phase noise", "carrier ambiguity",
}  # fmt: skip
"""Sources of the world around the flight, of a record, of faults: see test_correlated, test_recorded, test_faults."""


@lru_cache(maxsize=1)
def found():
    prepared_case = case()
    history = covariance(prepared_case)
    asked = CovarianceRequest(event="end1", events=("end0", "end1"))
    return prepared_case, history, diagnose(prepared_case.scenario, prepared_case, history, asked)


def test_covariances_by_source_sum_to_the_true_one_off_the_diagonal_too():
    prepared_case, history, what = found()
    assert [part.event for part in what.source_covariances] == ["end1", "end0"]
    for part in what.source_covariances:
        at = int(np.argmin(np.abs(history.t - prepared_case.trajectory.events[part.event])))
        for q in range(3):
            true = history.true_cov[at][3 * q : 3 * q + 3, 3 * q : 3 * q + 3]
            np.testing.assert_allclose(part.covariance[:, q].sum(axis=0), true, atol=1e-9 * np.trace(true))


def test_the_covariance_of_every_source_is_positive():
    for part in found()[2].source_covariances:
        for block in part.covariance.reshape(-1, 3, 3):
            assert np.linalg.eigvalsh(block).min() >= -1e-9 * np.trace(block)


def test_the_adjoint_is_of_the_event_that_was_asked_for():
    prepared_case, history, what = found()
    assert what.adjoint.time == pytest.approx(prepared_case.trajectory.events["end1"], abs=1e-9)
    at = int(np.argmin(np.abs(history.t - what.adjoint.time)))
    total = what.adjoint.contribution.sum(axis=(1, 2))
    np.testing.assert_allclose(total, history.true_sigma[at, :9] ** 2, rtol=1e-9)


def test_phases_lie_between_events_and_cover_the_flight():
    prepared_case, _, what = found()
    assert [phase.name for phase in what.phases] == ["start to end0", "end0 to end1"]
    assert what.phases[0].start == prepared_case.reference.t[0]
    assert all(np.all(np.diff(phase.singular_values) <= 0.0) for phase in what.phases)
    assert all(phase.weakest_direction for phase in what.phases)


def test_a_direction_of_a_state_without_an_initial_sigma_is_reported_all_the_same():
    prepared_case = found()[0]
    P = prepared_case.initial_state.P.copy()
    P[-1, :] = P[:, -1] = 0.0
    known = prepared_case._replace(initial_state=prepared_case.initial_state._replace(P=P))
    assert room._direction_text(known, 0.0, np.eye(P.shape[0])[-1]).startswith("+1.00 ")


@pytest.mark.slow  # a kernel of its own, most of half a minute to compile
def test_a_filter_with_clones_is_explained_too():
    prepared_case = case("base.filter.measurements=[pseudorange, tdcp]")
    asked = CovarianceRequest(adjoint=False, sensitivity=False, error_bound=True)
    what = diagnose(prepared_case.scenario, prepared_case, covariance(prepared_case), asked)
    assert len(what.phases[0].singular_values) == what.bound.state_count == len(prepared_case.layout.reported_states)
    assert what.weakest_direction.startswith("+1.00 ")
    assert len(what.nonlinearities) == 3


def test_every_event_has_its_nonlinearity():
    assert [name for name, _ in found()[2].nonlinearities] == ["liftoff", "end0", "end1"]


def test_what_is_not_asked_for_is_not_computed():
    prepared_case, history, _ = found()
    what = diagnose(
        prepared_case.scenario,
        prepared_case,
        history,
        CovarianceRequest(adjoint=False, observability=False, nonlinearity=False),
    )
    assert (what.adjoint, what.source_covariances, what.sensitivity, what.phases) == (None, (), (), ())
    assert what.nonlinearities == ()
    assert what.event == "end1"  # no injection: the last event


def test_three_quantities_share_their_covariances_and_a_factor_of_one_changes_nothing(monkeypatch):
    prepared_case, history, _ = found()
    calls = []

    def counted(again):
        calls.append(again)
        return covariance(again)

    monkeypatch.setattr("lvnav_trade.covariance.diagnostics.case_diagnostics.covariance", counted)
    with flying(hop()):
        what = diagnose(
            prepared_case.scenario, prepared_case, history, CovarianceRequest(sensitivity=True, observability=False)
        )
    assert [part.quantity for part in what.sensitivity] == ["attitude", "velocity", "position"]
    sources = {source for part in what.sensitivity for source in part.sources}
    assert len(calls) == len(sources) * (len(FACTORS) - 1)
    for part in what.sensitivity:
        np.testing.assert_allclose(part.frozen_rms[:, 2], part.retuned_rms[:, 2], rtol=1e-9)


def every_error(*settings: str) -> Scenario:
    """Return a scenario in which every error that a card can name is there."""
    scenario = loaded(*settings)
    fields = {f"gyro.{name}": value for name, value in {**WHOLE_TRIAD, **GYRO}.items()}
    fields |= {f"accel.{name}": value for name, value in {**WHOLE_TRIAD, **ACCEL}.items()}
    receiver = with_fields(scenario.receiver, **RECEIVER)
    scenario = scenario.model_copy(update={"imu": with_fields(scenario.imu, **fields), "receiver": receiver})
    return with_fields(scenario, gravity={"sigma": "30 mGal"})


def test_every_source_that_a_budget_can_name_is_registered_and_none_is_registered_in_vain() -> None:
    named: set[str] = set()
    for kind in ((), (LOOSE,), (INERTIAL,)):
        named |= set(source_names(prepare_hop(every_error(*kind))))
    assert named == set(SOURCES) - ELSEWHERE
    assert len({source.label for source in SOURCES.values()}) == len(SOURCES)


def leaves(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    if isinstance(value, dict):
        for key, child in value.items():
            yield from leaves(child, (*path, key))
    else:
        yield path, value


@pytest.mark.parametrize("source", sorted(set(SOURCES) - ELSEWHERE))
def test_scaling_a_source_multiplies_its_own_fields_and_nothing_else(source: str) -> None:
    scenario = every_error()
    before = dict(leaves(scenario.model_dump()))
    after = dict(leaves(scale_source(scenario, source, 3.0).model_dump()))
    changed = {path: after[path] / before[path] for path in before if after[path] != before[path]}
    assert changed == {path: pytest.approx(3.0**power) for path, power in SOURCES[source].fields}
    assert dict(leaves(scenario.model_dump())) == before


def with_frozen_gains(scenario: Scenario) -> Scenario:
    """Return the scenario with the filter models as numbers of their own: they do not follow the truth any more."""
    imu, receiver, initial = filter_models(scenario)
    update = {"imu": imu, "receiver": receiver, "initial": initial}
    return scenario.model_copy(update={"filter": scenario.filter.model_copy(update=update)})


def columns(prepared_case: Any, quantity: str) -> list[int]:
    return [index for index, output in enumerate(prepared_case.outputs) if output.quantity == quantity]


def norm(history: Any, time: float, chosen: list[int]) -> float:
    at = int(np.argmin(np.abs(history.t - time)))
    return float(np.sqrt(np.sum(history.true_sigma[at, chosen] ** 2 + history.mean[at, chosen] ** 2)))


@pytest.mark.parametrize("settings", [(), (LOOSE,), (INERTIAL,)], ids=["tight", "loose", "inertial"])
def test_the_frozen_formula_is_what_a_filter_gives_that_does_not_know_the_new_sigma(settings: tuple[str, ...]) -> None:
    scenario = with_frozen_gains(every_error(*settings))
    prepared_case = prepare_hop(scenario)
    history, chosen = covariance(prepared_case), columns(prepared_case, "velocity")
    with flying(hop()):
        found = sensitivity(scenario, history, 30.0, "velocity", chosen, share=0.02)
        assert len(found.sources) >= 2
        # what is said of such a filter re-tuned is the same, because it has nothing that could follow
        np.testing.assert_allclose(found.retuned_rms, found.frozen_rms, rtol=1e-9)


def test_at_a_factor_of_one_both_are_the_covariance_as_it_is() -> None:
    scenario = loaded(MATCHED)
    prepared_case = prepare_hop(scenario)
    history, chosen = covariance(prepared_case), columns(prepared_case, "position")
    with flying(hop()):
        found = sensitivity(scenario, history, 20.0, "position", chosen)
    at = FACTORS.index(1.0)
    expected = norm(history, 20.0, chosen)
    np.testing.assert_allclose(found.frozen_rms[:, at], expected, rtol=1e-14)
    np.testing.assert_array_equal(found.retuned_rms[:, at], expected)
    assert (found.time, found.quantity, found.factors) == (20.0, "position", FACTORS)


def test_a_filter_that_knows_the_new_sigma_is_never_worse_than_one_that_does_not() -> None:
    # An optimal filter: the matched unit holds only what the filter models.
    scenario = loaded(MATCHED)
    prepared_case = prepare_hop(scenario)
    history = covariance(prepared_case)
    with flying(hop()):
        found = sensitivity(scenario, history, 30.0, "velocity", columns(prepared_case, "velocity"))
    assert np.all(found.retuned_rms <= found.frozen_rms * (1.0 + 1e-6))
    assert np.all(np.diff(found.frozen_rms, axis=1) > 0.0)
    assert np.all(np.diff(found.retuned_rms, axis=1) > 0.0)


def test_sources_come_largest_first_and_only_those_that_matter() -> None:
    scenario = loaded(MATCHED)
    prepared_case = prepare_hop(scenario)
    history, chosen = covariance(prepared_case), columns(prepared_case, "velocity")
    known = {(name, factor): history for name in history.sources for factor in FACTORS}  # nothing is flown again
    found = sensitivity(scenario, history, 30.0, "velocity", chosen, share=0.05, covariance_cache=known)
    at = int(np.argmin(np.abs(history.t - 30.0)))
    shares = dict(zip(history.sources, history.budget[at][:, chosen].sum(axis=1), strict=True))
    total = sum(shares.values())
    expected = sorted((name for name in shares if shares[name] >= 0.05 * total), key=lambda name: -shares[name])
    assert list(found.sources) == expected


def test_what_one_quantity_has_computed_the_next_one_finds() -> None:
    scenario = loaded(MATCHED, LOOSE)
    prepared_case = prepare_hop(scenario)
    history = covariance(prepared_case)
    known: dict[tuple[str, float], Any] = {}
    with flying(hop()):
        sensitivity(
            scenario, history, 30.0, "velocity", columns(prepared_case, "velocity"), share=0.3, covariance_cache=known
        )
    held = dict(known)
    assert held
    assert {factor for _, factor in held} == set(FACTORS) - {1.0}
    again = sensitivity(
        scenario, history, 30.0, "velocity", columns(prepared_case, "velocity"), share=0.3, covariance_cache=known
    )
    assert known == held
    assert np.all(np.isfinite(again.retuned_rms))
