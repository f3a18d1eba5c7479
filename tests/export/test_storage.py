"""Where numbers of a filter stand: tables of what does not change, inputs of what does."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.export.storage import Storage
from lvnav_trade.export.translation.program import Program
from lvnav_trade.export.translation.values import ONLY, SAME, Constant, RecordValue
from tests.export.cases import prepared_of


@pytest.fixture(scope="module")
def prepared_case():
    return prepared_of({"measurements": "ranges", "correction": "closed"})


def test_what_is_the_same_at_every_epoch_is_a_table(prepared_case):
    storage = Storage(prepared_case, Program("f"))
    variance = storage.signals.fields["variance"]
    assert variance.rings[0] == SAME
    np.testing.assert_array_equal(variance.value, prepared_case.signals.variance[0])
    assert "variance" not in storage.inputs["epoch"]


def test_what_differs_between_epochs_is_an_input(prepared_case):
    variance = prepared_case.signals.variance.copy()
    variance[3] *= 2.0
    changed = prepared_case._replace(signals=prepared_case.signals._replace(variance=variance))
    storage = Storage(changed, Program("f"))
    array, value, axis = storage.inputs["epoch"]["variance"]
    assert array.text == "self->epoch.variance"
    assert array.rings[0] == ONLY
    assert (value is variance, axis) == (True, 0)


def test_what_is_true_of_the_flight_is_not_there(prepared_case):
    storage = Storage(prepared_case, Program("f"), 2)
    assert not {"range", "rate", "position", "sigma", "correlated_errors"} & set(storage.signals.fields)
    assert storage.options.fields["reported_solution"] == Constant(None)
    assert isinstance(storage.optional_state, RecordValue)
    assert storage.state["innovation"].rings[0] == 2
