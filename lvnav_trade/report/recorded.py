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


def page(filtered_log: FilteredLog, campaign: Campaign) -> tuple[str, str, list[Section]]:
    """Return title, introduction and sections of the report on a processed log."""
    blocks: list[Block] = [
        Text(filtered_log.card.source),
        Text(note("recorded", campaign=campaign.name, alignment=_alignment(filtered_log))),
    ]
    blocks += [Text(f"{remark}.") for remark in filtered_log.notes]
    blocks.append(table(filtered_log.summary, "Outages by case and length.", _COLUMNS))
    blocks += [Text(text) for text in _filter_remarks(filtered_log)]
    caption = note("outages_of_log", "figures")
    blocks.append(Picture("outages", outages_of_log(filtered_log.outages), caption))
    section = Section("outages", "Outages", blocks)
    return filtered_log.card.name, "Outages withheld from a recorded log", [section]


def _alignment(filtered_log: FilteredLog) -> str:
    """Return the description of the initial alignment."""
    alignment = filtered_log.alignment
    if filtered_log.card.heading is not None:
        heading_source = "stated"
    else:
        heading_source = f"from the motion, one sigma {np.degrees(alignment.heading_sigma):.2g} deg"
    rate = ", ".join(f"{value:.3g}" for value in np.degrees(alignment.gyro_bias))
    return (
        f"Heading at the end of the rest: {np.degrees(alignment.heading) % 360.0:.1f} deg "
        f"({heading_source}); removed from the rates: {rate} deg/s."
    )


def _filter_remarks(filtered_log: FilteredLog) -> Iterator[str]:
    """Yield a sentence for each case and length of outage in which the filter does not match its errors."""
    for row in filtered_log.summary.itertuples():
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
