"""Commands that compute numbers of a filter card: estimate-q, schedule-gains."""

import math
from pathlib import Path
from typing import Annotated, Literal

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import Answer, CampaignFile, Sets, verb

CaseOf = Annotated[
    str | None, typer.Option("--case", metavar="CASE", help="digest of a case, its beginning, or its label [the first]")
]
Card = Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="card to write")]


@verb()
def estimate_q(
    campaign: CampaignFile,
    out: Card,
    sets: Sets = None,
    case: CaseOf = None,
    runs: Annotated[int, typer.Option("--runs", help="perturbed runs of the ensemble")] = 100,
    step: Annotated[
        float | None, typer.Option("--step", metavar="SECONDS", help="length of a step [time between updates]")
    ] = None,
) -> Answer:
    """Estimate process noise from runs; write a filter card.

    The runs are perturbed as the unit's errors say. Beside the card: the error per step as CSV and PNG.
    """
    from lvnav_trade import api

    found, (card, *files) = api.estimate_q(campaign, out, sets or (), case, runs, step)
    noises = {"whole flight": found.whole, **{name: noise for name, _, _, noise in found.phases}}
    beyond = found.whole._replace(attitude=found.card.attitude_noise, velocity=found.card.velocity_noise)
    rows = [_row(name, noise) for name, noise in noises.items()]
    rows.append([*_row("the card: whole flight beyond the unit's own", beyond)[:3], "-"])
    head = ["phase", "attitude (deg/sqrt(h))", "velocity (m/s/sqrt(s))", "position (m/sqrt(s))"]
    text = f"{table(head, rows)}\ncard: {card}\nerror per step: {files[0]}, {files[1]}"
    densities = {name: noise._asdict() for name, noise in noises.items()}
    return Answer(text, {"card": str(card), "files": [*map(str, files)], "densities_si": densities})


def _row(name: str, noise: object) -> list[str]:
    attitude, velocity, position = (getattr(noise, part) for part in ("attitude", "velocity", "position"))
    return [name, f"{math.degrees(attitude) * 60.0:.3g}", f"{velocity:.3g}", f"{position:.3g}"]


@verb()
def schedule_gains(
    campaign: CampaignFile,
    out: Card,
    sets: Sets = None,
    case: CaseOf = None,
    by: Annotated[
        Literal["event", "time"], typer.Option("--by", help="what the gains are counted from in flight")
    ] = "event",
    tolerance: Annotated[
        float, typer.Option("--tolerance", help="between knots, as a share of each gain's largest size")
    ] = 0.02,
) -> Answer:
    """Write a filter's gains on the nominal trajectory as a card.

    Another filter replays them: filter.gains.
    """
    from lvnav_trade import api

    found = api.schedule_gains(campaign, out, sets or (), case, by, tolerance)
    rows = [(segment.event, len(segment.knots)) for segment in found.segments]
    text = f"{table(['from', 'knots'], rows)}\nstates: {', '.join(found.states)}\ncard: {out}"
    return Answer(text, {"card": str(out), "states": list(found.states), "knots": dict(rows)})
