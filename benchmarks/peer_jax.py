"""The same work in JAX, as an afternoon's baseline: `vmap` over 100 runs, dense covariance, noise drawn inside the
scan.

17 states, unit and covariance at 200 Hz, ten satellites' pseudorange and range rate at 1 Hz.
"""

from __future__ import annotations

import time
from typing import Any

RUNS, SECONDS, RATE, SATELLITES, STATES = 100, 20, 200, 10, 17


def _step(jnp: Any, random: Any, dt: float) -> Any:
    eye3 = jnp.eye(3)

    def skew(v: Any) -> Any:
        return jnp.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])

    def turn(w: Any) -> Any:
        s = skew(w)
        return eye3 + s + 0.5 * s @ s

    def step(carry: Any, inputs: Any) -> Any:
        C, v, r, gyro_bias, accel_bias, P = carry
        dtheta, dvel, key = inputs
        noise = random.normal(key, (6,))
        w = dtheta + 1e-6 * noise[:3] - gyro_bias * dt
        f = C @ (dvel + 1e-5 * noise[3:] - accel_bias * dt)
        radius = jnp.sqrt(r @ r)
        gravity = -3.986004418e14 * r / radius**3
        v, r, C = v + f + gravity * dt, r + v * dt, C @ turn(w)
        unit = r / radius
        gradient = 3.986004418e14 / radius**3 * (3.0 * jnp.outer(unit, unit) - eye3)
        phi = jnp.eye(STATES)
        phi = phi.at[3:6, 0:3].set(-skew(f)).at[3:6, 6:9].set(gradient * dt).at[6:9, 3:6].set(eye3 * dt)
        phi = phi.at[0:3, 9:12].set(-C * dt).at[3:6, 12:15].set(-C * dt).at[15, 16].set(dt)
        diagonal = jnp.concatenate([jnp.full(3, 1e-12), jnp.full(3, 1e-8), jnp.zeros(3), jnp.full(8, 1e-14)])
        return (C, v, r, gyro_bias, accel_bias, phi @ P @ phi.T + jnp.diag(diagonal)), None

    return step


def _update(jax: Any, jnp: Any, satellites: Any) -> Any:
    def update_scalar(carry: Any, row: Any) -> Any:
        x, P = carry
        h, z, variance = row
        k = P @ h
        s = h @ k + variance
        return (x + k * (z - h @ x) / s, P - jnp.outer(k, k) / s), None

    def update(carry: Any, noise: Any) -> Any:
        C, v, r, gyro_bias, accel_bias, P = carry
        line = satellites - r
        unit = line / jnp.linalg.norm(line, axis=1, keepdims=True)
        zero = jnp.zeros((SATELLITES, STATES))
        ranges = zero.at[:, 6:9].set(-unit).at[:, 15].set(1.0)
        rates = zero.at[:, 3:6].set(-unit).at[:, 16].set(1.0)
        rows = jnp.concatenate([ranges, rates])
        variances = jnp.concatenate([jnp.full(SATELLITES, 4.0), jnp.full(SATELLITES, 0.01)])
        (x, P), _ = jax.lax.scan(update_scalar, (jnp.zeros(STATES), P), (rows, noise * jnp.sqrt(variances), variances))
        return C, v + x[3:6], r + x[6:9], gyro_bias + x[9:12], accel_bias + x[12:15], P

    return update


def speed() -> float:
    """Return simulated seconds per wall second of the whole batch, compilation excluded."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from jax import random

    dt = 1.0 / RATE
    directions = random.normal(random.PRNGKey(7), (SATELLITES, 3))
    satellites = 26.56e6 * directions / jnp.linalg.norm(directions, axis=1, keepdims=True)
    step, update = _step(jnp, random, dt), _update(jax, jnp, satellites)
    dtheta, dvel = jnp.zeros((RATE, 3)), jnp.tile(jnp.array([20.0 * dt, 0.0, 0.0]), (RATE, 1))

    def second(carry: Any, key: Any) -> Any:
        keys = random.split(key, RATE + 1)
        carry, _ = jax.lax.scan(step, carry, (dtheta, dvel, keys[:RATE]))
        carry = update(carry, random.normal(keys[RATE], (2 * SATELLITES,)))
        return carry, carry[2]

    def run(key: Any) -> Any:
        start = (jnp.eye(3), jnp.array([0.0, 7.6e3, 0.0]), jnp.array([6.7e6, 0.0, 0.0]), jnp.zeros(3), jnp.zeros(3))
        return jax.lax.scan(second, (*start, jnp.eye(STATES)), random.split(key, SECONDS))[1]

    batch = jax.jit(jax.vmap(run))
    keys = random.split(random.PRNGKey(0), RUNS)
    batch(keys).block_until_ready()
    begin = time.perf_counter()
    batch(keys).block_until_ready()
    return RUNS * SECONDS / (time.perf_counter() - begin)


def measure() -> dict[str, float]:
    """Return the speed of the batch; pin the process to one core for a figure per core."""
    return {"jax_identical_sim_s_per_s": speed()}
