"""Channels of a receiver: which satellite is searched for, tracked or lost, and whether its phase is continuous."""

from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lvnav_trade.kernels.random import philox, seed_words, source_word
from lvnav_trade.quantities.records import (
    ACQUIRE,
    IDLE,
    LOST,
    SEARCH,
    TRACK,
    TRACKING,
    Bools,
    ChannelTransition,
    Floats,
    Ints,
)
from lvnav_trade.quantities.units import Card, CarrierToNoise, Frequency, Pause, Share

# Causes of loss of lock, each masked by those after it; HELD is lock.
HELD, DYNAMICS, WEAK, DEAF, FAULT, HIDDEN = range(6)
CAUSES = ("", "dynamics", "weak signal", "no antenna", "fault", "out of view")

FIX = 4  # satellites tracked for a position fix, which narrows the search for others


class TrackingCard(Card):
    """Search, acquisition and loss of satellites by the channels of a receiver.

    A search is a pass over all possible code phases and frequencies. The signal is found at a point that is uniformly
    distributed over the pass. The loops then pull in, and the satellite is measured afterwards.
    """

    acquire_above: CarrierToNoise = Field(
        33.0, description="C/N0 below which signals are not acquired; without a link budget all are"
    )
    track_above: CarrierToNoise = Field(
        25.0, description="C/N0 below which signals are lost; loops may lose them earlier"
    )
    search_time: Pause = Field(20.0, description="time of a search pass over the full range")
    reacquire_time: Pause = Field(4.0, description="time of a search pass around the last values of a lost satellite")
    memory: Pause = Field(15.0, description="time after a loss for which the last values narrow the search")
    aiding: Literal["none", "own", "fused"] = Field(
        "own",
        description="what narrows the search: the receiver's own solution while it tracks four, or the fused state",
    )
    aided_factor: Share = Field(0.25, gt=0, le=1, description="factor on the time of every pass while aided")
    searchers: int = Field(1, ge=1, description="number of satellites searched for at the same time")
    pull_in: Pause = Field(
        2.0,
        description="time from acquisition to the first measurement: closing of loops, bit and frame synchronisation",
    )
    coast: Pause = Field(0.5, description="time for which a channel waits for a signal to return before it is lost")
    start: Literal["tracking", "searching"] = Field("tracking", description="state of the channels at the first epoch")
    realisation: int = Field(0, ge=0, lt=2**32, description="number of the draw of search times; the same for all runs")

    def _faults(self) -> Iterator[str]:
        if self.acquire_above < self.track_above:
            yield "acquire_above is below track_above: an acquired satellite would be lost at once"


class ChannelSignals(NamedTuple):
    """Signals at the steps of the channels.

    t : (n_step,) s since lift-off.
    is_in_view : (n_step, n_sat). Whether the satellite is above the mask and not hidden by the Earth, by the almanac.
    cause : (n_step, n_sat). Cause of loss of lock, as in `CAUSES`; 0: the loops keep lock.
    is_strong : (n_step, n_sat). Whether the signal is strong enough for acquisition.
    elevation : (n_step, n_sat) rad. Elevation of the satellite.
    """

    t: Floats
    is_in_view: Bools
    cause: NDArray[np.int8]
    is_strong: Bools
    elevation: Floats


def search_fraction(card: TrackingCard, satellite: str, t: float) -> float:
    """Return the point, between 0 and 1, at which a search pass finds the satellite.

    The draw depends on realisation, satellite and time (in milliseconds) only, not on other searches.

    Parameters
    ----------
    card : TrackingCard
    satellite : str
        Name of the satellite.
    t : float
        Start of the pass (s since lift-off).
    """
    return _uniform(card.realisation, "acquisition", satellite, t)


def _uniform(realisation: int, purpose: str, satellite: str, t: float) -> float:
    """Return a number between 0 and 1 for a satellite and a time t (s), to the millisecond."""
    milliseconds = np.uint64(round(1e3 * t) & 0xFFFFFFFF)
    key = seed_words(0)
    word, _, _, _ = philox(
        milliseconds,
        np.uint64(realisation),
        source_word(purpose),
        source_word(satellite),
        *key,
    )
    return (float(word) + 0.5) / 2.0**32


def track(
    card: TrackingCard, channels: int, names: tuple[str, ...], signals: ChannelSignals
) -> tuple[NDArray[np.int8], tuple[ChannelTransition, ...]]:
    """Return the state of every satellite at every step, (n_step, n_sat), and all transitions in order of time.

    A satellite keeps its channel until its signal is lost. A free channel goes to the highest satellite; satellites
    with unsuccessful searches come after the others.

    Parameters
    ----------
    card : TrackingCard
    channels : int
        Largest number of satellites that are searched for, acquired and tracked at a time.
    names : (n_sat,)
        Names of the satellites.
    signals : ChannelSignals
    """
    receiver = _Channels(card, channels, names, signals)
    states = np.zeros(signals.is_in_view.shape, dtype=np.int8)
    if card.start == "tracking" and signals.t.size:
        receiver.begin()
    for step in range(signals.t.size):
        receiver.advance(step)
        states[step] = receiver.state
    return states, tuple(receiver.transitions)


class _Channels:
    """State of the channels over time; times in s, NaN for none.

    state : (n_sat,). State of each satellite, as in `records.TRACKING`.
    is_unlocked : (n_step, n_sat). Whether the loops lose lock.
    loss_start : (n_sat,). Start of the present loss of lock of a busy channel.
    find_time : (n_sat,). Time at which the search pass reaches the signal.
    end_time : (n_sat,). End of the pass or of the pull-in.
    loss_time : (n_sat,). Time of the loss of the satellite.
    failed_passes : (n_sat,). Number of unsuccessful passes since the last success.
    next_time : Earliest of the times `find_time` and `end_time`.
    """

    def __init__(self, card: TrackingCard, channels: int, names: tuple[str, ...], signals: ChannelSignals) -> None:
        n_sat = len(names)
        self.card = card
        self.channels = channels
        self.names = names
        self.signals = signals
        self.state = np.zeros(n_sat, dtype=np.int8)
        self.is_unlocked = signals.cause != HELD
        self.loss_start = np.full(n_sat, np.nan)
        self.find_time = np.full(n_sat, np.nan)
        self.end_time = np.full(n_sat, np.nan)
        self.loss_time = np.full(n_sat, np.nan)
        self.failed_passes = np.zeros(n_sat, dtype=int)
        self.next_time = np.inf
        self.transitions: list[ChannelTransition] = []

    def begin(self) -> None:
        """Track the highest satellites in view from the first step on, as many as there are channels."""
        is_in_view = self.signals.is_in_view[0] & ~self.is_unlocked[0]
        elevation = np.where(is_in_view, self.signals.elevation[0], -np.inf)
        order = np.argsort(-elevation, kind="stable")
        n_tracked = min(self.channels, int(is_in_view.sum()))
        for sat in order[:n_tracked]:
            self._change_state(0, int(sat), TRACK, "tracked from the start")

    def advance(self, step: int) -> None:
        """Advance all channels to a step: losses of lock, then ended searches and pull-ins, then new searches."""
        t = float(self.signals.t[step])
        is_hidden = ~self.signals.is_in_view[step] & (self.state != IDLE)
        for sat in np.flatnonzero(is_hidden):
            self.loss_time[sat] = np.nan
            self.failed_passes[sat] = 0
            self._change_state(step, int(sat), IDLE, CAUSES[HIDDEN])
        is_busy = (self.state == TRACK) | (self.state == ACQUIRE)
        is_unlocked = self.is_unlocked[step]
        is_failing = is_unlocked | ~np.isnan(self.loss_start)
        if np.any(is_busy & is_failing):
            for sat in np.flatnonzero(is_busy):
                self._check_lock(step, t, int(sat), bool(is_unlocked[sat]))
        if t >= self.next_time:
            is_searching = (self.state == SEARCH) | (self.state == ACQUIRE)
            for sat in np.flatnonzero(is_searching):
                self._end_pass(step, t, int(sat))
            self._schedule()
        self._start_searches(step, t)

    def _check_lock(self, step: int, t: float, sat: int, is_unlocked: bool) -> None:
        """Drop a satellite without lock for longer than the coasting time, or during pull-in.

        Parameters
        ----------
        step : int
            Index of the step.
        t : float
            Its time (s since lift-off).
        sat : int
            Index of the satellite.
        is_unlocked : bool
            Whether its loops lose lock at this step.
        """
        if not is_unlocked:
            self.loss_start[sat] = np.nan
            return
        if np.isnan(self.loss_start[sat]):
            self.loss_start[sat] = t
        if t - self.loss_start[sat] >= self.card.coast or self.state[sat] == ACQUIRE:
            if self.state[sat] == TRACK:
                self.loss_time[sat] = t
            cause = int(self.signals.cause[step, sat])
            self._free_channel(step, sat, CAUSES[cause])

    def _free_channel(self, step: int, sat: int, reason: str) -> None:
        """Free the channel. A satellite that was tracked before becomes LOST, any other IDLE."""
        self._change_state(step, sat, IDLE if np.isnan(self.loss_time[sat]) else LOST, reason)

    def _end_pass(self, step: int, t: float, sat: int) -> None:
        """End a pass that has reached the signal or its own end, or a pull-in."""
        if self.state[sat] == ACQUIRE:
            if t >= self.end_time[sat]:
                self.loss_time[sat] = np.nan
                self._change_state(step, sat, TRACK, "loops closed")
        elif t >= self.find_time[sat] and self.signals.is_strong[step, sat]:
            self.failed_passes[sat] = 0
            self._change_state(step, sat, ACQUIRE, "found")
            self.end_time[sat] = t + self.card.pull_in
        elif t >= self.end_time[sat]:
            self.failed_passes[sat] += 1
            self._free_channel(step, sat, "not found")
        elif t >= self.find_time[sat]:
            self.find_time[sat] = np.inf  # too weak when the pass reached it: the pass continues without success

    def _start_searches(self, step: int, t: float) -> None:
        """Assign free channels and searchers to satellites that are expected in view."""
        has_no_channel = (self.state == IDLE) | (self.state == LOST)
        is_waiting = self.signals.is_in_view[step] & has_no_channel
        if not np.any(is_waiting):
            return
        n_search = int(np.sum(self.state == SEARCH))
        n_acquire = int(np.sum(self.state == ACQUIRE))
        n_track = int(np.sum(self.state == TRACK))
        free_searchers = self.card.searchers - n_search
        free_channels = self.channels - n_search - n_acquire - n_track
        free_count = min(free_searchers, free_channels)
        if free_count <= 0:
            return
        is_aided = self.card.aiding == "fused" or (self.card.aiding == "own" and n_track >= FIX)
        elevation = self.signals.elevation[step]
        candidates = np.flatnonzero(is_waiting).tolist()
        order = sorted(candidates, key=lambda sat: (self.failed_passes[sat], -elevation[sat]))
        for sat in order[:free_count]:
            since_loss = t - self.loss_time[sat]
            is_recent = since_loss < self.card.memory  # false without an earlier loss (NaN)
            pass_time = self.card.reacquire_time if is_recent else self.card.search_time
            pass_time *= self.card.aided_factor if is_aided else 1.0
            self._change_state(step, sat, SEARCH, "aided search" if is_aided else "search")
            fraction = search_fraction(self.card, self.names[sat], t)
            self.find_time[sat] = t + pass_time * fraction
            self.end_time[sat] = t + pass_time
        self._schedule()

    def _change_state(self, step: int, sat: int, state: int, reason: str) -> None:
        """Change the state of a satellite and record the transition.

        Parameters
        ----------
        step : int
            Index of the step.
        sat : int
            Index of the satellite.
        state : int
            New state, as in `records.TRACKING`.
        reason : str
            Reason of the transition, for the report.
        """
        transition = ChannelTransition(
            float(self.signals.t[step]),
            self.names[sat],
            TRACKING[int(self.state[sat])],
            TRACKING[state],
            reason,
        )
        self.transitions.append(transition)
        self.state[sat] = state
        self.loss_start[sat] = np.nan
        self.find_time[sat] = np.nan
        self.end_time[sat] = np.nan

    def _schedule(self) -> None:
        """Set the time of the next event of a search or a pull-in; infinite if there is none."""
        events = np.fmin(self.find_time, self.end_time)
        self.next_time = float(np.fmin(events, np.inf).min(initial=np.inf))


class CycleSlipCard(Card):
    """Losses of phase lock that the receiver detects: it continues to measure ranges and starts a new phase.

    A channel that loses its signal, or whose antenna changes, starts a new phase in any case. The draws are the same in
    all runs.
    """

    rate: Frequency = Field(0.0, description="rate of slips of a channel, such as '2 1/h'")
    below: CarrierToNoise | None = Field(
        None, description="C/N0 below which there is no phase lock; requires a link budget"
    )
    realisation: int = Field(0, ge=0, lt=2**32, description="number of the draw of slips; the same for all runs")


def draw_cycle_slips(card: CycleSlipCard, names: tuple[str, ...], t: Floats) -> Bools:
    """Return whether a channel slips between the previous step and a step, (n_step, n_sat).

    Slips are a Poisson process. The draws depend on realisation, satellite and time (in milliseconds) only.

    Parameters
    ----------
    card : CycleSlipCard
    names : (n_sat,)
        Names of the satellites.
    t : (n_step,) s since lift-off
        Steps, rising.
    """
    # 1 - exp(-rate dt)
    interval = np.diff(t, prepend=t[:1])
    probability = -np.expm1(-card.rate * interval)
    slips = np.zeros((t.size, len(names)), dtype=np.bool_)
    if card.rate <= 0.0:
        return slips
    for s, name in enumerate(names):
        for step in range(t.size):
            draw = _uniform(card.realisation, "cycle slip", name, t[step])
            slips[step, s] = draw < probability[step]
    return slips


def is_continuous(
    card: CycleSlipCard | None,
    names: tuple[str, ...],
    t: Floats,
    step_epoch: Ints,
    is_tracked: Bools,
    antenna: Ints,
    cn0: Floats,
) -> Bools:
    """Return whether a carrier was tracked without interruption since the previous epoch, (n_epoch, n_sat).

    Parameters
    ----------
    card : CycleSlipCard or None
    names : (n_sat,)
        Names of the satellites.
    t : (n_step,) s
        Steps, rising.
    step_epoch : (n_step,)
        Epoch at the end of the interval of each step; that of the first step is 0.
    is_tracked : (n_step, n_sat) bool
        Whether the channel tracks its signal.
    antenna : (n_step, n_sat)
        Antenna that receives it.
    cn0 : (n_step, n_sat) dB-Hz
    """
    is_locked = is_tracked.copy()
    if card is not None and card.below is not None:
        is_locked &= cn0 >= card.below
    is_carrier_continuous = is_locked.copy()
    same_antenna = antenna[1:] == antenna[:-1]
    is_carrier_continuous[1:] &= is_locked[:-1] & same_antenna
    is_carrier_continuous[:1] = False
    if card is not None:
        is_carrier_continuous &= ~draw_cycle_slips(card, names, t)
    n_epoch = int(step_epoch[-1]) + 1 if step_epoch.size else 0
    is_uninterrupted = np.ones((n_epoch, len(names)), dtype=np.bool_)
    np.logical_and.at(is_uninterrupted, step_epoch, is_carrier_continuous)
    return is_uninterrupted
