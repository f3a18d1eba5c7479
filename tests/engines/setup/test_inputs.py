"""What a flight takes in: every array of a run has a shape, and every shape an array."""

from __future__ import annotations

from lvnav_trade.engines.setup.inputs import Sizes, Work, work_shapes

SIZES = Sizes(
    n_state=20, n_par=2, n_true=5, n_block=10, n_tick=20, n_hist=31, n_epoch=30, n_slot=8, n_channel=48, n_antenna=4,
    n_entry=12, n_shared=3, n_extra=2, n_row=17, n_out=20, n_sensor=1,
)  # fmt: skip


def test_shapes_stand_in_the_order_of_the_record():
    assert list(work_shapes(SIZES)) == [f for f in Work._fields if f not in Work._field_defaults]


def test_rows_and_sensors_have_as_much_room_as_the_case_has_of_them():
    shapes = work_shapes(SIZES)
    assert (shapes["H"], shapes["z"], shapes["observed"]) == ((17, 12), (17,), (1, 4))
    assert (shapes["err"], shapes["sigma"]) == ((31, 20), (31, 20))


def test_an_array_that_a_case_does_not_need_is_never_empty():
    # a lane view of no length has no type that the compiled flight knows
    shapes = work_shapes(SIZES._replace(n_shared=0, n_extra=0, n_par=0, n_true=0, n_sensor=0))
    assert all(shapes[name][0] == 1 for name in ("shared", "extra", "par", "true_par", "observed"))
