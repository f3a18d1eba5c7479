"""Public functions: every verb of the command line as a function of the same name, with the types of their results.

Names are those of the command line with an underscore for a hyphen: ``lvnav-trade export-vectors`` is
`export_vectors`. A function returns a record with named fields instead
of printing, and raises `InputError` instead of returning exit code 2. A notebook shows a record as tables.
"""

from lvnav_trade.api.campaigns import Task, check, plan, replay, run, selfcheck, status
from lvnav_trade.api.clusters import dask, merge, run_shard
from lvnav_trade.api.derived import estimate_q, export_trajectory, init, schedule_gains
from lvnav_trade.api.designs import Designs, cases
from lvnav_trade.api.display import CampaignStatus, ExportedTrajectory, FittedImu, ProcessedLog, StartedCampaign
from lvnav_trade.api.exports import export_filter, export_vectors
from lvnav_trade.api.logs import fit_unit, process_log
from lvnav_trade.api.plotting import Plot, Plots
from lvnav_trade.api.reference import card_text, cards, fields, metrics, schema
from lvnav_trade.api.reports import compare, keep_base, kml, load, report
from lvnav_trade.api.results import (
    FAILED,
    INTERNAL,
    INTERRUPTED,
    MET,
    UNDECIDED,
    USAGE,
    VIOLATED,
    Results,
    Summary,
    exit_code,
)
from lvnav_trade.api.searches import indices, solve, tune
from lvnav_trade.api.selecting import case_of
from lvnav_trade.api.studies import StudyWatch, study
from lvnav_trade.api.types import (
    CheckedCampaign,
    Comparison,
    EstimatedNoise,
    MetricNames,
    Plan,
    ReplayedRun,
    ReportFiles,
    SelfCheck,
    Sensitivity,
    Solution,
    Study,
    Tuning,
)

__all__ = [
    "FAILED",
    "INTERNAL",
    "INTERRUPTED",
    "MET",
    "UNDECIDED",
    "USAGE",
    "VIOLATED",
    "CampaignStatus",
    "CheckedCampaign",
    "Comparison",
    "Designs",
    "EstimatedNoise",
    "ExportedTrajectory",
    "FittedImu",
    "MetricNames",
    "Plan",
    "Plot",
    "Plots",
    "ProcessedLog",
    "ReplayedRun",
    "ReportFiles",
    "Results",
    "SelfCheck",
    "Sensitivity",
    "Solution",
    "StartedCampaign",
    "Study",
    "StudyWatch",
    "Summary",
    "Task",
    "Tuning",
    "card_text",
    "cards",
    "case_of",
    "cases",
    "check",
    "compare",
    "dask",
    "estimate_q",
    "exit_code",
    "export_filter",
    "export_trajectory",
    "export_vectors",
    "fields",
    "fit_unit",
    "indices",
    "init",
    "keep_base",
    "kml",
    "load",
    "merge",
    "metrics",
    "plan",
    "process_log",
    "replay",
    "report",
    "run",
    "run_shard",
    "schedule_gains",
    "schema",
    "selfcheck",
    "solve",
    "status",
    "study",
    "tune",
]
