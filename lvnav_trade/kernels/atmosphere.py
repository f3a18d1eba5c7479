"""US Standard Atmosphere 1976: density, pressure, temperature and speed of sound against geometric height."""

from __future__ import annotations

import math

import numpy as np

from lvnav_trade.kernels.jit import jit

_RADIUS = 6356766.0  # m, the standard's Earth radius for geopotential height
_GAS = 287.05287  # J/(kg K), dry air
_GRAVITY = 9.80665
_RATIO = 1.4
TOP_OF_LAYERS = 86000.0  # m, geometric

# Layers: base geopotential height (m), base temperature (K), lapse rate (K/m), base pressure (Pa).
_BASE = np.array([0.0, 11000.0, 20000.0, 32000.0, 47000.0, 51000.0, 71000.0])
_TEMPERATURE = np.array([288.15, 216.65, 216.65, 228.65, 270.65, 270.65, 214.65])
_LAPSE = np.array([-6.5e-3, 0.0, 1.0e-3, 2.8e-3, 0.0, -2.8e-3, -2.0e-3])
_PRESSURE = np.array([101325.0, 22632.064, 5474.8887, 868.01868, 110.90631, 66.938873, 3.9564205])

# Above 86 km: the standard's table (NOAA-S/T 76-1562): km, kg/m^3, Pa, K; density and pressure interpolate in the log.
_HIGH = 1000.0 * np.array(
    [86.0, 90.0, 100.0, 110.0, 120.0, 130.0, 150.0, 200.0, 250.0, 300.0, 400.0, 500.0, 600.0, 800.0, 1000.0]
)
_HIGH_DENSITY = np.array(
    [6.958e-6, 3.416e-6, 5.604e-7, 9.708e-8, 2.222e-8, 8.152e-9, 2.076e-9, 2.541e-10, 6.073e-11, 1.916e-11]
    + [2.803e-12, 5.215e-13, 1.137e-13, 1.136e-14, 3.561e-15]
)
_HIGH_PRESSURE = np.array(
    [3.7338e-1, 1.8359e-1, 3.2011e-2, 7.1042e-3, 2.5382e-3, 1.2505e-3, 4.5422e-4, 8.4736e-5, 2.4767e-5, 8.7704e-6]
    + [1.4518e-6, 3.0236e-7, 8.2130e-8, 1.7036e-8, 7.5138e-9]
)
_HIGH_TEMPERATURE = np.array(
    [186.87, 186.87, 195.08, 240.0, 360.0, 469.27, 634.39, 854.56, 941.33, 976.01, 995.83, 999.24, 999.85, 999.99]
    + [1000.0]
)
_LOG_DENSITY = np.log(_HIGH_DENSITY)
_LOG_PRESSURE = np.log(_HIGH_PRESSURE)


@jit
def atmosphere(height):  # type: ignore[no-untyped-def]
    """Return (density kg/m^3, pressure Pa, temperature K, speed of sound m/s) at a geometric height in m.

    The layers of the standard up to 86 km (from 5 km below sea level), its table to 1000 km, zero density and pressure
    beyond. Above 86 km the speed of sound has no meaning in the standard; it is given from the temperature all the same,
    so that a Mach number exists.
    """
    if height > TOP_OF_LAYERS:
        return _tabulated(height)
    geopotential = _RADIUS * height / (_RADIUS + height)
    layer = 0
    while layer < 6 and geopotential > _BASE[layer + 1]:
        layer += 1
    rise = geopotential - _BASE[layer]
    temperature = _TEMPERATURE[layer] + _LAPSE[layer] * rise
    if _LAPSE[layer] == 0.0:
        pressure = _PRESSURE[layer] * math.exp(-_GRAVITY * rise / (_GAS * temperature))
    else:
        exponent = -_GRAVITY / (_GAS * _LAPSE[layer])
        pressure = _PRESSURE[layer] * (temperature / _TEMPERATURE[layer]) ** exponent
    return pressure / (_GAS * temperature), pressure, temperature, math.sqrt(_RATIO * _GAS * temperature)


@jit
def _tabulated(height):  # type: ignore[no-untyped-def]
    """Return the same four from the table above 86 km."""
    last = _HIGH.size - 1
    if height >= _HIGH[last]:
        return 0.0, 0.0, 1000.0, math.sqrt(_RATIO * _GAS * 1000.0)
    k = 0
    while height > _HIGH[k + 1]:
        k += 1
    w = (height - _HIGH[k]) / (_HIGH[k + 1] - _HIGH[k])
    density = math.exp(_LOG_DENSITY[k] + w * (_LOG_DENSITY[k + 1] - _LOG_DENSITY[k]))
    pressure = math.exp(_LOG_PRESSURE[k] + w * (_LOG_PRESSURE[k + 1] - _LOG_PRESSURE[k]))
    temperature = _HIGH_TEMPERATURE[k] + w * (_HIGH_TEMPERATURE[k + 1] - _HIGH_TEMPERATURE[k])
    return density, pressure, temperature, math.sqrt(_RATIO * _GAS * temperature)
