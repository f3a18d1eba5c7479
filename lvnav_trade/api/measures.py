"""Results for scripts: cases by their levels, metrics of a case, intervals, comparison with published numbers.

`evaluate` returns a metric of a case three times: by the formal sigma, by the true error of linear covariance and by
the runs. `value_of` evaluates an expression of such metrics, with its interval. `add_metrics` registers the metrics of
a script, so that campaigns can name them.
"""

from lvnav_trade.results.evaluate import difference, name_of
from lvnav_trade.results.evaluation import METRICS as FRAMES
from lvnav_trade.results.evaluation.filter_consistency import whiteness
from lvnav_trade.results.evaluation.pooled_cases import axes_of, cases_of, evaluate, evaluate_single, label_of, members
from lvnav_trade.results.evaluation.published import (
    COLUMNS,
    Rows,
    in_own_unit,
    marks,
    of_cases,
    published_row,
    reference_rows,
    rows_of,
    written_unit,
)
from lvnav_trade.results.evaluation.satellite_tracking import reacquisition_times
from lvnav_trade.results.evaluation.verdicts import (
    FAILS,
    HOLDS,
    NOT_SET_UP,
    NUMBERS,
    UNDECIDED,
    ExpressionValue,
    value_of,
    verdict,
)
from lvnav_trade.results.metric import Metric, MetricValue, SingleValue
from lvnav_trade.results.metrics.nees import Nees
from lvnav_trade.results.metrics.signals import REACQUIRED
from lvnav_trade.results.registry import add_metrics
from lvnav_trade.results.statistics.select import NAVIGATION, history_of, pick
from lvnav_trade.results.tables.read import Tables

__all__ = [
    "COLUMNS",
    "FAILS",
    "FRAMES",
    "HOLDS",
    "NAVIGATION",
    "NOT_SET_UP",
    "NUMBERS",
    "REACQUIRED",
    "UNDECIDED",
    "ExpressionValue",
    "Metric",
    "MetricValue",
    "Nees",
    "Rows",
    "SingleValue",
    "Tables",
    "add_metrics",
    "axes_of",
    "cases_of",
    "difference",
    "evaluate",
    "evaluate_single",
    "history_of",
    "in_own_unit",
    "label_of",
    "marks",
    "members",
    "name_of",
    "of_cases",
    "pick",
    "published_row",
    "reacquisition_times",
    "reference_rows",
    "rows_of",
    "value_of",
    "verdict",
    "whiteness",
    "written_unit",
]
