"""US Standard Atmosphere 1976: density, pressure, temperature and speed of sound against geometric height."""

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

# Above 86 km: the standard's table (NOAA-S/T 76-1562): m, kg/m^3, Pa, K; density and pressure interpolate in the log.
_TABLE = np.array(
    [
        [86e3, 6.958e-6, 3.7338e-1, 186.87],
        [90e3, 3.416e-6, 1.8359e-1, 186.87],
        [100e3, 5.604e-7, 3.2011e-2, 195.08],
        [110e3, 9.708e-8, 7.1042e-3, 240.00],
        [120e3, 2.222e-8, 2.5382e-3, 360.00],
        [130e3, 8.152e-9, 1.2505e-3, 469.27],
        [150e3, 2.076e-9, 4.5422e-4, 634.39],
        [200e3, 2.541e-10, 8.4736e-5, 854.56],
        [250e3, 6.073e-11, 2.4767e-5, 941.33],
        [300e3, 1.916e-11, 8.7704e-6, 976.01],
        [400e3, 2.803e-12, 1.4518e-6, 995.83],
        [500e3, 5.215e-13, 3.0236e-7, 999.24],
        [600e3, 1.137e-13, 8.2130e-8, 999.85],
        [800e3, 1.136e-14, 1.7036e-8, 999.99],
        [1000e3, 3.561e-15, 7.5138e-9, 1000.00],
    ]
)
_HIGH = _TABLE[:, 0].copy()
_HIGH_TEMPERATURE = _TABLE[:, 3].copy()
_LOG_DENSITY = np.log(_TABLE[:, 1])
_LOG_PRESSURE = np.log(_TABLE[:, 2])


@jit
def atmosphere(height: float) -> tuple[float, float, float, float]:
    """Return (density kg/m^3, pressure Pa, temperature K, speed of sound m/s) at a geometric height in m.

    The layers of the standard up to 86 km (from 5 km below sea level), its table to 1000 km, zero density and pressure
    beyond. Above 86 km the speed of sound has no meaning in the standard; it is given from the temperature all the
    same, so that a Mach number exists.
    """
    if height > TOP_OF_LAYERS:
        return _table_values(height)
    geopotential = _RADIUS * height / (_RADIUS + height)
    layer = 0
    while layer < 6 and geopotential > _BASE[layer + 1]:
        layer += 1
    rise = geopotential - _BASE[layer]
    temperature = _TEMPERATURE[layer] + _LAPSE[layer] * rise
    # barometric formula: exponential in an isothermal layer, otherwise a power of the temperature
    if _LAPSE[layer] == 0.0:
        pressure = _PRESSURE[layer] * math.exp(-_GRAVITY * rise / (_GAS * temperature))
    else:
        exponent = -_GRAVITY / (_GAS * _LAPSE[layer])
        pressure = _PRESSURE[layer] * (temperature / _TEMPERATURE[layer]) ** exponent
    density = pressure / (_GAS * temperature)
    speed_of_sound = math.sqrt(_RATIO * _GAS * temperature)
    return density, pressure, temperature, speed_of_sound


@jit
def _table_values(height: float) -> tuple[float, float, float, float]:
    """Return the same four from the table above 86 km."""
    last = _HIGH.size - 1
    if height >= _HIGH[last]:
        speed_of_sound = math.sqrt(_RATIO * _GAS * 1000.0)
        return 0.0, 0.0, 1000.0, speed_of_sound
    k = 0
    while height > _HIGH[k + 1]:
        k += 1
    share = (height - _HIGH[k]) / (_HIGH[k + 1] - _HIGH[k])
    log_density_rise = _LOG_DENSITY[k + 1] - _LOG_DENSITY[k]
    log_pressure_rise = _LOG_PRESSURE[k + 1] - _LOG_PRESSURE[k]
    temperature_rise = _HIGH_TEMPERATURE[k + 1] - _HIGH_TEMPERATURE[k]
    density = math.exp(_LOG_DENSITY[k] + share * log_density_rise)
    pressure = math.exp(_LOG_PRESSURE[k] + share * log_pressure_rise)
    temperature = _HIGH_TEMPERATURE[k] + share * temperature_rise
    speed_of_sound = math.sqrt(_RATIO * _GAS * temperature)
    return density, pressure, temperature, speed_of_sound
