"""Results from Python: load, report, compare, keep as a base, draw on a globe."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from lvnav_trade.api.campaigns import run
from lvnav_trade.api.results import Results
from lvnav_trade.api.types import Comparison, ReportFiles
from lvnav_trade.errors import InputError
from lvnav_trade.store import remote
from lvnav_trade.store.contents import owned
from lvnav_trade.store.read import load as read


def load(folder: str | Path) -> Results:
    """Return the results in a folder.

    Parameters
    ----------
    folder : str or Path
        Folder of results, or a place that fsspec knows (``s3://bucket/demo``), from which they are fetched.

    Returns
    -------
    Results
        Tables, summary, figures.

    Raises
    ------
    InputError
        There are no results, or the campaign has not finished.
    """
    return Results(remote.fetched(str(folder)) if remote.is_remote(folder) else Path(folder))


def report(
    folder: str | Path,
    keep: str | Path | None = None,
    tables: bool = True,
    figures: Sequence[str] = (),
    brief: bool = False,
) -> ReportFiles:
    """Build the report again from results.

    Parameters
    ----------
    folder : str or Path
        Folder of results; report.html and the CSV tables are written there.
    keep : str or Path, optional
        Folder for a kept report: Markdown, PNG figures, CSV tables.
    tables : bool
        Write the CSV tables into the kept report too.
    figures : sequence of str
        Formats (png, svg) of figures that are written next to report.html.
    brief : bool
        Write brief.html too, for at most ten sheets of A4.

    Returns
    -------
    ReportFiles
        The page and the kept report.

    Raises
    ------
    InputError
        There are no results, or a folder holds other files.
    """
    from lvnav_trade.report import build
    from lvnav_trade.report import keep as keep_report

    load(folder)
    if not tables and keep is None:
        raise InputError("tables are left out of a kept report only: give its folder as `keep`")
    if keep is not None:
        owned(keep, "report")  # refused before the report is built
    page = build(folder, figures=figures, brief=brief)
    return ReportFiles(page, keep_report(folder, keep, tables=tables) if keep is not None else None)


def compare(
    base: str | Path,
    candidate: str | Path,
    effects: Sequence[str] = (),
    confidence: float | None = None,
    mapping: Mapping[str, str] | None = None,
    jobs: int = -1,
) -> Comparison:
    """Compare two result sets run by run on the same draws: worse, not worse or undecided, metric by metric.

    Parameters
    ----------
    base, candidate : str or Path
        Folders of results, or campaign files, which are run first.
    effects : sequence of str
        Smallest changes of interest, such as ``velocity_error_3d=5%``, ``position_error_3d@stage1_cutoff=0.5 m``,
        ``velocity_error_3d:q95=5%``, ``NAME OF A REQUIREMENT=1%``; ``METRIC=none`` leaves one out.
    confidence : float, optional
        Confidence of the verdicts; 0.95 unless the base's campaign states another.
    mapping : mapping of str to str, optional
        The candidate's name of a case or level, by the base's.
    jobs : int
        Worker processes of campaigns that are run first, -1 for all cores.

    Returns
    -------
    Comparison
        `frame` with a row per case and metric, `verdict` of the whole, `notes`.

    Raises
    ------
    InputError
        The two do not compare, with the reason.
    """
    from lvnav_trade.metrics.comparison.comparison import compare as paired
    from lvnav_trade.metrics.comparison.comparison import parse_effects

    wanted = parse_effects(effects)
    folders = [
        Path(place) if Path(place).is_dir() else run(place, jobs=jobs, report=False).folder
        for place in (base, candidate)
    ]
    return Comparison(*paired(folders[0], folders[1], wanted, confidence, mapping))


def keep_base(folder: str | Path, target: str | Path) -> Path:
    """Copy what `compare` needs from results: runs and events, some hundred kilobytes.

    Parameters
    ----------
    folder : str or Path
        Folder of results.
    target : str or Path
        Folder of the base, such as one of a repository.

    Returns
    -------
    Path
        The folder of the base.

    Raises
    ------
    InputError
        There are no results, or the target holds other files.
    """
    from lvnav_trade.report import compare as comparison

    return comparison.keep_base(Path(folder), Path(target))


def kml(
    source: str | Path, file: str | Path, ellipses: bool = False, every: float = 60.0, magnify: float = 1.0
) -> Path:
    """Write trajectories as KML, for viewers of the Earth.

    Parameters
    ----------
    source : str or Path
        Trajectory card, or folder of results, all flights of which are written.
    file : str or Path
        File to write.
    ellipses : bool
        Draw 3-sigma position errors too; of results only.
    every : float
        Time between two ellipses (s); the events have one in any case.
    magnify : float
        How many times as large as the errors the ellipses are drawn.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        No such card or results, or ellipses of a trajectory card.
    """
    import pandas as pd

    from lvnav_trade.campaign.reading.flights import preview, read_card
    from lvnav_trade.report import kml as drawing

    if not every > 0.0 or not magnify > 0.0:
        raise InputError("the interval of the ellipses and their magnification should be above zero")
    if Path(source).is_dir():
        found = read(source)
        drawn = drawing.flights(found, ellipses, every)
        name = str(found.manifest.get("campaign", Path(source).name))
        return drawing.write_kml(Path(file), name, drawn, magnify)
    if ellipses:
        raise InputError(f"{source}: a trajectory has no errors; give a folder of results to draw ellipses")
    seen = preview(read_card(str(source), Path.cwd()))
    flight = drawing.Flight(seen.name, pd.DataFrame(seen.reference), pd.DataFrame(seen.events))
    return drawing.write_kml(Path(file), seen.name, [flight], magnify)
