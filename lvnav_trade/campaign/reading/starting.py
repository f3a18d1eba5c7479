"""A first campaign around a file of the user's own: a card of its columns, each guess a comment, and a question."""

import json
import math
import os
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from lvnav_trade.campaign.reading.exporting import refuse_existing, write_new
from lvnav_trade.errors import InputError, writing
from lvnav_trade.world.user_file import guesses, table
from lvnav_trade.world.user_file.columns import TableTrajectory

EPOCH = "2027-01-01T12:00:00Z"
_INJECTION = "injection"
_CAMPAIGN = """\
# A first campaign: change what does not fit; `lvnav-trade fields base` lists everything.
name: {name}
description: Which inertial unit brings our vehicle to {event}?
seed: 1
base:
  trajectory: trajectories/{name}
  imu: imu/tactical_fog
  constellation: constellations/gps_24      # `lvnav-trade cards` lists what comes with the tool
  receiver: receivers/l1_two_metre
  filter: filters/tight
  initial: {{tilt: 0.1 deg, heading: 0.05 deg, position: 1 m, velocity: 0.01 m/s}}   # what alignment leaves, assumed
axes:
  - {{path: imu, cards: [imu/tactical_mems, imu/tactical_fog, imu/navigation]}}
monte_carlo: {{runs: 100}}
requirements:                               # limits are placeholders: put yours
  - {{name: velocity, metric: velocity_error_3d, at: {event}, probability: 0.95, below: 0.3 m/s, confidence: 0.9}}
  - {{name: attitude, metric: attitude_error_3d, at: {event}, probability: 0.95, below: 2 mrad, confidence: 0.9}}
"""


class Started(NamedTuple):
    """What was written, what was guessed of the columns, and the events (name: time) that jumps of force suggest."""

    campaign: Path
    card: Path
    guesses: tuple[guesses.Guess, ...]
    events: dict[str, str]


def start(folder: Path, file: Path, epoch: str | None = None) -> Started:
    """Write ``NAME.yaml`` and ``configs/trajectories/NAME.yaml`` into a folder, NAME after the file of the rows.

    epoch: of lift-off, UTC; without one it is assumed. InputError where one of the two exists, or the file does not
    hold time and position.
    """
    name = "".join(letter if letter.isalnum() else "_" for letter in file.stem).lower()
    campaign, card = folder / f"{name}.yaml", folder / "configs" / "trajectories" / f"{name}.yaml"
    refuse_existing(campaign, card)
    if not file.is_file():
        raise InputError(f"{file}: no such file")
    found = guesses.guess(str(file))
    stated = {"name": name, "source": "-", "epoch": epoch or EPOCH, "file": os.fspath(file.resolve())}
    stated |= {one.part: one.content for one in found if one.part != "attitude"}
    known = TableTrajectory.model_validate(stated)
    events = _ending(table.suggested(known))
    found = [one for guess in found for one in _that_fits(guess, stated | {"events": events})]
    hold = "60 s" if table.at_rest(known) else "0 s"
    with writing(folder, "the campaign cannot be written there"):
        card.parent.mkdir(parents=True, exist_ok=True)
        place = Path(os.path.relpath(file.resolve(), card.parent.resolve())).as_posix()
        write_new(card, _card(name, place, epoch, found, events, hold))
        write_new(campaign, _CAMPAIGN.format(name=name, event=_INJECTION if _INJECTION in events else "end"))
    return Started(campaign, card, tuple(found), events)


def _that_fits(guess: guesses.Guess, stated: dict[str, Any]) -> list[guesses.Guess]:
    """Return a guess; of an attitude the reading in which the body's x axis lies nearest to the forces, or none."""
    if guess.part != "attitude":
        return [guess]
    fitting: list[tuple[float, dict[str, Any]]] = []
    for content in guesses.readings(guess.content):
        with suppress(InputError):
            flight = table.from_table(TableTrajectory.model_validate(stated | {"attitude": content}))
            fitting.append((float(flight.facts["force_off_roll_axis_median_rad"]), content))
    if not fitting:
        return []
    angle, content = min(fitting, key=lambda one: one[0])
    why = f"so the x axis lies {math.degrees(angle):.1f} deg off the forces; frame eci hinges on the epoch"
    return [guess._replace(content=content, why=why)]


def _ending(events: dict[str, str]) -> dict[str, str]:
    """Return the events, the last one named injection where it is the end of a burn."""
    names = list(events)
    if names and names[-1].endswith("_cutoff"):
        names[-1] = _INJECTION
    return dict(zip(names, events.values(), strict=True))


def _card(
    name: str, place: str, epoch: str | None, found: list[guesses.Guess], events: dict[str, str], hold: str
) -> str:
    """Return the card as text: a line a part, why it was guessed behind it."""
    lines = [
        "# Guessed from the columns of the file: confirm every line, then delete its comment.",
        "kind: table",
        f"name: {name}",
        f"source: {json.dumps('the rows of ' + Path(place).name)}",
        f"epoch: {json.dumps(epoch or EPOCH)}" + "   # of lift-off: assumed" * (epoch is None),
        f"file: {json.dumps(place)}",
        *(f"{one.part}: {json.dumps(one.content, ensure_ascii=False)}   # {one.why}" for one in found),
        *["# attitude: along the specific force, as no columns of the file fit that"]
        * all(one.part != "attitude" for one in found),
        "events:" + "   # where the specific force jumps, named by what it does" if events else "events: {}",
        *(f"  {event}: {time}" for event, time in events.items()),
        f"pad_hold: {hold}   # the first row {'rests' if hold != '0 s' else 'moves'}",
    ]
    return "\n".join(lines) + "\n"
