"""Report section on where guided ascents arrive."""

import pandas as pd

from lvnav_trade.report.blocks import Block, Text, few, figures, of, stated
from lvnav_trade.report.escape import note
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.tables.read import Tables

_LOST_SHOWN = 10  # of a case, of the runs that do not reach their cut-off
_LEAST_SHARE = 0.01  # of the variance, of a source that is shown
_SHOWN = ("semi_major_axis", "eccentricity_along_node", "eccentricity_ahead_of_node", "inclination")  # on the page


@of("injection")
def injection(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return errors of the achieved orbits with their parts, how the runs end, and pictures."""
    ends = METRICS["cutoff"](tables)
    spread = ends.low_ratio.map("{:.3g}".format) + " to " + ends.high_ratio.map("{:.3g}".format)
    spread = spread.where(ends.runs > 0, "-")
    lost = METRICS["lost"](tables).groupby("case", sort=False).head(_LOST_SHOWN)
    sources = METRICS["injection_sources"](tables)
    large = sources.quantity.isin(_SHOWN) & ~(sources.share_ratio < _LEAST_SHARE)
    budget = [stated("injection_sources", sources[large])] if large.any() else []
    expected = frame[frame.reason != ""].drop_duplicates(["case", "reason"])
    reasons = [Text(f"{row.case}: linear covariance does not apply ({row.reason}).") for row in expected.itertuples()]
    guided, more = few([case for case, label in tables.labels.items() if label in set(ends.case)])
    return [
        Text(note("injection")),
        stated("injection", frame),
        *reasons,
        *budget,
        stated("cutoff", ends.assign(interval=spread)),
        *([stated("lost", lost)] if len(lost) else []),
        *figures(tables, "injection", guided),
        *more,
    ]
