"""Cache of objects that cases share: trajectories, their samples, satellites; the last few of each."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.gnss.faults import delay
from lvnav_trade.gnss.satellites import file_digests
from lvnav_trade.gnss.visibility import ReceivedSatellites, receive_satellites, with_noise
from lvnav_trade.imu.equivalent import equivalent
from lvnav_trade.quantities.reads import result_cache, result_cache_by_reads
from lvnav_trade.quantities.records import Floats, Reference, Sky
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.trajectory.flight import Trajectory, TrajectoryCard, build, content, reference, refuse_contradiction


@result_cache(4)
def cached_trajectory(identity: str, card: TrajectoryCard) -> Trajectory:
    """Return the trajectory of a card; identity: of `identity`, the key of the cache."""
    return build(card)


def identity(card: TrajectoryCard) -> str:
    """Return a card as JSON and, on a second line, the digest of the file it names, so that a changed file is read."""
    return f"{card.model_dump_json()}\n{content(card)}"


def trajectory_of(scenario: Scenario) -> Trajectory:
    """Return the trajectory of a scenario, from the cache if possible.

    Raises
    ------
    InputError
        If the trajectory is infeasible, or if a user's file contradicts itself.
    """
    card = scenario.trajectory
    flight = cached_trajectory(identity(card), card)
    refuse_contradiction(card, equivalent(scenario.imu))
    return flight


@result_cache(4)
def cached_reference(identity: str, card: TrajectoryCard, rate: float) -> Reference:
    """Return true motion and ideal increments of a trajectory at the ticks of an IMU.

    Parameters
    ----------
    identity
        Key of the cache, as from `identity`.
    card
        Card of the trajectory.
    rate
        Hz. Sampling rate of the IMU.
    """
    trajectory = cached_trajectory(identity, card)
    return reference(trajectory, rate)


class _ByIdentity(NamedTuple):
    """Wrapper of a trajectory that is compared by identity, not by its splines."""

    trajectory: Trajectory

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByIdentity) and self.trajectory is other.trajectory

    def __hash__(self) -> int:
        return id(self.trajectory)


def cached_sky(scenario: Scenario, trajectory: Trajectory, t_epoch: Floats, start: float) -> Sky:
    """Return the satellites at the times of validity of the receiver's measurements.

    Parameters
    ----------
    scenario, trajectory
        Validated model of the case, and its true flight.
    t_epoch
        (n_epoch,) s since lift-off. Epochs; the latency is subtracted.
    start
        s since lift-off. Earliest time of validity.
    """
    key = file_digests(scenario.constellation)
    received_satellites = _received_satellites(key, scenario, _ByIdentity(trajectory), t_epoch.tobytes(), start)
    return with_noise(received_satellites, scenario.receiver, trajectory)


@result_cache_by_reads(6)
def _received_satellites(
    key: str, scenario: Scenario, by_identity: _ByIdentity, epochs: bytes, start: float
) -> ReceivedSatellites:
    """Return the received satellites at the times of validity; the arguments are the key of the cache.

    Parameters
    ----------
    key
        Content of the constellation's files and card.
    scenario
        Validated model of the case.
    by_identity
        True flight.
    epochs
        Bytes of the epochs (n_epoch,) s since lift-off.
    start
        s since lift-off. Earliest time of validity.
    """
    t_epoch = np.frombuffer(epochs).copy()
    trajectory = by_identity.trajectory
    receiver = scenario.receiver
    constellation = scenario.constellation
    latency = receiver.latency + delay(scenario.faults, trajectory.flight_profile, t_epoch)
    if receiver.latency_per_satellite > 0.0:
        now = receive_satellites(constellation, receiver, trajectory, t_epoch, scenario.faults)
        n_tracked = now.sky.is_tracked.sum(axis=1)
        latency = latency + receiver.latency_per_satellite * n_tracked
    # if the latency decreases, times of validity still ascend
    t_valid = np.maximum.accumulate(np.maximum(start, t_epoch - latency))
    return receive_satellites(constellation, receiver, trajectory, t_valid, scenario.faults)
