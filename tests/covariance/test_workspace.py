"""What a pass of linear covariance keeps for the way back."""

from __future__ import annotations

from lvnav_trade.covariance.history import forward_tape
from lvnav_trade.covariance.workspace import new_tape
from lvnav_trade.kernels.strapdown import N_SUM
from tests.building import LOOSE, case


def test_a_tape_that_keeps_nothing_has_no_length():
    tape = new_tape(100, 0, 17, 10)
    assert tape.sums.shape == (0, N_SUM)
    assert tape.channel.size == 0


def test_a_tape_holds_every_update_of_the_filter_in_order():
    prepared_case = case()
    tape = forward_tape(prepared_case)
    used = int(tape.n_recorded[0])
    assert used == 2 * int(prepared_case.signals.n_used.sum()) == tape.first[-1]
    assert sorted(tape.epoch[:used].tolist()) == tape.epoch[:used].tolist()
    assert set((tape.channel[:used] % 2).tolist()) == {0, 1}


def test_a_loose_filter_has_six_rows_where_there_are_four_satellites():
    prepared_case = case(LOOSE)
    tape = forward_tape(prepared_case)
    assert int(tape.n_recorded[0]) == 6 * int((prepared_case.signals.n_used >= 4).sum())


def test_gains_of_samples_have_room_for_every_joint_state() -> None:
    """Clones of a filter that takes late measurements are joint states behind those of the filter."""
    assert new_tape(5, 3, 41, 10, 7).sample_gain.shape == (7, 6, 41)
