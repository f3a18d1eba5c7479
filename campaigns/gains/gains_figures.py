"""One flight aided and unaided; real missions among ours; process noise of an ensemble, as the study shows them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.api.figures import GREY, PALETTE, Figure, canvas, line_of, widen_covered
from lvnav_trade.api.flights import ProcessNoise, case_with, run_errors, steps_figure
from lvnav_trade.api.input import Campaign, InputError, Levels
from lvnav_trade.api.measures import Tables, axes_of, cases_of, evaluate_single
from lvnav_trade.api.pages import Block, FigureEntry, Picture, StudyResult, StudySection, number, table, words

_UNITS = {"velocity": "m/s", "position": "m"}


# --- one flight ------------------------------------------------------------------------------------------------------


def flight_of(campaign: Campaign, chosen: Sequence[Levels], run: int) -> pd.DataFrame:
    """Return one run of two cases, aided and unaided, on the same draws: t_s, and for every axis of position (m) and
    velocity (m/s), in the reporting frame, QUANTITY_AXIS_true (error of the unaided system), _estimated (what the aided
    one takes off), _left.
    """
    left, true = (run_errors(campaign, case_with(campaign, levels), run) for levels in chosen)
    if not np.array_equal(left.t_s, true.t_s):
        raise InputError(f"study.yaml: {campaign.name}: the two cases of a single flight do not fly the same flight")
    found = {"t_s": left.t_s}
    for name in left.columns:
        if name.startswith(("velocity_", "position_")):
            found |= {
                f"{name}_true": true[name],
                f"{name}_estimated": true[name] - left[name],
                f"{name}_left": left[name],
            }
    return pd.DataFrame(found)


def single(found: pd.DataFrame) -> Figure:
    """Draw position and velocity axis by axis, the error and its estimate above each other, what is left below; the
    table of `flight_of`.
    """
    names = [name.removesuffix("_true") for name in found.columns if name.endswith("_true")]
    kinds = [kind for kind in ("position", "velocity") if any(name.startswith(kind) for name in names)]
    figure, grid = canvas(2 * len(kinds), 3, 1.35, sharex=True)
    for row, kind in enumerate(kinds):
        for column, name in enumerate(one for one in names if one.startswith(kind)):
            above, below = grid[2 * row : 2 * row + 2, column]
            above.plot(found.t_s, found[f"{name}_true"], color=PALETTE[1], label="error of the inertial system")
            above.plot(found.t_s, found[f"{name}_estimated"], color="black", ls="--", lw=1.0, label="estimated")
            below.plot(found.t_s, found[f"{name}_left"], color=PALETTE[0], lw=0.9, label="left in the aided output")
            below.axhline(0.0, color=GREY, lw=0.5)
            above.set(title=f"{kind}, {name.removeprefix(f'{kind}_')}", ylabel=_UNITS[kind])
            below.set(ylabel=f"left ({_UNITS[kind]})")
    for ax in grid[-1]:
        ax.set(xlabel="time since lift-off (s)")
    return figure


def draw_single(one: StudyResult, figure: FigureEntry) -> Figure:
    """Draw the flight of an entry of study.yaml: the aided case, then the unaided one; settings: run."""
    return single(flight_of(one.campaign, figure.cases, int(figure.settings.get("run", 0))))


def single_faults(figure: FigureEntry, question: StudySection) -> Iterator[tuple[str, str]]:
    """Yield that an entry does not name two cases."""
    if len(figure.cases) != 2:
        yield "cases", "single needs two cases: the aided one, then the unaided one"


# --- real missions --------------------------------------------------------------------------------------------------


def missions(tables: Tables, real_missions: Sequence[Mapping[str, Any]]) -> Figure | None:
    """Draw which part of our flights has an error below so much, a panel for every metric, and each real mission's own
    as a line; None without missions or runs. Items are named 'MISSION, WHAT'.
    """
    names = list(dict.fromkeys(str(one["item"]).partition(",")[0] for one in real_missions))
    panels = []
    for metric in dict.fromkeys(one["metric"] for one in real_missions):
        mine = [one for one in real_missions if one["metric"] == metric]
        case = next(iter(cases_of(tables, mine[0].get("case") or {}, axes_of(mine[0]))), None)
        found = np.empty(0) if case is None else evaluate_single(tables, case, mine[0], str(mine[0]["unit"])).runs
        if len(found) < 2:
            return None
        panels.append((metric, mine, np.sort(found[np.isfinite(found)])))
    if not panels:
        return None
    figure, grid = canvas(1, len(panels), 2.6, sharey=True)
    for ax, (metric, mine, found) in zip(grid[0], panels, strict=True):
        part = 100.0 * np.arange(1, len(found) + 1) / len(found)
        ax.step(found, part, color="black", lw=1.2, label=f"our {len(found)} flights")
        for one in mine:
            name = str(one["item"]).partition(",")[0]
            ax.axvline(float(one["value"]), lw=1.3, label=name, color=line_of(names.index(name))["color"])
        ax.axvline(float(np.sqrt(np.mean(found**2))), color=GREY, lw=4.0, alpha=0.5, label="our RMS")
        ax.set(
            xlim=(0.0, max(found[int(0.995 * (len(found) - 1))], 1.1 * max(float(one["value"]) for one in mine))),
            ylim=(0.0, 100.0),
            xlabel=f"|{metric.replace('_', ' ')}| ({mine[0]['unit']})",
        )
    grid[0, 0].set(ylabel="flights below (%)")
    widen_covered(figure)
    return figure


def missions_table(tables: Tables, real_missions: Sequence[Mapping[str, Any]]) -> list[Block]:
    """Return real missions in the layout of their publication, and where each lies among our flights."""
    published: dict[str, dict[str, str]] = {}
    compared: dict[str, dict[str, str]] = {}
    for one in real_missions:
        name, _, what = (part.strip() for part in str(one["item"]).partition(","))
        head, value = f"{what} ({one['unit']})", float(one["value"])
        case = next(iter(cases_of(tables, one.get("case") or {}, axes_of(one))), None)
        found = np.empty(0) if case is None else evaluate_single(tables, case, one, str(one["unit"])).runs
        below = f"{100 * float(np.mean(found < value)):.0f}" if len(found) else "–"
        row = published.setdefault(name, {"mission": name})
        row |= {head: number(value), f"ours below it, {what} (%)": below}
        if len(found):
            sizes = (np.sqrt(np.mean(found**2)), *np.quantile(found, [0.5, 0.95]))
            for label, size in zip(("ours, RMS", "ours, 50 %", "ours, 95 %"), sizes, strict=True):
                compared.setdefault(label, {"mission": label})[head] = number(size)
    rows = [*published.values(), *compared.values()]
    caption = "Flown missions (sizes of the published differences) and our flights."
    return [table(pd.DataFrame(rows).fillna("–"), caption)] if rows else []


# --- process noise ---------------------------------------------------------------------------------------------------


def noise_blocks(campaign: str, found: ProcessNoise, step: float) -> list[Block]:
    """Return the densities of an estimate over the whole flight and by phase, and the error per step; step: s."""
    every = [("whole flight", found.flight_densities), *((name, noise) for name, _, _, noise in found.phases)]
    rows = [(words(name), math.degrees(noise.attitude) * 60.0, noise.velocity, noise.position) for name, noise in every]
    frame = pd.DataFrame(
        rows, columns=["phase", "attitude (deg/sqrt(h))", "velocity (m/s/sqrt(s))", "position (m/sqrt(s))"]
    )
    caption = f"Error of the unaided system, and what the transition misses of it in steps of {step:g} s."
    drawn = steps_figure(found.steps, [phase[:3] for phase in found.phases])
    return [
        table(frame, f"Process noise of an ensemble, steps of {step:g} s."),
        Picture(f"{campaign}-steps-{step:g}", drawn, caption),
    ]
