"""The study of Thomas et al.'s filter: ``python campaigns/gains/study.py --keep reports/gains``."""

from pathlib import Path

from gains_figures import draw_single, missions, missions_table, noise_blocks, single_faults

from lvnav_studies import Publication, main
from lvnav_studies.claims import Claims
from lvnav_trade.api.figures import Figure
from lvnav_trade.api.flights import case_with, process_noise
from lvnav_trade.api.pages import Block, FigureEntry, StudyFigure, StudyResult

ENSEMBLES = {"model_validation": (1100.0,), "process_noise": (1.0, 100.0)}
"""Lengths of a step (s) at which the process noise of a campaign's first case is estimated."""
RUNS = 100  # of an ensemble


def blocks(one: StudyResult, claims: Claims) -> list[Block]:
    """Return the table of the real missions of a campaign, and its estimates of process noise."""
    found = missions_table(one.tables, claims.model_dump(mode="json")["missions"])
    for step in ENSEMBLES.get(one.campaign.name, ()):
        noise = process_noise(one.campaign, case_with(one.campaign, {}), RUNS, step)
        found += noise_blocks(one.campaign.name, noise, step)
    return found


def draw_missions(one: StudyResult, figure: FigureEntry) -> Figure | None:
    """Draw the real missions of a campaign among our flights."""
    return missions(one.tables, STUDY.campaign_claims(one.campaign.name).model_dump(mode="json")["missions"])


FIGURES = {
    "missions": StudyFigure(draw_missions, "Flown missions among our flights."),
    "single": StudyFigure(
        draw_single,
        "One flight (run 0): the error of the unaided system, what the filter estimates of it, and what is left.",
        single_faults,
    ),
}
STUDY = Publication(Path(__file__).parent, FIGURES, blocks=blocks)

if __name__ == "__main__":
    raise SystemExit(main(STUDY))
