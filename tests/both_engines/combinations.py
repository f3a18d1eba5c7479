"""The combination matrix: a pairwise covering design over measurements and policies, each case flown by both engines.

`python -m tests.both_engines.combinations` runs every case and writes reports/combinations/; with numbers, those cases.
"""

from __future__ import annotations

import csv
import functools
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError
from scipy.stats import chi2

from lvnav_trade.covariance.diagnostics.case_diagnostics import flight_events
from lvnav_trade.covariance.history import covariance, forward_tape
from lvnav_trade.filter.policies.stored_gains import GainHistory, build_gain_schedule
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import CovHistory, Floats
from lvnav_trade.quantities.state_layout import state_names
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from tests.both_engines.covering import (
    DIFFERENCES,
    DIMENSIONS,
    FURTHER,
    OBSERVABLES,
    ON_PAD,
    PHASES,
    SENSORS,
    Case,
    covering,
    fields_of,
    kernels_of,
    lateness,
    refusal,
)
from tests.both_engines.short_flights import FROM_PAD, STEADY, flight
from tests.building import loaded, prepare_hop, with_fields, with_units

RUNS, SEED = 64, 20261122
TIMES = (15.0, 30.0, 45.0, 60.0)
LEVEL = 1e-3
MOST_FALSE_ALARMS = 0.05  # of the runs
"""Probability that a case which agrees is called out, over all of its comparisons."""

BASE = (
    "base.imu=imu/tactical_fog_matched", "base.receiver=receivers/l1_two_metre", "base.initial.tilt=0.2 deg",
    "base.initial.heading=0.2 deg", "base.initial.position=5 m", "base.initial.velocity=0.1 m/s",
    "base.receiver.lever_b=[1 m, 0.5 m, -0.3 m]",
)  # fmt: skip
AIR = (
    "base.atmosphere={troposphere: {kind: saastamoinen}, troposphere_scale: 5 percent, ionosphere: {kind: epstein}, "
    "ionosphere_scale: 30 percent}",
    "base.filter.corrections={troposphere: {kind: matched}, ionosphere: {kind: matched}}",
)
"""Delays of which corrections leave a part, where a filter does something about it."""


def scenario_of(case: Case) -> tuple[Scenario, str, bool]:
    """Return the scenario of a case, its flight, and whether its gains are stored; ValidationError with the reason."""
    fields = fields_of(case)
    kind, stored = fields.pop("flight", "steady"), fields.pop("gains", False)
    units, sky = fields.pop("units", None), fields.pop("constellation", None)
    listed = fields["filter.measurements"]
    if case["fault"] == "frozen output" and {"position", *OBSERVABLES} & set(listed):
        # the output of eight kilometres ago is beyond a linear model: a filter has to check the flag
        fields.setdefault("filter.logic", {"start_after": 1})
    spun = (case["vehicle"], case["strapdown"]) == ("spinning", "summed, half rate")
    if spun and case["integrity"] != "none" and "imu" not in listed:
        # the error of this strapdown on a spinning vehicle is near the limits of the tests
        fields["filter.strapdown"] = {"algorithm": "summed"}
    if case["integrity"] != "none":
        # what is near the limit of a test is found in some runs only, which one covariance cannot show
        fields |= _BELOW_LIMITS.get(case["fault"], {})
        if "receiver.solution" in fields and case["ranges"] == "two frequencies":
            # nor is what a solver reports that takes the noise of one frequency for that of two
            fields["receiver.solution"] = fields["receiver.solution"] | {"range_sigma": "6 m", "rate_sigma": "0.4 m/s"}
    of_phases = bool(FURTHER & set(listed))
    if (case["vehicle"], case["latency"]) == ("spinning", "extrapolated"):
        # a solution of a swinging antenna, extrapolated by its velocity, turns the roll by 10 deg: not linear either
        fields["receiver.lever_b"] = ["1 m", "0 m", "0 m"]
    if (case["start"], case["latency"]) == ("from GNSS", "extrapolated"):
        # a start from a solution of 0.3 s ago is 120 m off, which turns the attitude by 15 mrad: not linear either
        # nor is it extrapolated: tests for faults find that, and stored gains do not recover it
        fields["receiver.latency"] = "0.1 s" if case["integrity"] == "none" else "0.1 ms"
    if (case["receiver"], case["latency"], "position" in listed) == ("filtered", "buffered, 1.4 s", True):
        # a receiver's filter that begins with measurements of before the flight is 460 m off: not linear either
        fields["receiver.latency"] = "1.1 s"
    if case["correction"] == "open" and (of_phases or case["strapdown"].startswith("4 Hz")):
        # carrier phases, or four solutions a second, see the second order of 0.2 deg in a state that is never corrected
        fields |= {"initial.tilt": "0.02 deg", "initial.heading": "0.02 deg"}
    if of_phases and stored and case["fault"] == "range bias" and case["integrity"] == "none":
        # nothing rejects a step of 60 m with stored gains, and what it leaves grows with its square
        fields["faults"] = [{"kind": "range_bias", "size": "6 m", "start": "20 s", "duration": "20 s"}]
    if of_phases and case["latency"] != "none":
        # and what the gain of now, in place of that of then, leaves of the state: half a metre does not
        fields["receiver.carrier_phase_sigma"] = "0.5 m"
    if "imu" in listed and case["states"] in ("scale factors", "nonlinear"):
        kind += STEADY  # at a step the estimated acceleration, which scale factors are multiplied with, is wrong
    if set(listed) & set(ON_PAD):
        kind = FROM_PAD + kind
    found = SENSORS | {name: {"kind": name} for name in DIFFERENCES}
    found |= {name: {"name": name, "source": "test"} | card for name, card in ON_PAD.items()}
    delays = lateness(case)
    fields["sensors"] = {
        name: card | (delays if name in SENSORS else {}) for name, card in found.items() if name in listed
    }
    if fields.pop("sensor states", False):
        fields["filter.extra_states"] = [state for name in listed for state in _STATES.get(name, ())]
    if "zero_rotation" in listed:
        fields["filter.extra_states"] = ["standing_attitude", *fields.get("filter.extra_states", [])]
    air = AIR if case["residual delay"] != "none" and {"filter.as_noise", "filter.extra_states"} & set(fields) else ()
    of_unit = {path: value for path, value in fields.items() if path.startswith("imu.")}
    scenario = _base(*BASE, *air, *([f"base.constellation={sky}"] if sky else []))
    if of_unit:
        scenario = with_fields(scenario, **of_unit)
    if units is not None:
        scenario = with_units(scenario, units)
    return with_fields(scenario, **{path: fields[path] for path in fields if path not in of_unit}), kind, stored


_base = functools.cache(loaded)

_BELOW_LIMITS: dict[str, dict[str, Any]] = {
    "noise": {"faults": [{"kind": "degraded_noise", "factor": 1.3, "start": "20 s", "duration": "20 s"}]},
    "gyro bias step": {"faults": [{"kind": "gyro_bias_step", "size": ["5 deg/h", "0 deg/h", "0 deg/h"],
                                   "start": "20 s", "duration": "15 s"}]},
}  # fmt: skip

_STATES = {
    "altitude": ["altitude_bias"],
    "stellar_attitude": ["tracker_misalignment", "tracker_low_frequency"],
    "magnetic_field": ["hard_iron"],
}


class Verdict(NamedTuple):
    """Result of a case.

    refused : Reason of a refusal.
    low, high : Lowest and highest ratio of RMS to linear covariance.
    bounds : Bounds of the ratios.
    worst : Output and time of the ratio farthest from 1.
    false_alarms : Number of runs that are left out because of a false alarm.
    seconds : Time that the case took.
    """

    refused: str = ""
    low: float = 0.0
    high: float = 0.0
    bounds: tuple[float, float] = (0.0, 0.0)
    worst: str = ""
    false_alarms: int = 0
    seconds: float = 0.0

    @property
    def agrees(self) -> bool:
        """Whether both engines agree."""
        return not self.refused and self.bounds[0] < self.low and self.high < self.bounds[1]


def evaluate(case: Case, runs: int = RUNS) -> Verdict:
    """Run a case with both engines, or say why it is refused."""
    start = time.perf_counter()
    try:
        scenario, kind, stored = scenario_of(case)
        if stored:
            scenario = with_stored_gains(case, scenario)
        prepared_case = prepare_hop(scenario, flight(kind))
    except ValidationError as error:
        return Verdict(refused=str(error.errors()[0]["msg"]).removeprefix("Value error, "))
    except InputError as error:
        return Verdict(refused=str(error))
    return compare(prepared_case, runs)._replace(seconds=time.perf_counter() - start)


def with_stored_gains(case: Case, scenario: Scenario) -> Scenario:
    """Return the scenario with stored gains: those of the same filter with a direct solution that is not late.

    A filter that starts late needs gains of a late start: the first ones, taken later, turn the attitude by 8 deg.
    """
    start = "at once" if case["start"] == "from GNSS" else case["start"]
    delays = (
        case["latency"] if case["measurements"] in PHASES else "none"
    )  # it decides at which epoch a phase begins anew
    plain, kind, _ = scenario_of(
        case | {"receiver": "direct", "latency": delays, "start": start, "algorithm": "extended", "integrity": "none"}
    )
    prepared_case = prepare_hop(plain, flight(kind))
    tape = forward_tape(prepared_case)
    used, n, names = int(tape.n_recorded[0]), prepared_case.layout.n_state, prepared_case.channels.names
    gains = np.zeros((prepared_case.t_epoch.size, len(names), n))
    gains[tape.epoch[:used], tape.channel[:used]] = tape.gain[:used, :n]
    taken = np.unique(tape.channel[:used])
    if not taken.size:
        raise InputError("filter.gains: the filter has no measurement that a gain could be for")
    flown = GainHistory(
        states=state_names(prepared_case.layout),
        measurements=[names[k] for k in taken],
        t=prepared_case.t_epoch,
        gains=gains[:, taken],
    )
    schedule = build_gain_schedule("stored", "test", "time", flown, flight_events(prepared_case), tolerance=1e-6)
    return with_fields(scenario, **{"filter.gains": schedule.model_dump(mode="json")})


def compare(prepared_case: PreparedCase, runs: int) -> Verdict:
    """Compare the RMS of the runs with linear covariance.

    Linear covariance decides on mean innovations and therefore has no false alarms. If the engines differ, runs with a
    false alarm are left out, unless they are more than `MOST_FALSE_ALARMS` of all runs.
    """
    history = covariance(prepared_case)
    block = run_block(prepared_case, SEED, 0, runs)
    verdict = compare_errors(prepared_case, history, block.err)
    alarms = false_alarms(block.decisions, history.decisions)
    if verdict.agrees or not 0 < len(alarms) <= MOST_FALSE_ALARMS * runs:
        return verdict
    without = np.delete(block.err, alarms, axis=0)
    return compare_errors(prepared_case, history, without)._replace(false_alarms=len(alarms))


def false_alarms(decisions: Floats, expected: Floats) -> list[int]:
    """Return the runs with a decision of a kind and code that linear covariance does not make (`expected`).

    Both are tables of run, time, kind and code; the run of linear covariance has no meaning.
    """
    made = {(kind, code) for _, _, kind, code in expected.tolist()}
    return sorted({int(run) for run, _, kind, code in decisions.tolist() if (kind, code) not in made})


def compare_errors(prepared_case: PreparedCase, history: CovHistory, errors: Floats) -> Verdict:
    """Compare the RMS of errors, (n_run, n_history, n_output), with linear covariance."""
    runs = len(errors)
    at = [int(np.argmin(np.abs(history.t - t))) for t in TIMES]
    expected = np.sqrt(history.true_sigma[at] ** 2 + history.mean[at] ** 2)
    rms = np.sqrt(np.mean(errors[:, at] ** 2, axis=0))
    known = expected > 1e-12 * np.maximum(1e-30, np.nanmax(expected, axis=0))
    ratio = np.where(known, rms / np.where(known, expected, 1.0), 1.0)
    ratio = np.where(np.isfinite(ratio), ratio, np.inf)
    bounds = np.sqrt(chi2.ppf([0.5 * LEVEL / ratio.size, 1.0 - 0.5 * LEVEL / ratio.size], runs) / runs)
    off = np.maximum(ratio / bounds[1], bounds[0] / np.maximum(ratio, 1e-30))
    k, column = np.unravel_index(int(np.argmax(off)), off.shape)
    output = prepared_case.outputs[int(column)]
    worst = f"{output.quantity} {output.axis} at {TIMES[int(k)]:g} s: {ratio[k, column]:.3f}"
    return Verdict("", float(ratio.min()), float(ratio.max()), (float(bounds[0]), float(bounds[1])), worst)


REPORT = Path("reports/combinations")
REASONS: dict[int, str] = {
    240: "The filter does not model the common offset of the range rates, so 96 of 4,096 runs have an alarm."
}
"""Why the engines differ, or why there are false alarms, by the number of the case."""
_NUMBERS = ("lowest ratio", "highest ratio", "lower bound", "upper bound")
_ALARMS = "runs with a false alarm"


def main() -> int:
    """Run every case, or those whose numbers are given; write reports/combinations/ case by case."""
    cases = covering()
    chosen = [int(k) for k in sys.argv[1:]]
    verdicts = written(REPORT) if chosen else {}
    for number in sorted(chosen or range(len(cases)), key=_by_kernels(cases).index):
        verdict = verdicts[number] = evaluate(cases[number])
        text = verdict.refused or f"{'agree' if verdict.agrees else 'DIFFER'} {verdict.low:.3f} {verdict.high:.3f}"
        print(number, text, verdict.worst, f"{verdict.seconds:.0f} s", cases[number], flush=True)  # noqa: T201
        write(verdicts, REPORT)
    return int(any(not (v.refused or v.agrees) for v in verdicts.values()))


def written(folder: Path) -> dict[int, Verdict]:
    """Return the verdicts that a matrix has, by the numbers of the cases."""
    found = {}
    with (folder / "matrix.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            refused = row["verdict"].removeprefix("refused: ") if row["verdict"].startswith("refused") else ""
            low, high, *bounds = (float(row[name] or 0.0) for name in _NUMBERS)
            alarms = int(row.get(_ALARMS) or 0)
            found[int(row["case"])] = Verdict(refused, low, high, (bounds[0], bounds[1]), row["worst"], alarms)
    return found


def _by_kernels(cases: list[Case]) -> list[int]:
    """Return the numbers of the cases: refused ones, then those that share kernels, the largest group first."""
    share = Counter(kernels_of(case) for case in cases if not refusal(case))
    order = [(not refusal(case), -share[kernels_of(case)], str(kernels_of(case))) for case in cases]
    return sorted(range(len(cases)), key=lambda number: (*order[number], number))


def write(verdicts: dict[int, Verdict], folder: Path) -> None:
    """Write the matrix as CSV and as a page; of cases that are not run yet it says so."""
    folder.mkdir(parents=True, exist_ok=True)
    cases, ordered = covering(), sorted(verdicts.items())
    head = ["case", *DIMENSIONS, "verdict", *_NUMBERS, "worst", _ALARMS]
    lines = [",".join(f'"{name}"' for name in head)]
    for number, v in ordered:
        verdict = f"refused: {v.refused}" if v.refused else "agree" if v.agrees else "differ"
        cells = [str(number), *cases[number].values()]
        numbers = ["", "", "", ""] if v.refused else [f"{x:.3f}" for x in (v.low, v.high, *v.bounds)]
        lines.append(",".join(f'"{cell}"' for cell in [*cells, verdict, *numbers, v.worst, str(v.false_alarms or "")]))
    (folder / "matrix.csv").write_text("\n".join(lines) + "\n")
    agree, refusals = sum(v.agrees for v in verdicts.values()), sorted({v.refused for v in verdicts.values()} - {""})
    differ = [number for number, v in ordered if not v.refused and not v.agrees]
    with_alarms = [number for number, v in ordered if v.agrees and v.false_alarms]
    waiting = [number for number in range(len(cases)) if number not in verdicts]
    page = [
        "# Combination matrix",
        "",
        f"{len(cases)} cases that contain every pair of levels of {len(DIMENSIONS)} dimensions at least once.",
        f"Each case has {RUNS} runs of one minute. For every output, the ratio of the Monte Carlo RMS to that of",
        f"linear covariance must be within its chi-square interval ({LEVEL:g} per case) at",
        f"{', '.join(f'{t:g} s' for t in TIMES)}. Linear covariance decides on mean innovations: no false alarms.",
        f"If a case differs, runs with a false alarm are left out, at most {100 * MOST_FALSE_ALARMS:g} % of the runs.",
        "",
        f"- Both engines agree: {agree} cases.",
        *([f"- Not run yet: {len(waiting)} ({', '.join(map(str, waiting))})."] if waiting else []),
        f"- They differ: {len(differ)}{' (' + ', '.join(map(str, differ)) + ')' if differ else ''}.",
        *(f"  - {number}: {REASONS.get(number, 'not explained')}" for number in differ),
        *([f"- Agree without runs with a false alarm: {len(with_alarms)} of these cases."] if with_alarms else []),
        *(f"  - {k}: {verdicts[k].false_alarms} of {RUNS} runs. {REASONS.get(k, '')}" for k in with_alarms),
        f"- Refused: {sum(bool(v.refused) for v in verdicts.values())}, for these reasons:",
        *(f"  - {reason}" for reason in refusals),
        "",
        "Every case is a line of [matrix.csv](matrix.csv). Made by `python -m tests.both_engines.combinations`.",
        "",
    ]
    (folder / "README.md").write_text("\n".join(page))


if __name__ == "__main__":
    sys.exit(main())
