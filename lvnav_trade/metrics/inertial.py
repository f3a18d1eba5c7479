"""Inertial units: Allan deviation of a simulated stream beside the curve of the card."""

import pandas as pd

from lvnav_trade.store.read import Tables

COLUMNS = ["case", "sensor", "unit", "tau_s", "stream", "card", "ratio", "white", "instability", "walk"]
_PEOPLE = {"rad/s": ("deg/h", 206264.80624709636), "m/s^2": ("mg", 1e3 / 9.80665)}


def allan(tables: Tables) -> pd.DataFrame:
    """Return Allan deviations over the averaging time: of the stream, of the card, their ratio, and the card's parts
    (white noise with quantisation, bias instability, random walk), in deg/h and mg.
    """
    rows = tables.allan
    factor = rows.unit.map(lambda unit: _PEOPLE[unit][1]).astype(float)
    found = rows.assign(
        case=rows.case.map(tables.labels),
        unit=rows.unit.map(lambda unit: _PEOPLE[unit][0]),
        ratio=rows.stream_si / rows.card_si,
        **{name: rows[f"{name}_si"] * factor for name in ("stream", "card", "white", "instability", "walk")},
    )
    return found[COLUMNS].reset_index(drop=True)
