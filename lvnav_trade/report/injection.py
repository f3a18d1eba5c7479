"""Report section on where guided ascents arrive."""

import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.report.blocks import Block, Text, few, figures, of, stated
from lvnav_trade.report.escape import note
from lvnav_trade.store.read import Tables

_SHOWN = ("semi_major_axis", "eccentricity_along_node", "eccentricity_ahead_of_node", "inclination")  # on the page


@of("injection")
def injection(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return errors of the achieved orbits with their parts, how the runs end, and pictures."""
    ends = METRICS["cutoff"](tables)
    spread = ends.low_ratio.map("{:.3g}".format) + " to " + ends.high_ratio.map("{:.3g}".format)
    sources = METRICS["injection_sources"](tables)
    budget = [stated("injection_sources", sources[sources.quantity.isin(_SHOWN)])] if len(sources) else []
    guided, more = few([case for case, label in tables.labels.items() if label in set(ends.case)])
    return [
        Text(note("injection")),
        stated("injection", frame),
        *budget,
        stated("cutoff", ends.assign(interval=spread)),
        *figures(tables, "injection", guided),
        *more,
    ]
