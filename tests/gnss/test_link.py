import math

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.gnss.link import CosineGain, TableGain, pattern_gain


def test_a_cosine_falls_by_its_power_down_to_the_back_lobes():
    found = pattern_gain(CosineGain(peak="5 dBi", exponent=2.0), np.radians([0.0, 60.0, 89.9, 150.0]))
    np.testing.assert_allclose(found, [5.0, 5.0 + 20.0 * math.log10(0.5), -10.0, -10.0], atol=1e-9)


def test_a_table_is_interpolated_and_level_beyond_its_ends():
    table = TableGain(angle=["10 deg", "50 deg"], gain=["4 dBi", "0 dBi"])
    np.testing.assert_allclose(pattern_gain(table, np.radians([0.0, 30.0, 90.0])), [4.0, 2.0, 0.0], atol=1e-9)


def test_a_table_whose_columns_differ_in_length_is_refused():
    with pytest.raises(ValidationError, match="2 angles but 1 gains"):
        TableGain(angle=["10 deg", "50 deg"], gain=["4 dBi"])
