"""A log in place of a simulated flight: the filter of a case runs on what the log holds, and draws nothing."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.recorded_log import read_card
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, ecef_from_geodetic, eci_from_ecef
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.recorded.alignment import align
from lvnav_trade.simulation.recorded.navigation_log import read_recording
from lvnav_trade.simulation.recorded.recorded_flight import log_replay, refuse_unable
from tests import recorded_log


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    file, ref = recorded_log.write(folder)
    card = read_card(file)
    log = read_recording(card, folder)
    scenario = cases(load(folder / "drive.yaml"))[0].scenario
    return scenario, log, card, align(log, card), ref


def test_the_filter_gets_the_logs_increments_and_solutions(drive):
    scenario, log, card, aligned, _ = drive
    prepared_case = log_replay(scenario, log, card, aligned).prepared_case
    sums = prepared_case.unit.dtheta.sum(axis=0) + aligned.gyro_bias * prepared_case.reference.t[-1]
    first, last = (int(np.argmin(np.abs(log.t - t))) for t in (20.0, 20.0 + prepared_case.reference.t[-1]))
    np.testing.assert_allclose(sums, log.angle_sums[last] - log.angle_sums[first], atol=1e-9)
    at = int(np.argmin(np.abs(log.t_fix - 20.0 - prepared_case.t_epoch[7])))
    theta = earth_angle(prepared_case.trajectory.theta0, prepared_case.t_epoch[7])
    expected = eci_from_ecef(ecef_from_geodetic(*log.place[at]), theta)
    np.testing.assert_allclose(prepared_case.signals.position[7], expected, atol=1e-3)
    one, other = (run_block(prepared_case, seed, 0, 1) for seed in (1, 2))
    assert one.err.tobytes() == other.err.tobytes()  # nothing is drawn


def test_the_filter_finds_the_true_motion(drive):
    scenario, log, card, aligned, ref = drive
    prepared_case = log_replay(scenario, log, card, aligned).prepared_case
    run = run_block(prepared_case, 0, 0, 1)
    k = -1
    true = ref.r_i[int(np.argmin(np.abs(ref.t - 20.0 - prepared_case.t_hist[k])))]
    estimate = prepared_case.record.r[k] - prepared_case.record.axes[k].T @ run.err[0, k, 6:9]
    assert np.linalg.norm(estimate - true) < 5.0 * np.linalg.norm(run.sigma[0, k, 6:9])
    assert run.failed[0] == 0


def test_the_logs_own_sigmas_are_taken_where_they_are_asked_for(drive):
    scenario, log, card, aligned, _ = drive
    own = card.model_copy(update={"gnss": card.gnss.model_copy(update={"noise": "log"})})
    sigma = np.tile([1.0, 2.0, 3.0, 0.1, 0.2, 0.3], (log.t_fix.size, 1))
    variance = log_replay(scenario, log._replace(sigma=sigma), own, aligned).prepared_case.signals.variance
    np.testing.assert_allclose(variance[:, :3].sum(axis=1), 14.0)
    np.testing.assert_allclose(variance[:, 3:6].sum(axis=1), 0.14)


def test_what_a_log_lacks_is_refused(drive, tmp_path):
    scenario, log, card, aligned, _ = drive
    tight = scenario.model_copy(
        update={"filter": scenario.filter.model_copy(update={"measurements": ("pseudorange",)})}
    )
    with pytest.raises(InputError, match="the filter takes pseudorange; the log has position, velocity"):
        refuse_unable(tight, card)
    fast = scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"rate": 400.0})})
    with pytest.raises(InputError, match=r"imu\.rate: 400 Hz; the log has 100 rows a second"):
        log_replay(fast, log, card, aligned)
    with pytest.raises(InputError, match="0 of the case's 479 epochs"):
        log_replay(scenario, log._replace(t_fix=np.append(log.t_fix[:81], log.t_fix[81:] + 0.1)), card, aligned)
