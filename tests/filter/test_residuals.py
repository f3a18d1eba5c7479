"""What corrections leave of a delay, as a filter may take it: neglected, states, noise that rows share, considered."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.filter import ekf
from lvnav_trade.quantities.state_layout import state_names
from lvnav_trade.simulation.epoch.filter_case import OptionalState, case_of
from lvnav_trade.simulation.epoch.process import update_receiver
from tests.building import MATCHED, loaded, prepare_hop, with_fields
from tests.covariance.test_history import agrees, inside
from tests.filter.test_ekf import work_of

AIR = {"ionosphere": {"kind": "content"}, "ionosphere_scale": "40 percent"}
SCALE, EACH = "ionosphere_scale", "ionosphere_scale_by_satellite"
SCHEMES = {
    "neglected": {}, "one factor": {"extra_states": [SCALE]}, "one by satellite": {"extra_states": [EACH]},
    "noise": {"as_noise": [SCALE]}, "noise by satellite": {"as_noise": [EACH]}, "considered": {"consider": [SCALE]},
}  # fmt: skip


@lru_cache(maxsize=16)
def prepare_case(scheme, *settings, air=(), **fields):
    """The short flight through an ionosphere that the filter corrects up to a factor."""
    scenario = loaded(MATCHED, *settings)
    card = with_fields(scenario.filter, corrections={"ionosphere": {"kind": "matched"}}, **SCHEMES[scheme], **fields)
    return prepare_hop(with_fields(scenario.model_copy(update={"filter": card}), atmosphere=AIR | dict(air)))


def observed(prepared_case, epoch, offset):
    """Work arrays at an epoch: the true state, ranges off by `offset` (n_row,), and the rows of what is measured."""
    work, model, signals = work_of(prepared_case), prepared_case.model, prepared_case.signals
    tick = int(np.argmin(np.abs(prepared_case.reference.t - prepared_case.t_epoch[epoch])))
    ref = prepared_case.reference
    work.nav[:] = np.concatenate([ref.q_b_i[tick], ref.v_i[tick], ref.r_i[tick]])
    for slot in range(signals.n_used[epoch]):
        s = signals.satellite_by_slot[epoch, slot]
        work.ranges[slot] = signals.range[epoch, s], signals.rate[epoch, s]
    work.ranges[: signals.n_used[epoch]] += offset.reshape(-1, 2)
    ekf.place_antenna(work, None, None, model, prepared_case.unit.dt, epoch)
    ekf.fill_receiver(work, None, None, model, signals, epoch)
    return work


def dense_rows(prepared_case, work, epoch):
    """The Jacobian (n_row, n_state), innovations and assumed variances (n_row,) of an epoch, as matrices."""
    model, n_row = prepared_case.model, 2 * prepared_case.signals.n_used[epoch]
    H, R = np.zeros((n_row, model.n_state)), np.zeros(n_row)
    for row in range(n_row):
        channel = ekf.receiver_channel(model, prepared_case.signals, epoch, row)
        n = model.n_entry[channel]
        H[row, model.column[channel, :n]] = work.H[row, model.entry[channel, :n]]
        R[row] = prepared_case.signals.variance[epoch, channel]
    return H, np.array(work.z[:n_row]), R


@pytest.mark.parametrize("scheme", ["noise", "noise by satellite"])
def test_noise_that_rows_share_is_the_dense_update_with_the_full_covariance(scheme):
    """R + s^2 t t', t the modelled delays: gain, estimate and covariance of all other states to 1e-9 of a sigma."""
    prepared_case, epoch = prepare_case(scheme), 5
    rng = np.random.default_rng(3)
    work = observed(prepared_case, epoch, rng.standard_normal(2 * prepared_case.signals.n_used[epoch]))
    n_state, shared = prepared_case.layout.n_state, prepared_case.layout.extras[0]
    of_noise = np.arange(shared.offset, shared.offset + len(shared.labels))
    others = np.setdiff1d(np.arange(n_state), of_noise)
    root = rng.standard_normal((others.size, others.size)) * np.sqrt(np.diag(work.P)[others])[:, None]
    work.P[np.ix_(others, others)] = root @ root.T
    H, z, R = dense_rows(prepared_case, work, epoch)
    P, T = np.array(work.P)[np.ix_(others, others)], H[:, of_noise] * 0.4
    assert np.count_nonzero(T) >= len(z)
    assert len(z) == 2 * len(set(range(len(z) // 2)))
    whole = np.diag(R) + T @ T.T
    assert np.abs(whole[0, 2]) > 0.0 or scheme == "noise by satellite"  # correlated over satellites
    assert np.abs(whole[0, 1]) > 0.0  # a satellite's range with its rate
    gain = P @ H[:, others].T @ np.linalg.inv(H[:, others] @ P @ H[:, others].T + whole)
    ekf.clear_epoch(work, epoch)
    update_receiver(work, OptionalState(), case_of(prepared_case), None, None, epoch, np.inf, None)
    sigma = np.sqrt(np.diag(P))
    np.testing.assert_allclose(work.x[others] / sigma, gain @ z / sigma, rtol=0, atol=1e-9)
    expected = P - gain @ H[:, others] @ P
    np.testing.assert_allclose(
        np.array(work.P)[np.ix_(others, others)] / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-9
    )


def test_between_epochs_the_noise_is_forgotten_as_if_its_state_were_reset():
    prepared_case = prepare_case("noise")
    work, at = work_of(prepared_case), prepared_case.layout.extras[0].offset
    rng = np.random.default_rng(4)
    root = rng.standard_normal(work.P.shape) * np.sqrt(np.diag(work.P))[:, None]
    work.P[:], work.extra[:], work.sums[:] = root @ root.T, 0.3, rng.standard_normal(18)
    reset = work_of(prepared_case)
    reset.P[:], reset.sums[:] = work.P, work.sums
    reset.P[at], reset.P[:, at] = 0.0, 0.0
    length_index = int(np.argmax(prepared_case.lengths))
    for one in (work, reset):
        ekf.predict_window(one, prepared_case.model, length_index, -1)
    reset.P[at, at] = 0.4**2
    scale = np.sqrt(np.diag(reset.P))
    np.testing.assert_allclose(work.P / np.outer(scale, scale), reset.P / np.outer(scale, scale), rtol=0, atol=1e-14)
    assert work.extra[0] == 0.0


@pytest.mark.parametrize("scheme", ["one by satellite", "noise", "noise by satellite", "considered"])
def test_both_engines_agree_on_every_scheme(scheme):
    """The true factor is one for all satellites and drifts within the flight; 400 runs, errors of all states."""
    prepared_case = prepare_case(scheme, air=(("ionosphere_scale_time", "30 s"),))
    ratio, interval = agrees(prepared_case, 400, (10.0, 30.0))
    assert inside(ratio, interval), (ratio, interval)
    cov = covariance(prepared_case)
    back, hist = adjoint(prepared_case, 30.0), int(np.flatnonzero(prepared_case.t_hist == 30.0)[0])
    forward, total = cov.budget[hist, :, :9], cov.true_sigma[hist, :9] ** 2
    np.testing.assert_allclose(back.contribution.sum(axis=2).T / total, forward / total, rtol=0, atol=1e-10)
    np.testing.assert_allclose(cov.budget.sum(axis=1), cov.true_sigma**2, rtol=1e-10)


def test_a_filter_that_neglects_the_residual_is_optimistic_and_the_schemes_are_not():
    found = {name: covariance(prepare_case(name)) for name in SCHEMES}
    place = {name: np.linalg.norm(cov.formal_sigma[-1, 6:9]) for name, cov in found.items()}
    true = {name: np.linalg.norm(cov.true_sigma[-1, 6:9]) for name, cov in found.items()}
    assert true["neglected"] > 1.5 * place["neglected"]
    for name in ("one factor", "one by satellite", "considered"):
        assert true[name] < 1.05 * place[name], name
        assert true[name] < true["neglected"], name
    # new noise at every epoch averages out; a factor that lasts does not: it is known less well than the filter says
    assert place["neglected"] < place["noise"] < true["noise"] < true["neglected"]
    # what is estimated is known best, and where it is one in truth, one state knows it best
    for claimed in (place, true):
        assert claimed["one factor"] < min(claimed["one by satellite"], claimed["considered"])


def test_one_factor_estimated_is_what_it_was_and_a_considered_one_is_true():
    for name in ("one factor", "considered"):
        cov = covariance(prepare_case(name))
        np.testing.assert_allclose(cov.formal_sigma, cov.true_sigma, rtol=1e-2)


def test_every_satellite_has_a_factor_of_its_own_with_the_sigma_of_the_one():
    prepared_case = prepare_case("one by satellite")
    block = prepared_case.layout.extras[0]
    assert len(block.labels) >= 6
    assert block.sigma == 0.4
    assert f"{EACH} {block.labels[0]}" in state_names(prepared_case.layout)
    for number, label in enumerate(block.labels):
        s = prepared_case.channels.satellites.index(label)
        assert block.member[[2 * s, 2 * s + 1]].tolist() == [number, number]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"as_noise": [SCALE], "extra_states": [SCALE]}, "as_noise: ionosphere_scale is in extra_states too"),
        ({"as_noise": [SCALE], "consider": [SCALE]}, "as_noise: ionosphere_scale is in consider too"),
        ({"as_noise": [SCALE], "extra_states": [EACH]}, "model the same delay"),
        ({"as_noise": ["accel_bias"]}, "accel_bias"),
    ],
)
def test_a_residual_is_taken_in_one_way_only(fields, message):
    with pytest.raises(ValidationError, match=message):
        with_fields(loaded().filter, **fields)
