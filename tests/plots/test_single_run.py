"""The figure of one flight."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lvnav_trade.plots.single_run import single


def test_every_axis_has_its_error_and_its_estimate_and_what_is_left_with_units():
    names = [f"{kind}_{axis}" for kind in ("velocity", "position") for axis in ("radial", "along", "cross")]
    table = {f"{name}_{what}": np.linspace(0.0, k, 20) for k, name in enumerate(names)
             for what in ("true", "estimated", "left")}  # fmt: skip
    figure = single(pd.DataFrame({"t_s": np.arange(20.0), **table}))
    assert [ax.get_title() for ax in figure.axes[:3]] == ["position, radial", "position, along", "position, cross"]
    assert [ax.get_ylabel() for ax in figure.axes[::3]] == ["m", "left (m)", "m/s", "left (m/s)"]
    assert [len(ax.lines) for ax in figure.axes[:6]] == [2, 2, 2, 2, 2, 2]
    assert "s)" in figure.axes[-1].get_xlabel()
