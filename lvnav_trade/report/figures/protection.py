"""Protection levels over the flight, beside the true error."""

import numpy as np

from lvnav_trade.quantities.state_layout import PROTECTED
from lvnav_trade.report.figures.figure import GREY, Figure, canvas
from lvnav_trade.report.figures.style import PALETTE, drawing, over_time
from lvnav_trade.results.evaluation.protection import series_of
from lvnav_trade.results.statistics.select import history_of
from lvnav_trade.results.tables.read import Tables


@drawing
def protection(tables: Tables, case: str) -> Figure:
    """Draw the protection levels of a case, with a failed satellite and without, over the root mean square of the true
    error: of the runs, and by linear covariance.
    """
    figure, grid = canvas(len(PROTECTED), 1, 2.4)
    for axes, quantity in zip(grid.ravel(), PROTECTED, strict=True):
        rows, errors = series_of(tables, case, quantity), history_of(tables, case, quantity, "3d")
        unit, factor = tables.people[quantity, "3d"]
        axes.set(yscale="log", ylabel=f"{quantity} ({unit})")
        axes.plot(rows.t_s, factor * rows.level_si, color=PALETTE[1], label="protection level")
        axes.plot(rows.t_s, factor * rows.fault_free_si, color=PALETTE[1], ls="--", label="without faults")
        true = np.hypot(errors.lincov_true_si, errors.lincov_mean_si)
        axes.plot(errors.t_s, factor * true, color=GREY, label="true error (RMS), linear covariance")
        if (errors.run_count > 0).any():
            axes.plot(errors.t_s, factor * errors.rms_si, color=PALETTE[0], lw=0.8, label="runs (RMS)")
    over_time(list(grid.ravel()), tables, case)
    return figure
