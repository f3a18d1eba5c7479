"""The study of Beaudoin et al.'s filter: ``python campaigns/drdc/study.py --keep reports/drdc``."""

from pathlib import Path

from drdc_figures import apart, apart_faults, ignition, interpretations, interpretations_table, phases, worth
from drdc_metrics import METRICS

from lvnav_studies import Publication, main
from lvnav_studies.claims import Claims
from lvnav_trade.api.measures import cases_of
from lvnav_trade.api.pages import Block, StudyFigure, StudyResult


def blocks(one: StudyResult, claims: Claims) -> list[Block]:
    """Return the readings of one datasheet side by side."""
    return interpretations_table(one.tables)


FIGURES = {
    "phases": StudyFigure(
        lambda one, figure: phases(one.tables, cases_of(one.tables, figure.case, ())[0]),
        "Phases of the flight by its events.",
    ),
    "ignition": StudyFigure(
        lambda one, figure: ignition(one.tables, cases_of(one.tables, figure.case, ())[0]),
        "Filtered over raw sample around lift-off.",
    ),
    "apart": StudyFigure(
        lambda one, figure: apart(one.tables, figure.cases, figure.settings.get("axes")),
        "By how many percent the true sigma of one case is smaller than that of another, linear covariance.",
        apart_faults,
    ),
    "interpretations": StudyFigure(
        lambda one, figure: interpretations(one.tables),
        "By how much the estimate's sigma is below the sample's; marks: published values.",
    ),
    "worth": StudyFigure(
        lambda one, figure: worth(one.tables, figure.cases),
        "Effect of the rate that the controller uses: movement of the nozzle, and error of the attitude.",
    ),
}
STUDY = Publication(Path(__file__).parent, FIGURES, METRICS, blocks)

if __name__ == "__main__":
    raise SystemExit(main(STUDY))
