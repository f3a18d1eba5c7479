"""Entries of Jacobian rows, and the states that they stand for."""

from __future__ import annotations

import numpy as np

from lvnav_trade.filter.states import TYPES, channel_types
from lvnav_trade.quantities.state_layout import state_names
from tests.building import MATCHED, case

TDCP = (
    MATCHED, "base.filter.measurements=[pseudorange, tdcp]", "base.receiver.lever_b=[1 m, 0.5 m, -0.3 m]",
    "base.filter.extra_states=[range_bias]", "base.receiver.multipath=1 m",
)  # fmt: skip


def test_a_difference_has_what_a_range_has_and_the_same_of_the_clones():
    prepared_case = case(*TDCP)
    model, names, channels = prepared_case.model, state_names(prepared_case.layout), prepared_case.channels
    seen = int(np.flatnonzero(channels.is_tracked)[0])
    of_range, of_difference = (
        model.n_observable * seen + channels.observables.index(name) for name in ("pseudorange", "tdcp")
    )
    ranged, differenced = ({names[s] for s in model.column[channel, : model.n_entry[channel]]}
                           for channel in (of_range, of_difference))  # fmt: skip
    assert differenced == ranged | {f"delayed_{name}" for name in ranged}
    entries = model.entry[of_difference, : model.n_entry[of_difference]]
    assert len(set(entries.tolist())) == entries.size
    assert entries.max() < model.entry.shape[1]


def test_channels_of_a_satellite_have_the_types_of_its_observables():
    channels = case(*TDCP).channels
    found = channel_types(channels)[: len(channels.observables)]
    assert found.tolist() == [TYPES[name] for name in ("pseudorange", "range_rate", "tdcp")]
