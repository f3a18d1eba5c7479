"""A case that has something of all that is checked, and the checks that fail."""

from __future__ import annotations

from functools import lru_cache

from lvnav_trade.covariance.selfcheck.check import set_bounds
from tests.building import MATCHED, loaded, prepare_hop, with_fields

SEED = 1
RICH = {
    "imu.gyro.bias_instability": "3 deg/h", "imu.gyro.instability_time": "10 s", "imu.accel.rate_random_walk":
    "2 mg/sqrt(h)", "receiver.multipath": "1 m", "receiver.multipath_time": "10 s", "filter.gate": 3.0,
    "receiver.lever_b": ["2 m", "-1 m", "0.5 m"], "filter.extra_states": ["range_bias", "accel_scale_factor"],
}  # fmt: skip


@lru_cache(maxsize=4)
def rich():
    return prepare_hop(with_fields(loaded(MATCHED), **RICH))


def failed(checks):
    return [(check.quantity, *check.cell_texts) for check in set_bounds(checks) if check.verdict == "failed"]
