"""Record of a prepared case: everything that its runs share, for both engines."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.model import FilterModel
from lvnav_trade.quantities.records import Floats, Ints, Motion, Output, Reference, Sky
from lvnav_trade.quantities.state_layout import ErrorTerm, StateLayout
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.receiver_observables import Channels
from lvnav_trade.sensors.sensor import CorrelatedError
from lvnav_trade.simulation.preparation.imu_inputs import ImuTruth
from lvnav_trade.simulation.preparation.inputs import HistoryTruth, InitialState, Options, Schedule, Sensors, Signals
from lvnav_trade.simulation.preparation.sensors import Sensor
from lvnav_trade.simulation.preparation.signals.atmospheric_delays import Delays
from lvnav_trade.simulation.preparation.signals.recorded_solution import RecordedErrors
from lvnav_trade.simulation.preparation.signals.solution import SolutionErrorModel
from lvnav_trade.trajectory.flight import Trajectory
from lvnav_trade.trajectory.guided.guidance_plan import GuidancePlan


class PreparedCase(NamedTuple):
    """A scenario and everything that its runs share."""

    scenario: Scenario  # validated model of the case
    trajectory: Trajectory  # true flight
    reference: Reference  # true motion and ideal increments on the ticks of the IMU
    sky: Sky  # satellites at the epochs
    outputs: tuple[Output, ...]  # reported error components, in the order of the history's columns
    layout: StateLayout  # states of the filter
    model: FilterModel  # the filter as arrays
    sources: tuple[ErrorTerm, ...]  # true error parameters of the IMU, three axes each
    families: tuple[CorrelatedError, ...]  # correlated measurement errors by cause
    schedule: Schedule  # windows of IMU ticks
    unit: ImuTruth  # truth-side model of the IMU
    signals: Signals  # true measurements and their noise at the epochs
    initial_state: InitialState  # true state at tick 0 and the covariance of the filter's initial error
    record: HistoryTruth  # true state at the ticks of the history times
    motion: Motion  # true motion at the history times, some of which lie between two ticks
    t_hist: Floats  # (n_hist,) s since lift-off, history times
    t_epoch: Floats  # (n_epoch,) s since lift-off, epochs
    lengths: Floats  # (n_length,) s, window lengths that occur
    atmospheric_delays: Delays  # tropospheric and ionospheric delays, true and modelled by the filter
    recorded_errors: RecordedErrors  # recorded errors of the receiver's solution
    options: Options  # optional features; None where the case has none
    chain: SolutionErrorModel | None  # error propagation of the receiver's solution; None without a reported covariance
    devices: tuple[Sensor, ...]  # sensors other than the receiver that the filter uses
    sensors: Sensors | None  # these as arrays; None without sensors
    channels: Channels  # measurement channels of the filter
    channel_names: tuple[str, ...]  # names of all innovations
    failed_check: Ints  # (n_epoch,) number of the input check that the receiver's sample fails, 0 none
    plan: GuidancePlan | None  # guidance plan computed before lift-off; None without guidance

    @property
    def hist_tick(self) -> Ints:
        """Return the ticks (n_hist,) at which errors are recorded for the history times."""
        schedule = self.schedule
        has_history = schedule.hist >= 0
        end = schedule.first_tick + schedule.n_tick
        ticks = np.zeros(self.t_hist.size, dtype=np.int64)
        ticks[schedule.hist[has_history]] = end[has_history]
        return ticks

    @property
    def n_row(self) -> int:
        """Return the largest number of Jacobian rows at an epoch: those of the receiver, then those of the sensors."""
        n_slot = self.signals.satellite_by_slot.shape[1]
        n_receiver_row = max(6, self.model.n_observable * n_slot)
        return n_receiver_row + self.channels.n_channel - self.channels.n_receiver
