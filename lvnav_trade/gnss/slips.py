"""Phase lock: whether a carrier was tracked without interruption from one epoch to the next."""

import numpy as np
from pydantic import Field

from lvnav_trade.kernels.random import philox, seed_words, source_word
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.quantities.units import Card, CarrierToNoise, Frequency


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


def slipped(card: CycleSlipCard, names: tuple[str, ...], t: Floats) -> Bools:
    """Return whether a channel slips between the previous step and a step, (n_step, n_sat); t (n_step,) s, rising.

    Slips are a Poisson process. The draws depend on realisation, satellite and time (in milliseconds) only.
    """
    chance = -np.expm1(-card.rate * np.diff(t, prepend=t[:1]))
    slips = np.zeros((t.size, len(names)), dtype=np.bool_)
    for s, name in enumerate(names if card.rate > 0.0 else ()):
        words = source_word("cycle slip"), source_word(name)
        for step in range(t.size):
            moment = np.uint64(round(1e3 * t[step]) & 0xFFFFFFFF)
            word, _, _, _ = philox(moment, np.uint64(card.realisation), *words, *seed_words(0))
            slips[step, s] = (float(word) + 0.5) / 2.0**32 < chance[step]
    return slips


def continuous(
    card: CycleSlipCard | None, names: tuple[str, ...], t: Floats, owner: Ints, held: Bools, antenna: Ints, cn0: Floats
) -> Bools:
    """Return whether a carrier was tracked without interruption since the previous epoch, (n_epoch, n_sat).

    Parameters
    ----------
    card : CycleSlipCard or None
    names : (n_sat,)
        Names of the satellites.
    t : (n_step,) s
        Steps, rising.
    owner : (n_step,)
        Epoch at the end of the interval of each step; that of the first step is 0.
    held : (n_step, n_sat) bool
        Whether the channel tracks its signal.
    antenna : (n_step, n_sat)
        Antenna that receives it.
    cn0 : (n_step, n_sat) dB-Hz
    """
    locked = held.copy()
    if card is not None and card.below is not None:
        locked &= cn0 >= card.below
    going_on = locked.copy()
    going_on[1:] &= locked[:-1] & (antenna[1:] == antenna[:-1])
    going_on[:1] = False
    if card is not None:
        going_on &= ~slipped(card, names, t)
    uninterrupted = np.ones((int(owner[-1]) + 1 if owner.size else 0, len(names)), dtype=np.bool_)
    np.logical_and.at(uninterrupted, owner, going_on)
    return uninterrupted
