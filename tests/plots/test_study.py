"""Figures of a study: one simulated flight, and the error per step."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lvnav_trade.plots.study import single, steps


def test_every_axis_has_its_error_and_its_estimate_and_what_is_left_with_units():
    names = [f"{kind}_{axis}" for kind in ("velocity", "position") for axis in ("radial", "along", "cross")]
    table = {f"{name}_{what}": np.linspace(0.0, k, 20) for k, name in enumerate(names)
             for what in ("true", "estimated", "left")}  # fmt: skip
    figure = single(pd.DataFrame({"t_s": np.arange(20.0), **table}))
    assert [ax.get_title() for ax in figure.axes[:3]] == ["position, radial", "position, along", "position, cross"]
    assert [ax.get_ylabel() for ax in figure.axes[::3]] == ["m", "left (m)", "m/s", "left (m/s)"]
    assert [len(ax.lines) for ax in figure.axes[:6]] == [2, 2, 2, 2, 2, 2]
    assert "s)" in figure.axes[-1].get_xlabel()


def test_three_panels_with_units_and_a_line_for_every_phase():
    columns = ("attitude_{}_rad", "velocity_{}_m_per_s", "position_{}_m")
    kinds = ("error", "missed", "missed_mean")
    table = pd.DataFrame({c.format(k): np.linspace(1.0, 2.0, 30) for c in columns for k in kinds})
    figure = steps(table.assign(t_s=np.arange(30.0)), [("start to cutoff", 0.0, 12.0), ("cutoff to end", 12.0, 29.0)])
    assert [ax.get_ylabel().split("(")[-1] for ax in figure.axes] == ["mrad)", "m/s)", "m)"]
    assert "s)" in figure.axes[-1].get_xlabel()
    assert all(len(ax.lines) == 5 for ax in figure.axes)
