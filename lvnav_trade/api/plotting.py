"""Figures of results: `results.plot.NAME()` returns a figure, which a notebook displays and `save` writes to a file."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.results.tables.read import Tables

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from lvnav_trade.report.figures.figure import Figure

_QUANTITY = "velocity"
_FORMATS = ("png", "svg")


@dataclass(frozen=True, repr=False)
class Plot:
    """A figure of results.

    Attributes
    ----------
    name : str
        Name of the figure.
    figure : lvnav_trade.report.figures.figure.Figure
        Content of the figure: panels with their marks, axes and labels.
    """

    name: str
    figure: Figure

    def matplotlib(self) -> Drawing:
        """Return the figure as a matplotlib figure, for further changes.

        Returns
        -------
        matplotlib.figure.Figure
            The figure; pyplot does not manage it, so it needs no closing.
        """
        from lvnav_trade.report.figures.raster import matplotlib_figure

        return matplotlib_figure(self.figure)

    def save(self, file: str | Path) -> Path:
        """Write the figure as PNG or SVG.

        Parameters
        ----------
        file : str or Path
            File to write; its extension, .png or .svg, selects the format.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        InputError
            The extension is another, or the file cannot be written.
        """
        path = Path(file)
        file_format = path.suffix.lower().lstrip(".")
        if file_format not in _FORMATS:
            raise InputError(f"{path}: a figure is saved as .png or .svg")
        with writing(path, "the figure cannot be written there"):
            path.write_bytes(self._encode(file_format))
        return path

    def _encode(self, file_format: str) -> bytes:
        """Return the content of a file of the figure."""
        from lvnav_trade.report.figures.raster import figure_bytes

        return figure_bytes(self.figure, file_format)

    def _repr_png_(self) -> bytes:
        return self._encode("png")

    def __repr__(self) -> str:
        from lvnav_trade.report.figures.figure import alt_text

        return f"<Plot {self.name}: {'; '.join(alt_text(panel) for panel in self.figure.panels if panel.marks)}>"


class Plots:
    """Figures of results by name: ``results.plot.budget()``.

    The arguments are those of the figure's function without the results. `case` is a label, a digest or the first
    digits of a digest, by default the first case. `quantity` is velocity by default. Other arguments without a default
    are required.
    """

    # Figures of every campaign; `dir` lists all
    trajectory: Callable[..., Plot]  # altitude, speed, specific force, ground track
    envelope: Callable[..., Plot]  # errors of a quantity over time, by axis
    errors: Callable[..., Plot]  # an error of all cases over time
    relative: Callable[..., Plot]  # an error of all cases over that of the first
    comparison: Callable[..., Plot]  # 3-D error of all cases over time
    rank: Callable[..., Plot]  # cases by their velocity error at injection
    quantiles: Callable[..., Plot]  # quantiles of a 3-D error over the runs, with limits
    consistency: Callable[..., Plot]  # ANEES and ANIS with their bounds
    autocorrelation: Callable[..., Plot]  # autocorrelation of the innovations
    budget: Callable[..., Plot]  # variance of a 3-D error by source
    heatmap: Callable[..., Plot]  # contribution of each source by time of origin
    curves: Callable[..., Plot]  # error over a numeric axis
    tornado: Callable[..., Plot]  # range of an error by axis
    pareto: Callable[..., Plot]  # error over cost or mass
    satellites: Callable[..., Plot]  # satellites tracked over time
    sky: Callable[..., Plot]  # azimuth and elevation of the satellites
    timeline: Callable[..., Plot]  # tracking of each satellite over time
    orbit: Callable[..., Plot]  # errors of the orbit at injection
    impact: Callable[..., Plot]  # point of impact with its error

    def __init__(self, tables: Tables) -> None:
        self._tables = tables

    def __dir__(self) -> list[str]:
        from lvnav_trade.report.figures import PLOTS

        return sorted(PLOTS)

    def __getattr__(self, name: str) -> Callable[..., Plot]:
        from lvnav_trade.report.figures import PLOTS

        if name.startswith("_"):
            raise AttributeError(name)
        if name not in PLOTS:
            raise AttributeError(f"there is no figure {name!r}{hint(name, PLOTS)}")
        return _bind_tables(name, PLOTS[name], self._tables)


def _bind_tables(name: str, plot: Callable[..., Any], tables: Tables) -> Callable[..., Plot]:
    """Return a figure's function without its first argument, the tables."""
    parameters = list(inspect.signature(plot).parameters.values())[1:]
    signature = inspect.Signature([_set_default(parameter) for parameter in parameters], return_annotation=Plot)

    def draw(*args: Any, **kwargs: Any) -> Plot:
        bound = signature.bind(*args, **kwargs)
        bound.apply_defaults()
        if "case" in signature.parameters:
            bound.arguments["case"] = case_digest(tables, bound.arguments["case"])
        figure = plot(tables, *bound.args, **bound.kwargs)
        if figure is None:
            raise InputError(f"{name}: there is nothing to draw in these results")
        return Plot(name, figure)

    draw.__name__ = name
    draw.__doc__ = plot.__doc__
    draw.__signature__ = signature  # type: ignore[attr-defined]
    return draw


def _set_default(parameter: inspect.Parameter) -> inspect.Parameter:
    """Return a parameter; `case` and `quantity` get the defaults of this module."""
    defaults: dict[str, Any] = {"case": None, "quantity": _QUANTITY}
    if parameter.name in defaults and parameter.default is parameter.empty:
        return parameter.replace(default=defaults[parameter.name], kind=parameter.POSITIONAL_OR_KEYWORD)
    return parameter.replace(kind=parameter.POSITIONAL_OR_KEYWORD)


def case_digest(tables: Tables, case_text: str | None) -> str:
    """Return the digest of a case of results.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case_text : str or None
        Label, digest or first digits of a digest; the first case if None.

    Returns
    -------
    str
        Digest of the case.

    Raises
    ------
    InputError
        The text fits no case, or several.
    """
    labels = tables.labels
    if case_text is None:
        return next(iter(labels))
    matching_cases = [case for case, label in labels.items() if label == case_text or case.startswith(case_text)]
    if len(matching_cases) == 1:
        return matching_cases[0]
    if matching_cases:
        raise InputError(f"{case_text!r} fits several cases, give more of one: {', '.join(matching_cases)}")
    raise InputError(
        f"no case {case_text!r}{hint(case_text, list(labels.values()))}; the cases are {', '.join(labels.values())}"
    )
