"""Cases whose filter can be handed over."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from lvnav_trade.export.scope import refuse_redundant_imus
from lvnav_trade.quantities.errors import InputError


def _prepared(units):
    return SimpleNamespace(options=SimpleNamespace(imu_array=units))


def test_redundant_imus_are_refused_and_others_are_not():
    refuse_redundant_imus(_prepared(None))
    refuse_redundant_imus(_prepared(SimpleNamespace(redundant=None)))
    with pytest.raises(InputError, match="tested before the filter"):
        refuse_redundant_imus(_prepared(SimpleNamespace(redundant=object())))
