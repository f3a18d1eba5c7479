"""The study of Trigo and Theil's elements: ``python campaigns/dlr/study.py --keep reports/dlr``."""

from pathlib import Path

from lvnav_studies import Publication, main

STUDY = Publication(Path(__file__).parent)

if __name__ == "__main__":
    raise SystemExit(main(STUDY))
