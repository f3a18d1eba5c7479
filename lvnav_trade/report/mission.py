"""The sections on the mission: orbit at injection and its correction, point of impact and corridor."""

import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.report.blocks import Block, Text, number, words
from lvnav_trade.report.escape import note
from lvnav_trade.report.sections import chosen_cases, figure, left_out, of, stated
from lvnav_trade.store import Tables


@of("orbit", "No case ends in an orbit that clears the ground.")
def orbit(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the orbit at the final event with the errors of its estimate, and the correction."""
    blocks: list[Block] = [Text(note("orbit")), *left_out(tables)]
    for case, label in chosen_cases(tables).items():
        mine = frame[frame.case == label]
        if mine.empty:
            blocks.append(Text(f"{label}: the flight does not end in an orbit."))
            continue
        for event, rows in mine.groupby("event", sort=False):
            known = rows if rows.runs.max() > 0 else rows.drop(columns=["mc_sigma", "mc_bias", "mc_q99"])
            blocks.append(stated("orbit", known, label=label, event=words(event)))
            blocks += [Text(f"{why}.", "Not applicable.") for why in dict.fromkeys(rows.remark) if why]
        blocks.append(figure(tables, "orbit", case, caption=f"{label}: errors of the orbit."))
    return [*blocks, Text(note("correction")), stated("correction", METRICS["correction"](tables))]


@of("impact", "No stored state of any case has a point of impact.")
def impact(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the points of impact with their ellipses, and the verdict on the corridor."""
    blocks: list[Block] = [Text(note("impact")), *_corridor(tables), *left_out(tables)]
    for case, label in chosen_cases(tables).items():
        rows = frame[(frame.case == label) & (frame.event != "")]
        if len(rows):
            axes = rows.major_3sigma_km.map(number) + " x " + rows.minor_3sigma_km.map(number)
            known = (
                rows if rows.runs.max() > 1 else rows.drop(columns=[name for name in rows if name.startswith("mc_")])
            )
            blocks.append(stated("impact", known.assign(axes=axes), label=label))
        if (frame.case == label).any():
            caption = f"{label}: trace of the point of impact, its error over time, and that at the last event."
            blocks.append(figure(tables, "impact", case, caption=caption))
    return blocks


@of("corridor")
def _corridor(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    frame = frame.assign(least=100.0 * frame.expected_probability, remark=frame.reason.fillna(""))
    return [Text(note("corridor")), stated("corridor", frame)]
