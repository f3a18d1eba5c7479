"""The figure of the error per step."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lvnav_trade.plots.steps import steps


def test_three_panels_with_units_and_a_line_for_every_phase():
    columns = ("attitude_{}_rad", "velocity_{}_m_per_s", "position_{}_m")
    kinds = ("error", "missed", "missed_mean")
    table = pd.DataFrame({c.format(k): np.linspace(1.0, 2.0, 30) for c in columns for k in kinds})
    figure = steps(table.assign(t_s=np.arange(30.0)), [("start to cutoff", 0.0, 12.0), ("cutoff to end", 12.0, 29.0)])
    assert [ax.get_ylabel().split("(")[-1] for ax in figure.axes] == ["mrad)", "m/s)", "m)"]
    assert "s)" in figure.axes[-1].get_xlabel()
    assert all(len(ax.lines) == 5 for ax in figure.axes)
