"""Trade-offs for launch-vehicle navigation: which IMU, receiver and filter bring a vehicle to injection.

``run`` runs a campaign, ``load`` reads results, ``check`` validates a campaign without running it; every other verb of
the command line is a function of `lvnav_trade.api`. `InputError` is an input error, reported in one line. Conventions:

Frames
    One letter each: ``i`` Earth-centred inertial (true equator; ``e`` turns against it about z by theta0 + omega t),
    ``e`` Earth-fixed (WGS-84), ``n`` local north-east-down, ``l`` launch site, ``b`` body of the IMU (x along the roll
    axis, forward), ``a`` antenna, ``o`` orbital (radial, along-track, cross-track).
Vectors
    The last letter is the frame that resolves them: ``r_i``, ``v_i``, ``f_b``. A rate names three frames: ``w_ib_b`` is
    the rate of b against i, in b.
Rotations
    From left to right, from and to: ``v_e = C_b_e @ v_b``; ``q_b_i`` is a unit quaternion, scalar first.
Truth and estimate
    True values have plain names; where both appear the estimate ends in ``_hat``. An error is truth minus estimate,
    for attitude the small rotation from estimate to truth, so that a correction is added.
Units
    SI and radians in all code, without suffix. Cards (``"0.01 deg/h"``) and axis labels have display units; the columns
    of stored tables carry their unit (``position_north_error_m``).
Time
    ``t`` is seconds since lift-off, negative on the pad. The epoch of lift-off belongs to the trajectory.
Noise
    "Sigma" is one sigma. White noise is given by its root spectral density, a Gauss-Markov process by its steady sigma
    and time constant.
Shapes
    In the order run, epoch, satellite, component.
Randomness
    A draw depends on the campaign's seed, the run, the source and the epoch; never on the case, worker or order.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lvnav_trade.api import Results, check, compare, load, plan, replay, run, solve, tune
    from lvnav_trade.quantities.errors import InputError

__all__ = ["InputError", "Results", "check", "compare", "load", "plan", "replay", "run", "solve", "tune"]


def __dir__() -> list[str]:
    """Return the names of the module, with those that are imported on first access."""
    return sorted({*globals(), *__all__, "__version__"})


def __getattr__(name: str) -> Any:
    """Import a public name on first access, so that ``import lvnav_trade`` is fast."""
    import importlib

    if name == "InputError":
        return importlib.import_module("lvnav_trade.quantities.errors").InputError
    if name in __all__:
        return getattr(importlib.import_module("lvnav_trade.api"), name)
    if name == "__version__":
        return importlib.import_module("lvnav_trade.results.tables.versions").tool_version()
    raise AttributeError(f"module 'lvnav_trade' has no attribute {name!r}")
