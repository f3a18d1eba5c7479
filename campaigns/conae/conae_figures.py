"""The receiver's clock in one flight with each solution of it, and the gain of its antennas."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from lvnav_trade.api.figures import PALETTE, Figure, canvas
from lvnav_trade.api.flights import Case, case_with, gain, gains, receiver_clock, run_errors
from lvnav_trade.api.input import Campaign, InputError, Levels
from lvnav_trade.api.pages import FigureEntry, StudyResult, StudySection


def clocks_of(campaign: Campaign, chosen: Sequence[Levels], run: int) -> pd.DataFrame:
    """Return one run of cases on the same draws: t_s of the epochs, bias_m and drift_m_per_s of the receiver's clock,
    and bias_m CASE and drift_m_per_s CASE as its own solution has them; InputError where a case reports none.
    """
    found: dict[str, pd.Series] = {}
    for levels in chosen:
        case = case_with(campaign, levels)
        errors = run_errors(campaign, case, run)
        names = {"bias_m": "receiver_clock_bias", "drift_m_per_s": "receiver_clock_drift"}
        reported = {name: [one for one in errors.columns if one.startswith(begin)] for name, begin in names.items()}
        if not all(reported.values()):
            raise InputError(f"study.yaml: {campaign.name}: {case.label} reports no solution of the receiver's own")
        clock = receiver_clock(campaign, case, run)
        errors = errors[errors.t_s.isin(clock.t_s)].reset_index(drop=True)
        found |= {name: clock[name] for name in clock.columns}
        for name, (column, *_) in reported.items():
            found[f"{name} {case.label}"] = clock[name] - errors[column]
    return pd.DataFrame(found)


def clocks(found: pd.DataFrame) -> Figure:
    """Draw bias and drift of the receiver's clock, and each solution of them; the table of `clocks_of`."""
    figure, grid = canvas(2, 1, 1.9, sharex=True)
    for ax, name, label in zip(grid[:, 0], ("bias_m", "drift_m_per_s"), ("bias (m)", "drift (m/s)"), strict=True):
        solved = [column for column in found.columns if column.startswith(f"{name} ")]
        for k, column in enumerate(solved):
            ax.plot(found.t_s, found[column], color=PALETTE[k], lw=1.2, label=column.removeprefix(f"{name} "))
        ax.plot(found.t_s, found[name], color="black", lw=0.9, ls="--", label="true")
        ax.set(ylabel=label)
    grid[-1, 0].set(xlabel="time since lift-off (s)")
    return figure


def draw_clocks(one: StudyResult, figure: FigureEntry) -> Figure:
    """Draw the clocks of an entry of study.yaml: the cases whose receivers solve for themselves; settings: run."""
    return clocks(clocks_of(one.campaign, figure.cases, int(figure.settings.get("run", 0))))


def clocks_faults(figure: FigureEntry, question: StudySection) -> Iterator[tuple[str, str]]:
    """Yield that an entry names no case."""
    if not figure.cases:
        yield "cases", "clocks needs one case or more"


def antennas_of(case: Case) -> pd.DataFrame:
    """Return the gain (dBi) of a receiver's antennas, -inf where nothing is heard: angle_deg, off_boresight (of the
    first antenna, by the angle to its axis), and each antenna across the body axis, by the angle from y to z.
    """
    cards = case.scenario.receiver.antennas
    if not cards:
        raise InputError(f"study.yaml: {case.label}: the receiver has no antennas, and hears all directions alike")
    angle = np.radians(np.arange(361.0))
    across = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=-1)
    heard = gains(cards, across)
    found = {"angle_deg": np.degrees(angle), "off_boresight": gain(cards[0], np.minimum(angle, 2.0 * math.pi - angle))}
    return pd.DataFrame(found | {card.name: heard[:, k] for k, card in enumerate(cards)})


def antennas(found: pd.DataFrame) -> Figure:
    """Draw the gain of an antenna off its boresight, and of all across the body axis, the table of `antennas_of`."""
    figure, grid = canvas(2, 1, 1.9)
    first, all_round = grid[:, 0]
    half = found[found.angle_deg <= 180.0]
    first.plot(half.angle_deg, half.off_boresight.where(np.isfinite(half.off_boresight)), color=PALETTE[0])
    first.set(ylabel="gain (dBi)", xlabel="angle off the boresight of one antenna (deg)")
    for k, name in enumerate(found.columns[2:]):
        heard = found[name].where(np.isfinite(found[name]))
        all_round.plot(found.angle_deg, heard, color=PALETTE[k], label=name)
    all_round.set(ylabel="gain (dBi)", xlabel="direction across the body axis, from y to z (deg)")
    return figure


def draw_antennas(one: StudyResult, figure: FigureEntry) -> Figure:
    """Draw the antennas of the case of an entry of study.yaml."""
    return antennas(antennas_of(case_with(one.campaign, figure.case)))
