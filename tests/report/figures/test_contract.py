"""Every figure has labelled axes and can be saved."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from PIL import Image

from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.browser import data_of
from lvnav_trade.report.figures.raster import figure_bytes, matplotlib_figure

CASE = "aaaaaaaaaaaa"
ELSEWHERE = (
    "injection",
    "validity",
    "motion",
    "apart",
    "ignition",
    "singular",
    "movement",
    "sweep",
    "turning",
    "worth",
    "interpretations",
    "allan",
    "protection",
    "curves",
    "tornado",
    "pareto",
    "worst_run",
    "effects",
    "regions",
    "swings",
)
# of a grid of two axes, see test_validity; of a vehicle, see test_vehicle; of an IMU, see test_inertial; of levels, see
# test_protection; of numeric axes, see test_curves; of costs, see test_resources; of many designs, see test_space; of a
# run, see test_errors


SIZE = {"metric": "velocity_error_3d", "at": "injection"}
ARGUMENTS = {
    "bound": ({"value": "a", "terms": {"a": SIZE}, "unit": "m/s", "along": "imu", "at_most": 1.0},),
    "trajectory": (CASE,),
    "satellites": (CASE,),
    "sky": (CASE,),
    "timeline": (CASE,),
    "logic": (CASE,),
    "decisions": (CASE,),
    "delays": (CASE,),
    "latency": (CASE,),
    "envelope": (CASE, "velocity"),
    "quantiles": (CASE, "velocity"),
    "errors": ("position",),
    "relative": ("position",),
    "autocorrelation": (),
    "locus": ("imu", {"metric": "velocity_error_3d"}, "m/s"),
    "spread": ([{"metric": "velocity_error_3d", "value": 0.5, "unit": "m/s", "single": True}],),
    "comparison": ("position",),
    "rank": (),
    "budget": (CASE, "position"),
    "heatmap": (CASE, "velocity"),
    "consistency": (CASE,),
    "orbit": (CASE,),
    "missions": ([{"item": "M, x", "metric": "velocity_error_3d", "value": 0.5, "unit": "m/s"}],),
    "impact": (CASE,),
}


@pytest.mark.parametrize("name", [name for name in PLOTS if name not in ELSEWHERE])
def test_every_axis_is_labelled(name, good):
    figure = matplotlib_figure(PLOTS[name](good, *ARGUMENTS[name]))
    for axes in figure.axes:
        if axes.get_label() == "<colorbar>":
            assert "%" in axes.get_ylabel()
            continue
        shared = axes.get_subplotspec().get_gridspec().nrows > 1 and not axes.get_subplotspec().is_last_row()
        assert axes.get_xlabel() or (shared and name in ("envelope", "consistency", "budget", "satellites", "delays"))
        assert (
            axes.get_ylabel()
            or name == "sky"
            or (
                name in ("rank", "heatmap", "autocorrelation", "missions") and not axes.get_subplotspec().is_first_col()
            )
        )


@pytest.mark.parametrize("name", [name for name in PLOTS if name not in ELSEWHERE])
@pytest.mark.parametrize("which", ["good", "alone"])
def test_every_figure_is_a_picture_and_data(name, which, request):
    figure = PLOTS[name](request.getfixturevalue(which), *ARGUMENTS[name])
    if (name, which) in (("spread", "alone"), ("missions", "alone")):
        assert figure is None  # there are no flights to stand by themselves
        return
    picture = np.asarray(Image.open(io.BytesIO(figure_bytes(figure, "png"))).convert("L"))
    assert np.mean(picture < 200) > 0.003  # ink
    found = json.loads(data_of(figure))
    assert len(found["panels"]) == len(figure.panels)
    assert any(panel["marks"] for panel in found["panels"])
