"""Results with known answers: runs drawn from Gaussians, and the covariance history that describes them."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from lvnav_trade.covariance.diagnostics.case_diagnostics import (
    FACTORS,
    CaseDiagnostics,
    PhaseView,
    SigmaSensitivity,
    SourceCovariance,
)
from lvnav_trade.covariance.diagnostics.error_bound import ErrorBound
from lvnav_trade.covariance.diagnostics.nonlinearity import Nonlinearity
from lvnav_trade.gnss.fault_cards import SatelliteOutage
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.conditions import FlightProfile
from lvnav_trade.quantities.frames import reporting_axes
from lvnav_trade.quantities.records import (
    LOST,
    TRACK,
    AdjointBudget,
    ChannelTransition,
    CovHistory,
    Motion,
    Output,
    Reference,
    RunBlock,
    Sky,
)
from lvnav_trade.quantities.state_layout import PROTECTED
from lvnav_trade.results.tables.engine_tables import CaseInfo
from lvnav_trade.results.tables.write import open_results
from lvnav_trade.simulation.preparation.initial_draws import InitialDraws
from lvnav_trade.simulation.preparation.signals.atmospheric_delays import Delays
from lvnav_trade.simulation.statistics import summarise

OUTPUTS = (
    *(Output("attitude", axis, "rad", "mrad", 1e3) for axis in ("roll", "pitch", "yaw")),
    *(Output("velocity", axis, "m/s", "m/s", 1.0) for axis in ("north", "east", "down")),
    *(Output("position", axis, "m", "m", 1.0) for axis in ("north", "east", "down")),
    Output("clock_bias", "time", "m", "m", 1.0),
)
SIGMA = np.array([1e-3, 1e-3, 2e-3, 0.1, 0.12, 0.2, 3.0, 3.5, 6.0, 8.0])
MEAN = np.array([0.0, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 2.0, 0.0])
EVENTS = {"liftoff": 0.0, "stage1_cutoff": 40.0, "injection": 99.5}
SOURCES = ("gyro bias", "range noise")
SHARE = np.array([0.75, 0.25])
RETUNED = 0.9
"""What a re-tuned filter makes of the frozen one's error where a source's sigma is changed."""
QUANTITIES = ("attitude", "velocity", "position")
N_EPOCH, N_SAT = 99, 8

CAMPAIGN = """\
name: synthetic
description: Two grades drawn from known Gaussians
seed: 7
monte_carlo: {runs: 200, block: 40}
requirements:
  - {name: loose bound, metric: velocity_error_3d, at: injection, probability: 0.9, below: 2.0 m/s, confidence: 0.9}
  - {name: tight bound, metric: position_error_3d, at: injection, probability: 0.9, below: 4.0 m, confidence: 0.9}
  - {name: rare, metric: attitude_error_roll, at: injection, probability: 0.9973, below: 1.0 rad, confidence: 0.9}
references:
  - {source: "A paper, table 1", item: injection velocity, case: {imu: fine}, metric: velocity_error_3d, at: injection,
     value: 26.0, unit: cm/s, band: [0.5, 2.0], remark: drawn}
  - {source: "A paper, table 1", item: wrong on purpose, case: {imu: coarse}, metric: position_error_north,
     at: injection, value: 100.0, unit: m, band: [0.5, 2.0], remark: ""}
"""


def history_times() -> np.ndarray:
    return np.unique(np.concatenate([np.arange(-5.0, 100.0), list(EVENTS.values())]))


def covariance(factor: float = 1.0, true_factor: float = 1.0) -> CovHistory:
    """Return LinCov of the Gaussians: formal sigma growing with time, the true one `true_factor` times as large."""
    t = history_times()
    growth = factor * (1.0 + 0.01 * np.maximum(t, 0.0))[:, None]
    formal, true = growth * SIGMA, growth * SIGMA * true_factor
    mean = growth * MEAN
    return CovHistory(
        t=t,
        formal_sigma=formal,
        true_sigma=true,
        mean=mean,
        sources=SOURCES,
        budget=SHARE[None, :, None] * true[:, None, :] ** 2,
        formal_cov=formal[:, :, None] ** 2 * np.eye(len(SIGMA)),
        true_cov=true[:, :, None] ** 2 * np.eye(len(SIGMA)),
        t_epoch=np.arange(1.0, N_EPOCH + 1.0),
        n_row=np.full(N_EPOCH, 2 * N_SAT, dtype=np.int32),
        expected_nees=((true**2 + mean**2) / formal**2).sum(axis=1),
        expected_nis=np.full(N_EPOCH, 2.0 * N_SAT),
        false_rejection=np.zeros(N_EPOCH),
        expected_row_nis=np.ones((N_EPOCH, 2 * N_SAT)),
    )


def block(cov: CovHistory, first: int, n_run: int, seed: int = 1, failing: tuple[int, ...] = ()) -> RunBlock:
    """Draw runs whose errors are what `cov` says; each run has its own generator: blocks may be cut anywhere."""
    runs = range(first, first + n_run)
    error, innovation = [], []
    for run in runs:
        draw = np.random.default_rng([seed, run])
        error.append(cov.mean + cov.true_sigma * draw.standard_normal(cov.mean.shape))
        innovation.append(draw.standard_normal((N_EPOCH, 2 * N_SAT)))
    err, inno = np.array(error), np.array(innovation)
    failed = np.array([run in failing for run in runs], dtype=np.int8) * 2
    err[np.ix_(failed != 0, cov.t >= 50.0)] = 1e9
    return RunBlock(
        first_run=first,
        t=cov.t,
        err=err,
        sigma=np.repeat(cov.formal_sigma[None], n_run, axis=0),
        nees=((err / cov.formal_sigma) ** 2).sum(axis=2),
        t_epoch=cov.t_epoch,
        nis=(inno**2).sum(axis=2),
        n_row=np.full((n_run, N_EPOCH), 2 * N_SAT, dtype=np.int32),
        n_reject=np.zeros((n_run, N_EPOCH), dtype=np.int32),
        innovation=inno,
        failed=failed,
        t_failed=np.where(failed != 0, 50.0, np.nan),
    )


def changes(first: int, n_run: int) -> np.ndarray:
    """Return what a filter with a logic does in these runs: starts at 5 s, aids from 25 s; every fourth run loses its
    data in the outage, stops, and starts again.
    """
    story = [(5.0, 0, 1, 1), (25.0, 1, 2, 2)]
    lost = [(60.0, 2, 3, 3), (70.0, 3, 4, 5), (79.0, 4, 1, 1)]
    return np.array(
        [(run, *change) for run in range(first, first + n_run) for change in (*story, *(lost if run % 4 == 0 else ()))]
    )


def decisions(first: int, n_run: int) -> np.ndarray:
    """Return what a filter that tests for faults decides: every run excludes its second channel at 40 s."""
    return np.array([(run, 40.0, 1, 1) for run in range(first, first + n_run)], dtype=float)


def truth_of(reference: Reference) -> dict[str, Any]:
    """Return the fields of a prepared scenario that a flight of ticks every 0.1 s fills."""
    at = np.rint((history_times() - reference.t[0]) / 0.1).astype(int)
    motion = Motion(*(part[at] for part in reference[:6]))
    axes = reporting_axes("ned", motion.t, motion.r_i, motion.v_i, 0.0)
    return {"reference": reference, "motion": motion, "record": SimpleNamespace(axes=axes)}


def prepared_case(logic: bool = False) -> Any:
    """Return what the store reads of a prepared scenario: a climb due east, eight satellites, one outage."""
    t = np.arange(-5.0, 100.01, 0.1)
    height = 0.5 * 20.0 * np.maximum(t, 0.0) ** 2
    angle = OMEGA * t + 1e-6 * np.maximum(t, 0.0) ** 2
    direction = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(t)], axis=1)
    r_i = (6378137.0 + height)[:, None] * direction
    ones = np.ones((len(t), 3))
    reference = Reference(
        t, r_i, np.gradient(r_i, t, axis=0), np.tile([1.0, 0, 0, 0], (len(t), 1)), 20.0 * ones, 0.01 * ones,
        ones[1:] * 0.0, ones[1:] * 0.0,
    )  # fmt: skip
    t_epoch = np.arange(1.0, N_EPOCH + 1.0)
    names = tuple(f"G{k + 1:02d}" for k in range(N_SAT))
    azimuth = np.tile(np.linspace(0.0, 5.5, N_SAT), (N_EPOCH, 1))
    elevation = np.tile(np.linspace(0.1, 1.5, N_SAT), (N_EPOCH, 1)) + 1e-4 * t_epoch[:, None]
    tracked = np.ones((N_EPOCH, N_SAT), dtype=bool)
    tracked[(t_epoch >= 60.0) & (t_epoch < 75.0)] = False
    # after the outage one satellite after the other is found again, a second each
    tracked &= (t_epoch[:, None] < 60.0) | (t_epoch[:, None] >= 75.0 + np.arange(N_SAT))
    shape = (N_EPOCH, N_SAT, 3)
    return SimpleNamespace(
        scenario=SimpleNamespace(
            frame="ned",
            faults=(SatelliteOutage(start="stage1_cutoff + 20 s", duration="15 s"),),
            receiver=SimpleNamespace(
                link=SimpleNamespace(), tracking=SimpleNamespace(acquire_above=33.0, track_above=25.0)
            ),
        ),
        trajectory=SimpleNamespace(
            events=EVENTS,
            flight_profile=FlightProfile(EVENTS),
            epoch="2026-08-01T12:00:00Z",
            theta0=0.0,
            facts={"perigee_m": 2.0e5, "max_load_g": 4.2},
        ),
        **truth_of(reference),
        sky=Sky(
            t_epoch,
            names,
            np.zeros(shape),
            np.zeros(shape),
            azimuth,
            elevation,
            tracked,
            antenna=np.tile(np.arange(N_SAT) % 2, (N_EPOCH, 1)),
            cn0=np.where(tracked, 38.0 + np.arange(N_SAT), 20.0),
            range_sigma=np.full(shape[:2], 2.0),
            rate_sigma=np.full(shape[:2], 0.1),
            phase_sigma=np.full(shape[:2], 0.002),
            continuous=tracked,
            state=np.where(tracked, TRACK, LOST).astype(np.int8),
            lever_arms=np.zeros((2, 3)),
            systems=("G",) * N_SAT,
            transitions=_transitions(names),
        ),
        atmospheric_delays=_delays(elevation, tracked, height[np.searchsorted(t, t_epoch)]),
        t_epoch=t_epoch + np.where(t_epoch < 50.0, 0.1, 0.3),
        outputs=OUTPUTS,
        layout=SimpleNamespace(n_estimated=len(OUTPUTS)),
        model=SimpleNamespace(gate_squared=np.inf),
        options=SimpleNamespace(rules=() if logic else None, fault_tests=() if logic else None, imu_array=None),
        channel_names=tuple(f"{name} {what}" for name in names for what in ("range", "range rate")),
    )


def _transitions(names: tuple[str, ...]) -> tuple[ChannelTransition, ...]:
    """Return what the channels do: track from the start, lose all to the fault, find one a second after it."""
    start = [ChannelTransition(1.0, name, "idle", "track", "tracked from the start") for name in names]
    loss = [ChannelTransition(60.0, name, "track", "lost", "fault") for name in names]
    back = [
        ChannelTransition(75.0 + k + wait, name, before, after, reason)
        for k, name in enumerate(names)
        for wait, before, after, reason in (
            (-0.9, "lost", "search", "search"),
            (-0.5, "search", "acquire", "found"),
            (0.0, "acquire", "track", "loops closed"),
        )
    ]
    return (*start, *loss, *sorted(back))


def _delays(elevation: np.ndarray, tracked: np.ndarray, height: np.ndarray) -> Delays:
    """Return 2.4 m over the sine of the elevation that decay with height, and 5 m of ionosphere; half is corrected."""
    air = 2.4 * np.exp(-height / 8e3)[:, None] / np.sin(elevation)
    true = [np.where(tracked, delay, 0.0)[:, :, None] * np.array([1.0, 0.0]) for delay in (air, 5.0 + 0.0 * air)]
    return Delays(*true, *(0.5 * delay for delay in true))


def explanation(cov: CovHistory) -> CaseDiagnostics:
    """Return diagnostics of the Gaussians: all sources act evenly over ten bins, re-tuning gains a tenth."""
    by_source = []
    for event, t in EVENTS.items():
        true = cov.true_cov[int(np.argmin(np.abs(cov.t - t)))]
        blocks = np.stack([true[at : at + 3, at : at + 3] for at in (0, 3, 6)])
        by_source.append(SourceCovariance(event, t, SOURCES, SHARE[:, None, None, None] * blocks))
    end = by_source[-1].covariance
    variance = np.concatenate([end[:, q].diagonal(axis1=1, axis2=2) for q in range(3)], axis=1).T
    adjoint = AdjointBudget(
        99.5, np.arange(-0.5, 100.0, 10.0), SOURCES, OUTPUTS[:9], np.repeat(variance[:, :, None] / 10.0, 10, axis=2)
    )
    singular = np.array([30.0, 4.0, 1.0, 0.2, 1e-5])
    return CaseDiagnostics(
        "injection",
        adjoint,
        tuple(by_source),
        tuple(_sensitivity(quantity, np.trace(end[:, q], axis1=1, axis2=2)) for q, quantity in enumerate(QUANTITIES)),
        (PhaseView("liftoff to injection", 0.0, 99.5, 4, 1e-2, singular, 900, "+1.00 attitude roll"),),
        tuple((event, Nonlinearity(t, 1e-3, 4, 2e-5, 1e-6)) for event, t in EVENTS.items()),
        ErrorBound(15, 15, 2e-9, 3.0, np.eye(15)[0], (("m", 2.0, 2.5), ("m/s", 0.1, 0.1))),
        "+1.00 attitude roll",
    )


def _sensitivity(quantity: str, variance: np.ndarray) -> SigmaSensitivity:
    factors = np.array(FACTORS)
    frozen = np.sqrt(variance.sum() + (factors**2 - 1.0) * variance[:, None])
    return SigmaSensitivity(99.5, quantity, SOURCES, FACTORS, frozen, frozen * np.where(factors == 1.0, 1.0, RETUNED))


def starts(n_run: int, seed: int = 1) -> InitialDraws:
    """Return draws of which the errors at injection follow to 95 %, as linear theory would have it."""
    cov = covariance()
    blind = covariance()._replace(mean=0.0 * cov.mean, true_sigma=np.ones_like(cov.true_sigma))
    sigmas = block(blind, 0, n_run, seed).err[:, int(np.argmin(np.abs(cov.t - EVENTS["injection"]))), :9]
    other = np.array([np.random.default_rng([seed + 1, run]).standard_normal(9) for run in range(n_run)])
    values = 0.95 * sigmas + np.sqrt(1.0 - 0.95**2) * other
    sources = tuple(name for name in ("turn-on a", "turn-on b", "turn-on c") for _ in "xyz")
    return InitialDraws(np.arange(n_run), sources, ("x", "y", "z") * 3, values)


CASES = (
    (CaseInfo("aaaaaaaaaaaa", "imu=fine", {"imu": "fine"}), 1.0),
    (CaseInfo("bbbbbbbbbbbb", "imu=coarse", {"imu": "coarse"}), 3.0),
)


def unsealed(folder: Path) -> Path:
    """Let a test change tables: leave their digests out of the manifest, as earlier versions did."""
    manifest = json.loads((folder / "manifest.json").read_text())
    del manifest["digests"]
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def results(
    folder: Path,
    n_run: int = 200,
    size: int = 40,
    wrong: float = 1.0,
    failing: tuple[int, ...] = (),
    campaign: str = CAMPAIGN,
    rejects: float = 0.0,
    logic: bool = False,
    explained: bool = True,
    traced: bool = True,
) -> Path:
    """Write the results of two cases; the runs are drawn `wrong` times as large as the covariance history says.

    rejects: probability that the gate rejects a good row at one epoch; logic: the filters start and stop by one;
    explained: linear covariance is explained; traced: the worst runs are kept over time.
    A new folder is a copy: the same results are computed once per process.
    """
    settings = (n_run, size, wrong, failing, campaign, rejects, logic, explained, traced)
    if folder.is_dir() and any(folder.iterdir()):
        return _write_results(folder, *settings)
    shutil.copytree(_computed(settings), folder, dirs_exist_ok=True)
    return folder


@cache
def _computed(settings: tuple[Any, ...]) -> Path:
    """Return the folder of these results, computed once. Tests change copies only."""
    root = tempfile.mkdtemp(prefix="lvnav-synthetic-")
    atexit.register(shutil.rmtree, root, ignore_errors=True)
    return _write_results(Path(root) / "results", *settings)


def _write_results(
    folder: Path,
    n_run: int,
    size: int,
    wrong: float,
    failing: tuple[int, ...],
    campaign: str,
    rejects: float,
    logic: bool,
    explained: bool,
    traced: bool,
) -> Path:
    """Write the results of two cases, see `results`."""
    written = open_results(folder, "synthetic", campaign, {"seed": 7}, "resume")
    for case, factor in CASES:
        reported, drawn = covariance(factor), covariance(factor, wrong)
        if logic:
            reported = reported._replace(decisions=decisions(0, 1))
        reported.false_rejection[50] = rejects
        done = written.block_spans(case.id)
        for first in range(0, n_run, size):
            count = min(size, n_run - first)
            if (first, count) not in done:
                runs = block(drawn, first, count, failing=failing)
                if logic:
                    runs = runs._replace(changes=changes(first, count), decisions=decisions(first, count))
                written.write_block(case.id, summarise(runs, EVENTS, reported.true_sigma, OUTPUTS))
        parts = written.block_summaries(case.id) if n_run else None
        drawn = starts(n_run) if n_run else None
        written.write_case(
            case, prepared_case(logic), reported, parts, explanation(reported) if explained else None, drawn
        )

    def trace(folder: Path) -> None:
        """Leave the worst runs over time, as a campaign does."""
        from lvnav_trade.results.requirements.margins import worst_runs  # here: workers do without pandas
        from lvnav_trade.results.tables.read import Tables

        for case, runs in worst_runs(Tables(folder)).groupby("case").run_number:
            drawn = covariance({one.id: factor for one, factor in CASES}[case], wrong)
            again = (block(drawn, run, 1, failing=failing) for run in sorted(set(runs)))
            written.write_traces(case, prepared_case(logic), again)

    written.finish({"timings_s": {}, "cases": [case.id for case, _ in CASES]}, trace if n_run and traced else None)
    return folder


def with_allan_curves(tables: Any) -> tuple[str, Any]:
    """Return the first case, and the tables with Allan deviations of both of its sensors."""
    import pandas as pd  # here: workers, which this module stands in for, do without

    case, tau = next(iter(tables.labels)), np.array([0.1, 1.0, 10.0, 100.0])
    white, walk = 1e-6 / np.sqrt(tau), 1e-8 * np.sqrt(tau / 3.0)
    rows = [
        pd.DataFrame({
            "case": case, "sensor": sensor, "unit": unit, "tau_s": tau, "simulated_si": 1.1 * np.hypot(white, walk),
            "card_si": np.hypot(white, walk), "white_noise_si": white, "bias_instability_si": 0.0 * tau,
            "random_walk_si": walk,
        })
        for sensor, unit in (("gyro", "rad/s"), ("accelerometer", "m/s^2"))
    ]  # fmt: skip
    return case, tables.with_frames(allan=pd.concat(rows, ignore_index=True))


def with_protection_levels(tables: Any, level: float = 9.0) -> tuple[str, Any]:
    """Return the first case, and the tables with levels of its position (m) and velocity (a tenth) on each axis, twice
    as large before the cutoff of stage 1; without faults two thirds of it.
    """
    import pandas as pd  # here: workers, which this module stands in for, do without

    case, t = next(iter(tables.labels)), np.unique(tables.history.t_s)
    axes = {name: [*dict.fromkeys(tables.outputs[tables.outputs.quantity == name].axis)] for name in PROTECTED}
    rows = []
    for (name, unit), size in zip(PROTECTED.items(), (level, 0.1 * level), strict=True):
        for axis in (*(one for one in axes[name] if one != "3d"), "3d"):
            sizes = np.where(t < EVENTS["stage1_cutoff"], 2.0, 1.0) * size * (3.0**0.5 if axis == "3d" else 1.0)
            rows.append(pd.DataFrame({
                "case": case, "t_s": t, "quantity": name, "axis": axis, "unit": unit, "level_si": sizes,
                "fault_free_si": sizes / 1.5, "sigma_si": sizes / 6.0, "satellite": "G01",
            }))  # fmt: skip
    return case, tables.with_frames(protection=pd.concat(rows, ignore_index=True))
