"""A dense linear filter of ranges and range rates beside the tests for faults, in ordinary Python.

Its truth, covariance and update are NumPy's own: of the tool it takes `assess` alone. Run as a program with
NUMBA_DISABLE_JIT=1 it prints what `test_common.py` reads.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.filter.policies.integrity.assess import assess
from lvnav_trade.filter.policies.integrity.state import new_monitor
from lvnav_trade.filter.policies.policy_cards import IntegrityCard, build_fault_tests
from lvnav_trade.kernels.transition import CONSTANT
from lvnav_trade.sensors.jacobian_row import H_CLOCK, H_POS, H_VEL, N_ENTRY

N, START, END = 17, 50, 110  # attitude, velocity, position, two biases, clock; epochs of 1 s
SIGMA = np.array([1e-3] * 3 + [0.05] * 3 + [1.0] * 3 + [5e-6] * 3 + [5e-3] * 3 + [3.0, 0.1])
WALK = np.array([5e-6] * 3 + [2e-3] * 3 + [1e-3] * 3 + [1e-9] * 3 + [1e-6] * 3 + [0.05, 0.02])
RANGE, RATE = 2.0, 0.1  # m, m/s
NOTHING = np.zeros(3)


class Model(NamedTuple):
    tight: bool
    n_observable: int
    decimation: int
    is_processed: np.ndarray
    n_entry: np.ndarray
    entry: np.ndarray
    column: np.ndarray
    clock: int
    par_offset: np.ndarray
    par_sensor: np.ndarray
    par_driver: np.ndarray
    n_estimated: int
    n_receiver: int


class Signals(NamedTuple):
    satellite_by_slot: np.ndarray
    n_used: np.ndarray


class Options(NamedTuple):
    fault_tests: Any
    differences: Any = None


class Case(NamedTuple):
    model: Model
    signals: Signals
    options: Options


class Work(NamedTuple):
    P: np.ndarray
    H: np.ndarray


class Fault(NamedTuple):
    """acceleration (3,) m/s^2 and rate (3,) rad/s of the unit, jump m of the clock, size m of the second satellite."""

    acceleration: np.ndarray = NOTHING
    rate: np.ndarray = NOTHING
    jump: float = 0.0
    size: float = 0.0


FAULTS = {
    "vertical acceleration": Fault(acceleration=np.array([0.0, 0.0, 0.6])),
    "rate": Fault(rate=np.array([0.0, 3e-3, 3e-3])),
    "clock": Fault(jump=40.0),
    "satellite": Fault(size=30.0),
    "none": Fault(),
}


def _transition(epoch: int) -> np.ndarray:
    force = np.array([25.0, 5.0 * np.sin(epoch / 40.0), 10.0]) if epoch % 100 < 85 else NOTHING
    crossed = np.cross(np.eye(3), force)
    Phi = np.eye(N)
    Phi[0:3, 9:12] = -np.eye(3)
    Phi[3:6, 0:3], Phi[3:6, 12:15] = crossed, -np.eye(3)
    Phi[6:9, 0:3], Phi[6:9, 3:6], Phi[6:9, 12:15] = 0.5 * crossed, np.eye(3), -0.5 * np.eye(3)
    Phi[15, 16] = 1.0
    return Phi


def fly(fault: Fault, n_sat: int, seed: int, tested: bool = True) -> dict[str, Any]:
    """Fly a filter with a fault that begins at START and lasts, and return what became of it."""
    rng = np.random.default_rng(seed)
    azimuth, elevation = rng.uniform(0.0, 2.0 * np.pi, n_sat), np.radians(rng.uniform(8.0, 85.0, n_sat))
    elevation[0] = np.radians(88.0)
    level = np.cos(elevation)
    sight = -np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)
    H, rows = np.zeros((2 * n_sat, N_ENTRY)), np.zeros((2 * n_sat, N))
    for kind, (entry, at) in enumerate(((H_POS, 6), (H_VEL, 3))):
        H[kind::2, entry : entry + 3], rows[kind::2, at : at + 3] = sight, sight
        H[kind::2, H_CLOCK], rows[kind::2, 15 + kind] = 1.0, 1.0
    entry = np.array([[H_POS, H_POS + 1, H_POS + 2, H_CLOCK], [H_VEL, H_VEL + 1, H_VEL + 2, H_CLOCK]] * n_sat)
    column = np.array([[6, 7, 8, 15], [3, 4, 5, 16]] * n_sat)
    model = Model(True, 2, 1, np.ones(2 * n_sat, dtype=bool), np.full(2 * n_sat, 4), entry, column, 15,
                  np.array([9, 12]), np.array([0, 1]), np.array([CONSTANT] * 2), N, 2 * n_sat)  # fmt: skip
    signals = Signals(np.tile(np.arange(n_sat), (END, 1)), np.full(END, n_sat))
    own = new_monitor(END, 2 * n_sat, 2 * n_sat, 5)
    tests = build_fault_tests(IntegrityCard(), 2 * n_sat * END, n_sat, 1.0)
    P, x = np.diag(SIGMA**2), SIGMA * rng.normal(size=N)
    R = np.tile([RANGE**2, RATE**2], n_sat)
    own.variance[...] = R
    case = Case(model, signals, Options(tests))
    place = []
    for epoch in range(END):
        Phi = _transition(epoch)
        x, P = Phi @ x + WALK * rng.normal(size=N), Phi @ P @ Phi.T + np.diag(WALK**2)
        if epoch >= START:
            x[0:3] += fault.rate
            x[3:6] += fault.acceleration
            x[6:9] += 0.5 * fault.acceleration
        x[15] += fault.jump if epoch == START else 0.0
        z = rows @ x + np.sqrt(R) * rng.normal(size=2 * n_sat)
        z[2] += fault.size if epoch >= START else 0.0
        use = np.ones(2 * n_sat, dtype=bool)
        if tested:
            own.z[...] = z
            assess(own, Work(P, H), case, 1.0, epoch)
            use = own.remaining_hold <= 0.0
        if np.any(use):
            h, noise = rows[use], np.diag(R[use])
            gain = P @ h.T @ np.linalg.inv(h @ P @ h.T + noise)
            x, left = x - gain @ z[use], np.eye(N) - gain @ h
            P = left @ P @ left.T + gain @ noise @ gain.T
        place.append(float(np.linalg.norm(x[6:9])))
    at = np.flatnonzero(own.fault_type)
    named = sorted({int(c) // 2 for c in np.flatnonzero(own.is_excluded.any(axis=0))})
    return {"kinds": own.fault_type[at].astype(int).tolist(), "first": int(at[0]) if at.size else -1, "named": named,
            "used": int(np.count_nonzero(use)) // 2, "largest": max(place[START:]), "last": place[-1]}  # fmt: skip


def flown(cases: list[tuple[str, int, int, bool]], flight: Callable[..., dict[str, Any]] = fly) -> list[dict[str, Any]]:
    """Return what became of flights: name of the fault, satellites, seed, with the tests or without them."""
    return [flight(FAULTS[name], *case) for name, *case in cases]


if __name__ == "__main__":
    sys.stdout.write(json.dumps(flown(json.loads(sys.argv[1]))))
