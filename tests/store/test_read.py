"""Reading what is not there."""

from __future__ import annotations

import pytest

from lvnav_trade.errors import InputError
from lvnav_trade.store import load


def test_no_results_is_a_users_error(tmp_path):
    with pytest.raises(InputError, match="no results here"):
        load(tmp_path)
