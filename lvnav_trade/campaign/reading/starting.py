"""A first campaign for the user's trajectory file, with guesses as comments; export of a trajectory as such a file."""

import json
import math
import os
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.card_lookup import Shelf
from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.trajectory.export import difference, export_trajectory
from lvnav_trade.trajectory.files import guesses, table_flight
from lvnav_trade.trajectory.files.columns import TableTrajectory
from lvnav_trade.trajectory.files.first_rows import axes_remark, interpretations, rest_end
from lvnav_trade.trajectory.files.rows import read_rows, row_pair_times, si_factor
from lvnav_trade.trajectory.flight import TrajectoryCard, build


class WrittenTrajectory(NamedTuple):
    """An exported trajectory."""

    file: Path  # table, CSV
    card: Path  # card that names the table
    events: dict[str, float]  # times of the events, s
    difference: dict[str, float]  # largest differences of the trajectory read from the file, SI


def write_flight(card: TrajectoryCard, file: Path, rate: float) -> WrittenTrajectory:
    """Write a trajectory as a CSV table and its card next to it, then read the table and compare.

    Parameters
    ----------
    card : TrajectoryCard
        The trajectory.
    file : Path
        CSV file to write.
    rate : float
        Rows per second (Hz).

    Returns
    -------
    WrittenTrajectory
        Files, events, largest differences.

    Raises
    ------
    InputError
        One of the two files exists or cannot be written, or the trajectory is invalid.
    """
    card_file = file.with_suffix(".yaml")
    if file.suffix.lower() in (".yaml", ".yml", ".parquet", ".pq"):
        raise InputError(
            f"{file}: the rows are written as CSV, and the card next to them as {card_file.name}; end it in .csv"
        )
    refuse_existing(file, card_file)
    export = export_trajectory(card, file.name, file.stem, rate)
    with writing(file, "the trajectory cannot be written there"):
        write_new(file, export.text)
        write_new(card_file, tree.dump(export.card))
    # a superposed oscillation is not exported, so the comparison is made without it
    card_fields = export.card | {"file": os.fspath(file), "oscillation": (), "named_times": {}}
    file_trajectory = build(TableTrajectory.model_validate(card_fields))
    events = {name: time for name, time in file_trajectory.events.items() if name in export.card["events"]}
    return WrittenTrajectory(file, card_file, events, difference(export.flight, file_trajectory))


def refuse_existing(*files: Path) -> None:
    """Raise an InputError if one of the files exists."""
    for file in files:
        if os.path.lexists(file):
            raise InputError(f"{file}: exists already; nothing was written: move it, or give another name")


def write_new(file: Path, text: str) -> None:
    """Write a new file; FileExistsError if it exists."""
    with file.open("x", encoding="utf-8", newline="\n") as stream:
        stream.write(text)


def is_card(name: str, folder: Path) -> bool:
    """Whether a name refers to a trajectory card: its file has a `kind`, which no campaign has."""
    file = Shelf.from_folder(folder).find(name, folder)
    return file is not None and "kind" in tree.read_mapping(file).value


EPOCH = "2027-01-01T12:00:00Z"
_INJECTION = "injection"
_LIFTOFF_TOLERANCE = 1.0  # s; a lift-off closer to zero is not written
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
  - {{path: filter, cards: [filters/tight, filters/tight_extended]}}   # extended: scale factors are states
monte_carlo: {{runs: 100}}
requirements:                               # limits are placeholders: put yours
  - {{name: velocity, metric: velocity_error_3d, at: {event}, probability: 0.95, below: 0.3 m/s, confidence: 0.9}}
  - {{name: attitude, metric: attitude_error_3d, at: {event}, probability: 0.95, below: 2 mrad, confidence: 0.9}}
"""


class FirstCampaign(NamedTuple):
    """A first campaign."""

    campaign: Path  # campaign file
    card: Path  # trajectory card
    guesses: tuple[guesses.Guess, ...]  # guessed meaning of the columns
    events: dict[str, str]  # times by name, suggested by jumps of the specific force


def start(folder: Path, file: Path, epoch: str | None = None, time: str | None = None) -> FirstCampaign:
    """Write ``NAME.yaml`` and ``configs/trajectories/NAME.yaml`` into a folder, with the name of the table.

    Parameters
    ----------
    folder : Path
        Folder of the new campaign.
    file : Path
        Table of the trajectory.
    epoch : str, optional
        Time of lift-off, UTC; assumed if absent.
    time : str, optional
        Title of the time column; guessed if absent.

    Returns
    -------
    FirstCampaign
        Files, guesses, events.

    Raises
    ------
    InputError
        One of the two files exists, or the table has no time or position.
    """
    name = "".join(letter if letter.isalnum() else "_" for letter in file.stem).lower()
    campaign = folder / f"{name}.yaml"
    card = folder / "configs" / "trajectories" / f"{name}.yaml"
    refuse_existing(campaign, card)
    if not file.is_file():
        raise InputError(f"{file}: no such file")
    settings = {"name": name, "source": "-", "epoch": epoch or EPOCH, "file": os.fspath(file.resolve())}
    column_guesses = guesses.guess(str(file), time)
    settings |= _contents(column_guesses)
    table = _paired_table(settings)
    column_guesses = _with_liftoff(column_guesses, table)
    clock = None if epoch else guesses.guess_epoch(str(file), column_guesses, EPOCH)
    if clock is not None:
        settings["epoch"] = clock[0]
        table = _paired_table(settings)
    column_guesses = [_with_axes(guess, table) for guess in column_guesses]
    settings |= _contents(column_guesses)
    table = _paired_table(settings)
    events = _with_injection(table_flight.suggest_file_events(table))
    column_guesses = _with_attitude(column_guesses, settings | {"events": events})
    guessed_epoch = clock or (EPOCH, "assumed")
    epoch_and_reason = (epoch, "") if epoch else guessed_epoch
    hold = "60 s" if table_flight.is_at_rest(table) else "0 s"
    with writing(folder, "the campaign cannot be written there"):
        card.parent.mkdir(parents=True, exist_ok=True)
        relative_path = os.path.relpath(file.resolve(), card.parent.resolve())
        place = Path(relative_path).as_posix()
        unused_columns = guesses.unused_columns(str(file), column_guesses)
        card_text = _card(name, place, epoch_and_reason, column_guesses, unused_columns, events, hold)
        write_new(card, card_text)
        event = _INJECTION if _INJECTION in events else "end"
        campaign_text = _CAMPAIGN.format(name=name, event=event)
        write_new(campaign, campaign_text)
    return FirstCampaign(campaign, card, tuple(column_guesses), events)


def _contents(column_guesses: list[guesses.Guess]) -> dict[str, Any]:
    """Return the guessed settings, without the attitude, which needs the events too."""
    return {guess.field: guess.content for guess in column_guesses if guess.field != "attitude"}


def _paired_table(settings: dict[str, Any]) -> TableTrajectory:
    """Return the card of the settings, with an event at each time for which the table has two rows."""
    table = TableTrajectory.model_validate(settings)
    times = row_pair_times(table)
    events = {f"pair_{number}": f"{time!r} s" for number, time in enumerate(times)}
    return TableTrajectory.model_validate(settings | {"events": events})


def _with_liftoff(column_guesses: list[guesses.Guess], card: TableTrajectory) -> list[guesses.Guess]:
    """Return the guesses with the value of the time column at lift-off, unless it is zero."""
    rows = read_rows(card)
    end_of_rest = rest_end(rows)
    t_liftoff = float(rows.t[0]) if end_of_rest is None else end_of_rest
    time = next(guess for guess in column_guesses if guess.field == "time")
    is_duration = end_of_rest is None and not guesses.is_clock(time.content["column"])
    if abs(t_liftoff) <= _LIFTOFF_TOLERANCE or is_duration:
        return column_guesses
    liftoff_number = t_liftoff / si_factor(card.time.unit, "s")
    reason = "the first row, assumed" if end_of_rest is None else "the vehicle rests until then"
    liftoff = float(f"{liftoff_number:.12g}")
    time_with_liftoff = time._replace(
        content=time.content | {"liftoff": liftoff},
        reason=f"{time.reason}; lift-off: {reason}",
    )
    return [time_with_liftoff if guess is time else guess for guess in column_guesses]


def _with_axes(guess: guesses.Guess, card: TableTrajectory) -> guesses.Guess:
    """Return a guess of inertial axes (of date or J2000) corrected so that the vehicle rests in the first row."""
    if guess.field not in ("position", "velocity") or guess.content["frame"] != "eci":
        return guess
    if not axes_remark(card, read_rows(card)):
        return guess
    content = guess.content | {"frame": "j2000"}
    return guess._replace(content=content, reason=f"{guess.reason}; the first row rests in J2000")


def _with_attitude(column_guesses: list[guesses.Guess], settings: dict[str, Any]) -> list[guesses.Guess]:
    """Return the guesses with the best interpretation of attitude columns, or without attitude if none is valid.

    The best interpretation is that in which the body x axis is closest to the specific force, because a launch
    vehicle thrusts along its x axis.
    """
    complete_guesses = []
    for guess in column_guesses:
        if guess.field != "attitude":
            complete_guesses.append(guess)
            continue
        candidates: list[tuple[float, dict[str, Any]]] = []
        for content in interpretations(guess.content):
            with suppress(InputError):
                table = TableTrajectory.model_validate(settings | {"attitude": content})
                flight = table_flight.build_table_flight(table)
                angle = float(flight.facts["force_off_roll_axis_median_rad"])
                candidates.append((angle, content))
        if candidates:
            angle, content = min(candidates, key=lambda entry: entry[0])
            reason = f"so the x axis lies {math.degrees(angle):.1f} deg off the forces; frame eci hinges on the epoch"
            complete_guesses.append(guess._replace(content=content, reason=reason))
    return complete_guesses


def _with_injection(events: dict[str, str]) -> dict[str, str]:
    """Return the events; if the last one is the end of a burn, it is named injection."""
    names = list(events)
    if names and names[-1].endswith("_cutoff"):
        names[-1] = _INJECTION
    return dict(zip(names, events.values(), strict=True))


def _card(
    name: str,
    place: str,
    epoch_and_reason: tuple[str, str],
    column_guesses: list[guesses.Guess],
    unused_columns: list[str],
    events: dict[str, str],
    hold: str,
) -> str:
    """Return the card as text, one line per field with the reason of the guess as a comment.

    Parameters
    ----------
    name : str
        Name of the trajectory.
    place : str
        Path of the file, as written in the card.
    epoch_and_reason : (str, str)
        Epoch of lift-off, and the reason of the guess; the reason is empty if the user gave the epoch.
    column_guesses : list of guesses.Guess
        Guesses of the other fields.
    unused_columns : list of str
        Columns of the file that the card does not use.
    events : dict of str to str
        Time of each event, with its unit.
    hold : str
        Time at rest before lift-off, with its unit.
    """
    epoch, reason = epoch_and_reason
    source = f"the rows of {Path(place).name}"
    lines = [
        "# Guessed from the columns of the file: confirm every line, then delete its comment.",
        "kind: table",
        f"name: {name}",
        f"source: {json.dumps(source)}",
        f"epoch: {json.dumps(epoch)}" + (f"   # of lift-off: {reason}" if reason else ""),
        f"file: {json.dumps(place)}",
    ]
    lines += [
        f"{guess.field}: {json.dumps(guess.content, ensure_ascii=False)}   # {guess.reason}" for guess in column_guesses
    ]
    if all(guess.field != "attitude" for guess in column_guesses):
        lines.append("# attitude: along the specific force, as no columns of the file fit that")
    if unused_columns:
        lines.append(f"# left out: {json.dumps(unused_columns, ensure_ascii=False)}")
    if events:
        lines.append("events:   # where the specific force jumps, or two rows have one time")
        lines += [f"  {event}: {time}" for event, time in events.items()]
    else:
        lines.append("events: {}")
    state = "moves" if hold == "0 s" else "rests"
    lines.append(f"pad_hold: {hold}   # the first row {state}")
    return "\n".join(lines) + "\n"
