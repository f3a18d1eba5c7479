"""Expressions of the translator: names, indices, axes that count on."""

import numpy as np
import pytest

from lvnav_trade.export.translation.expressions import RingTooShort, constant_array
from lvnav_trade.export.translation.program import Program
from lvnav_trade.export.translation.values import (
    ONLY,
    SAME,
    Array,
    Constant,
    RecordValue,
    Scalar,
    TranslationError,
    table_of,
)


def code(function, **given):
    program = Program("state")
    program.translated_kernel(function, given, "entry")
    return program.text(["entry"])


def present(out, record, epoch):
    out[0] = record.here[epoch, 1]


def before(out, record, epoch):
    out[0] = record.here[epoch, 1] - record.here[epoch - 1, 1]


OUT, EPOCH = Array("out", (1,), "double"), Scalar("epoch", "int")


def record(depth):
    return RecordValue(f"record {depth}", {"here": Array("self->here", (depth, 3), "double", rings=(depth, 0))})


def test_an_axis_of_the_present_epoch_has_no_index():
    assert "out[0] = self->here[1];" in code(present, out=OUT, record=record(ONLY), epoch=EPOCH)


def test_an_index_that_reaches_back_needs_places():
    with pytest.raises(RingTooShort):
        code(before, out=OUT, record=record(ONLY), epoch=EPOCH)
    made = code(before, out=OUT, record=record(2), epoch=EPOCH)
    assert "out[0] = self->here[remainder_of(epoch, 2)][1] - self->here[remainder_of(epoch - 1, 2)][1];" in made


def test_along_an_axis_of_which_all_are_the_same_any_index_will_do():
    same = RecordValue("record", {"here": table_of("HERE", np.array([1.0, 7.0, 2.0]), (SAME, 0), (1, 3))})
    assert "out[0] = 0.0;" in code(before, out=OUT, record=same, epoch=EPOCH)


def test_a_field_or_a_name_that_there_is_not_is_named():
    with pytest.raises(TranslationError, match=r"record has no field of that name here: record\.here"):
        code(present, out=OUT, record=RecordValue("record", {}), epoch=EPOCH)

    def unknown(out):
        out[0] = nowhere  # noqa: F821

    with pytest.raises(TranslationError, match="no such name: nowhere"):
        code(unknown, out=OUT)


def test_a_table_of_whole_numbers_is_one_of_integers():
    assert constant_array("T", (1, 2)).c_type == "int"
    assert constant_array("T", (1, 2.5)).c_type == "double"
    assert Constant(1) == Constant(1)
