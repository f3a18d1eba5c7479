"""Figures of nozzle movement and of motion in its envelopes show what the tables hold."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lvnav_trade.plots.nozzle import envelopes


class _Tables:
    """The one table that the figure reads."""

    def __init__(self, motion: pd.DataFrame) -> None:
        self.motion = motion


def test_the_envelope_is_drawn_on_both_sides(monkeypatch):
    t = np.linspace(0.0, 100.0, 11)
    rows = {"case": "a", "axis": "pitch", "t_s": t, "turning_rad_per_s2": 0.0, "turning_bound_rad_per_s2": 0.02,
            "jerk_m_per_s3": 0.0, "jerk_bound_m_per_s3": 10.0}  # fmt: skip
    monkeypatch.setattr("lvnav_trade.plots.style.load", lambda tables: tables)
    other = pd.DataFrame(rows | {"axis": "yaw", "turning_bound_rad_per_s2": 9.0})
    figure = envelopes(_Tables(pd.concat([pd.DataFrame(rows), other])), "a")
    for axes, bound in zip(figure.axes, (0.02, 10.0), strict=True):
        shown = [line.get_ydata()[0] for line in axes.get_lines()]
        np.testing.assert_allclose(sorted(shown), [-bound, 0.0, bound])
        assert len(axes.get_lines()[0].get_xdata()) == t.size  # of pitch alone
    assert "(s)" in figure.axes[1].get_xlabel()
