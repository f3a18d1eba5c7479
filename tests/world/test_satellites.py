import numpy as np
import pytest
from ruamel.yaml import YAML

from lvnav_trade.world.constellation import NominalConstellation, orbits, satellite_ecef
from lvnav_trade.world.satellites import satellites

EPOCH = "2026-08-01T12:00:00Z"


@pytest.fixture(scope="module")
def gps_24(root):
    return NominalConstellation(**YAML(typ="safe").load(root / "configs/constellations/gps_24.yaml"))


def test_nominal_satellites_stand_where_their_elements_say(gps_24):
    above, t = satellites(gps_24, EPOCH), np.array([[0.0], [600.0]])
    assert above.systems == ("G",) * 24
    assert above.names == tuple(slot.name for slot in gps_24.slots)
    for ours, elements in zip(above.ecef(t), satellite_ecef(orbits(gps_24, EPOCH), t), strict=True):
        np.testing.assert_array_equal(ours, elements)
