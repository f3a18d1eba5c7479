"""What a flight takes in: every array of a run has a shape, and every shape an array."""

from __future__ import annotations

from lvnav_trade.engines.inputs import Sizes, Work, work_shapes

SIZES = Sizes(
    n_state=20, n_par=2, n_true=5, n_block=10, n_tick=20, n_hist=31, n_epoch=30, n_slot=8, n_channel=48, n_antenna=4,
    n_entry=12, n_shared=3, n_extra=2,
)  # fmt: skip


def test_shapes_stand_in_the_order_of_the_record():
    assert list(work_shapes(SIZES)) == [f for f in Work._fields if f not in Work._field_defaults]


def test_rows_have_room_for_every_slot_or_a_solution_and_an_altimeter():
    assert work_shapes(SIZES)["H"] == (17, 12)
    assert work_shapes(SIZES._replace(n_slot=1))["H"] == (7, 12)


def test_an_array_that_a_case_does_not_need_is_never_empty():
    # a lane view of no length has no type that the compiled flight knows
    shapes = work_shapes(SIZES._replace(n_shared=0, n_extra=0, n_par=0, n_true=0))
    assert all(shapes[name][0] == 1 for name in ("shared", "extra", "par", "true_par"))
