"""Report on a recorded log: errors of a campaign's filters during simulated outages."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.recorded_log import FilteredLog
from lvnav_trade.report.blocks import Block, Picture, Section, Text, table
from lvnav_trade.report.escape import note
from lvnav_trade.report.figures.vehicle_motion import outages_of_log

INSIDE = 95.0
"""Percent of outages that should end within three sigma."""
LEAST_NEES = 0.3
"""Mean NEES below which a filter is too conservative."""
_COLUMNS = (
    "case | withheld (s) = length_s: number | outages | failed | inside 3 sigma (%) = inside_percent: number | "
    "NEES = nees_ratio: number | position RMS (m) = position_rms_m: number | worst (m) = position_worst_m: number | "
    "velocity RMS (m/s) = velocity_rms_m_per_s: number"
)


def page(done: FilteredLog, campaign: Campaign) -> tuple[str, str, list[Section]]:
    """Return title, introduction and sections of the report on a processed log."""
    blocks: list[Block] = [
        Text(done.card.source),
        Text(note("recorded", campaign=campaign.name, alignment=_alignment(done))),
    ]
    blocks += [Text(f"{remark}.") for remark in done.notes]
    blocks.append(table(done.summary, "Outages by case and length.", _COLUMNS))
    blocks += [Text(text) for text in _filter_remarks(done)]
    caption = note("outages_of_log", "figures")
    blocks.append(Picture("outages", outages_of_log(done.outages), caption))
    section = Section("outages", "Outages", blocks)
    return done.card.name, "Outages withheld from a recorded log", [section]


def _alignment(done: FilteredLog) -> str:
    """Return the description of the initial alignment."""
    alignment = done.alignment
    if done.card.heading is not None:
        heading_source = "stated"
    else:
        heading_source = f"from the motion, one sigma {np.degrees(alignment.heading_sigma):.2g} deg"
    rate = ", ".join(f"{value:.3g}" for value in np.degrees(alignment.gyro_bias))
    return (
        f"Heading at the end of the rest: {np.degrees(alignment.heading) % 360.0:.1f} deg "
        f"({heading_source}); removed from the rates: {rate} deg/s."
    )


def _filter_remarks(done: FilteredLog) -> Iterator[str]:
    """Yield a sentence for each case and length of outage in which the filter does not match its errors."""
    for row in done.summary.itertuples():
        remark = _filter_remark(row)
        if remark:
            yield f"{row.case}, {row.length_s:g} s: {remark}."


def _filter_remark(row: Any) -> str:
    """Return by how much a filter assumes too little or too much error; empty if it is consistent."""
    if row.failed:
        return ""  # explained in the notes: a failed run gives no evidence on the filter
    if row.inside_percent < INSIDE:
        return f"{row.inside_percent:.0f} % inside three sigma, fewer than {INSIDE:g} %: the filter assumes too little"
    if row.nees_ratio < LEAST_NEES:
        return f"a mean NEES of {row.nees_ratio:.2f}, below {LEAST_NEES:g}: the filter assumes more error than there is"
    return ""
