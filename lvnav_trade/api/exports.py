"""Export of a filter to flight software: reference vectors for its tests, and the filter itself as C."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lvnav_trade.api.selecting import case_of
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.results.tables.contents import owned_folder

if TYPE_CHECKING:
    from lvnav_trade.export.filter_code import FilterCode
    from lvnav_trade.export.vectors.vector_files import Format, ReferenceVectors


def export_vectors(
    campaign: str | Path | Campaign,
    folder: str | Path,
    case: str | None = None,
    run: int = 0,
    sets: Sequence[str] = (),
    kind: Format = "csv",
) -> ReferenceVectors:
    """Write inputs and expected outputs of a filter in one run, epoch by epoch.

    Another implementation of the filter is tested against them. The inputs are IMU samples, measurements and
    satellites. The expected outputs are the estimates and the covariance of every epoch, before and after its
    measurement updates. A README explains their use; columns.csv gives the unit and meaning of every column.

    Parameters
    ----------
    campaign : str, Path or Campaign
        Campaign file, name of a campaign that comes with the tool, or a loaded one.
    folder : str or Path
        Folder to write.
    case : str, optional
        Label of a case, or its digest or the beginning of it; the first case if absent.
    run : int
        Number of the run, from 0.
    sets : sequence of str
        Assignments such as ``filter=filters/tight``.
    kind : {"csv", "parquet"}
        Format of the tables.

    Returns
    -------
    ReferenceVectors
        Tables by name (SI, frame i and body axes), units and meaning of their columns, content of the files.

    Raises
    ------
    InputError
        The campaign has an input error or redundant IMUs, or the folder contains other files: nothing has been written.
    """
    from lvnav_trade.export.vectors.vector_files import reference_vectors

    target = owned_folder(folder, "vectors")
    loaded_campaign, found_case = case_of(campaign, sets, case)
    vectors = reference_vectors(loaded_campaign, found_case, run, kind)
    target.publish("vectors", vectors.files)
    return vectors


def export_filter(
    campaign: str | Path | Campaign,
    folder: str | Path,
    case: str | None = None,
    runs: int = 10,
    sets: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> FilterCode:
    """Write the filter of a case as C99 without dynamic allocation, and verify it by a replay of recorded runs.

    The replay needs a C compiler (CC, cc, gcc or clang); without a compiler only the files are written.

    Parameters
    ----------
    campaign : str, Path or Campaign
        Campaign file, name of a campaign that comes with the tool, or a loaded one.
    folder : str or Path
        Folder to write.
    case : str, optional
        Label of a case, or its digest or the beginning of it; the first case if absent.
    runs : int
        Runs that are recorded and replayed.
    sets : sequence of str
        Assignments such as ``filter=filters/tight``.
    progress : callable
        Called with a description of each step when it begins.

    Returns
    -------
    FilterCode
        Files, differences of the replay, whether every difference is small enough.

    Raises
    ------
    InputError
        The campaign has an input error or redundant IMUs, a kernel cannot be translated (the message names it), or the
        folder contains other files: nothing has been written.
    """
    from lvnav_trade.export.filter_code import filter_code

    target = owned_folder(folder, "code")
    loaded_campaign, found_case = case_of(campaign, sets, case)
    code = filter_code(loaded_campaign, found_case, runs, progress)
    target.publish("code", code.files)
    return code
