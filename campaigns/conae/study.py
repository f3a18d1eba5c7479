"""The study of Canepa and Servidia's couplings: ``python campaigns/conae/study.py --keep reports/conae``."""

from pathlib import Path

from conae_figures import clocks_faults, draw_antennas, draw_clocks

from lvnav_studies import Publication, main
from lvnav_trade.api.pages import StudyFigure

FIGURES = {
    "clocks": StudyFigure(
        draw_clocks,
        "One flight: the receiver's clock, and what its own solution makes of it, as values.",
        clocks_faults,
    ),
    "antennas": StudyFigure(
        draw_antennas, "Gain of one antenna off its boresight, and of all around the body; none beyond the cut-off."
    ),
}
STUDY = Publication(Path(__file__).parent, FIGURES)

if __name__ == "__main__":
    raise SystemExit(main(STUDY))
