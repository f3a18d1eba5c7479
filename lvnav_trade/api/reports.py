"""Results from Python: load them, build their report, compare them, keep a base, write KML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from lvnav_trade.api.campaigns import run
from lvnav_trade.api.results import Results
from lvnav_trade.api.types import Comparison, ReportFiles
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables import remote
from lvnav_trade.results.tables.contents import owned_folder
from lvnav_trade.results.tables.read import load as read


def load(folder: str | Path) -> Results:
    """Load the results of a finished campaign.

    Parameters
    ----------
    folder : str or Path
        Folder of results, or an address that fsspec supports (``s3://bucket/demo``); remote results are copied first.

    Returns
    -------
    Results
        Tables, summary, figures.

    Raises
    ------
    InputError
        The folder has no results, or the campaign has not finished.
    """
    return Results(remote.fetch_results(str(folder)) if remote.is_remote(folder) else Path(folder))


def report(
    folder: str | Path,
    keep: str | Path | None = None,
    tables: bool = True,
    figures: Sequence[str] = (),
    brief: bool = False,
) -> ReportFiles:
    """Rebuild the report from stored results.

    Parameters
    ----------
    folder : str or Path
        Folder of results; report.html and the CSV tables are written there.
    keep : str or Path, optional
        Folder for a kept report of Markdown, PNG figures and CSV tables, small enough for a repository.
    tables : bool
        Whether the kept report has the CSV tables.
    figures : sequence of str
        Formats (png, svg) of the figures written next to report.html; none if empty.
    brief : bool
        Also write brief.html, a short report of at most ten A4 pages.

    Returns
    -------
    ReportFiles
        The report and the kept report.

    Raises
    ------
    InputError
        The folder has no results, or the folder of the kept report contains other files.
    """
    from lvnav_trade.report import build
    from lvnav_trade.report import keep as keep_report

    load(folder)
    if not tables and keep is None:
        raise InputError("tables are left out of a kept report only: give its folder as `keep`")
    if keep is not None:
        owned_folder(keep, "report")  # refused before the report is built
    page = build(folder, figures=figures, brief=brief)
    kept_page = None
    if keep is not None:
        kept_page = keep_report(folder, keep, writes_tables=tables)
    return ReportFiles(page, kept_page)


def compare(
    base: str | Path,
    candidate: str | Path,
    effects: Sequence[str] = (),
    confidence: float | None = None,
    mapping: Mapping[str, str] | None = None,
    jobs: int = -1,
) -> Comparison:
    """Compare two result sets run by run on the same random draws.

    The paired differences decide for every metric whether the candidate is worse, not worse, or undecided.

    Parameters
    ----------
    base, candidate : str or Path
        Folders of results, or campaign files, which are run first.
    effects : sequence of str
        Smallest changes of interest, such as ``velocity_error_3d=5%``, ``position_error_3d@stage1_cutoff=0.5 m``,
        ``velocity_error_3d:q95=5%``, ``NAME OF A REQUIREMENT=1%``; ``METRIC=none`` excludes a metric.
    confidence : float, optional
        Confidence of the verdicts; by default that of the base's campaign, or else 0.95.
    mapping : mapping of str to str, optional
        Name of a case or level in the candidate, by its name in the base.
    jobs : int
        Worker processes for campaigns that have to be run first, -1 for all cores.

    Returns
    -------
    Comparison
        `frame` with one row per case and metric, the overall `verdict`, `notes`.

    Raises
    ------
    InputError
        The two result sets are not comparable; the message gives the reason.
    """
    from lvnav_trade.results.comparison.comparison import compare as paired
    from lvnav_trade.results.comparison.comparison import parse_effects

    smallest_changes = parse_effects(effects)
    folders = []
    for place in (base, candidate):
        if Path(place).is_dir():
            folders.append(Path(place))
        else:
            folders.append(run(place, jobs=jobs, report=False).folder)
    return Comparison(*paired(folders[0], folders[1], smallest_changes, confidence, mapping))


def keep_base(folder: str | Path, target: str | Path) -> Path:
    """Copy the part of the results that `compare` needs: runs and events, some hundred kilobytes.

    Parameters
    ----------
    folder : str or Path
        Folder of results.
    target : str or Path
        Folder of the base, for example in a repository.

    Returns
    -------
    Path
        The folder of the base.

    Raises
    ------
    InputError
        The folder has no results, or the target contains other files.
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
        Trajectory card, or folder of results with all its trajectories.
    file : str or Path
        File to write.
    ellipses : bool
        Also draw 3-sigma ellipses of the position error; for results only.
    every : float
        Interval between ellipses (s); every event has an ellipse as well.
    magnify : float
        Scale factor of the ellipses.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        The card or results do not exist, or ellipses are requested for a trajectory card.
    """
    import pandas as pd

    from lvnav_trade.campaign.reading.flights import preview, read_card
    from lvnav_trade.report import kml as drawing

    if not every > 0.0 or not magnify > 0.0:
        raise InputError("the interval of the ellipses and their magnification should be above zero")
    if Path(source).is_dir():
        tables = read(source)
        flights = drawing.flights(tables, ellipses, every)
        name = str(tables.manifest.get("campaign", Path(source).name))
        return drawing.write_kml(Path(file), name, flights, magnify)
    if ellipses:
        raise InputError(f"{source}: a trajectory has no errors; give a folder of results to draw ellipses")
    trajectory = preview(read_card(str(source), Path.cwd()))
    flight = drawing.KmlFlight(trajectory.name, pd.DataFrame(trajectory.reference), pd.DataFrame(trajectory.events))
    return drawing.write_kml(Path(file), trajectory.name, [flight], magnify)
