"""A small version of every campaign of the study of couplings: eight runs of the cases that its statements rest on."""

from __future__ import annotations

from pathlib import Path

import pytest

from lvnav_trade import api
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.reading.study_card import load_study
from tests.scripts import publication

pytestmark = pytest.mark.usefixtures("_all_cases_kept")
STUDY = publication("conae")
FOLDER = Path(__file__).resolve().parents[2] / "campaigns" / "conae"
SMALL = (
    "monte_carlo={runs: 8, block: 8}",
    "covariance={budget: false, adjoint: false, observability: false, nonlinearity: false, spot_check: 0}",
    "keep.history=2 s",
)
RUNS = {
    "adaptation": (),
    "antenna_failure": (
        "axes.2.values=[[{kind: antenna_failure, antennas: [1, 3, 4], start: stage2_ignition + 60 s, duration: 30 s}]]",
        "axes.2.labels=[in the second burn]",
        "axes.3.values=[0]",
    ),
    "delay": ("axes.5.values=[0]",),
    "delay_by_satellites": (),
    "hil_causes": (),
    "hil_like": ("axes.5.values=[0]",),
    "hil_sizes": ("axes=[{path: constellation.range_error, values: [0 m, 8 m]}]",),
    "imu_temperature": (),
    "pvt_sources": ("axes.1.values=[0]",),
    "receiver_limits": (),
    "receiver": (
        "axes.0.values=[{kind: bancroft, range_sigma: 2 m, rate_sigma: 0.1 m/s, refinements: 0, reported: true}, "
        "{kind: filtered, range_sigma: 2 m, rate_sigma: 0.1 m/s, jerk: 0.5 m/s^3, jerk_gain: 0.01 1/s^2, "
        "clock_noise: 0.005 m/s^2, range_gain: 1 m*s^2, rate_gain: 0.01 m, reported: true}]",
        "axes.0.labels=[Bancroft, 'EKF-GNSS #1']",
        "axes.1.values=[[]]",
        "axes.1.labels=[none]",
        "axes.2.values=[0]",
    ),
    "troposphere": ("axes.2.values=[0]",),
}
"""What each small version leaves out."""
LONG = {
    "adaptation",
    "antenna_failure",
    "delay_by_satellites",
    "hil_causes",
    "imu_temperature",
    "receiver_limits",
    "receiver",
    "delay",
    "pvt_sources",
    "hil_like",
}
"""Each takes 10 to 60 s: kernels of its own, or many cases. `make slow` flies them."""
LOCI = {
    "delay_cost": ("axes=[{path: receiver.latency, values: [0 ms, 300 ms]}]",),
    "settings": ("axes=[{path: filter.imu.gyro_bias_walk, values: [0.0001 deg/s/sqrt(s), 0.0292 deg/s/sqrt(s)]}]",),
    "error_bound": ("axes=[{path: filter, cards: [filters/tight_conae_000, filters/tight]}]",),
    "pvt_satellites": ("exclude=[]", "axes=[{path: receiver.channels, values: [6, 8]}]"),
    "imu_noise": ("axes=[{path: filter.neglect, values: [[], [gyro_bias, accel_bias]]}]",),
}
HOLD = {
    "adaptation": (),
    "antenna_failure": ("in the second burn: satellites",),
    "delay": ("SIL uncompensated", "in time, compensated", "loose: compensated"),
    "delay_by_satellites": ("delay that grows",),
    "hil_causes": ("the relativistic model adds to the error",),
    "hil_sizes": (),
    "hil_like": ("HIL, position that stays", "HIL, least satellites"),
    "imu_temperature": ("roll", "angular velocity"),
    "pvt_sources": (
        "PV simulation and noise, position",
        "EKF-GNSS #1, position",
        "EKF-GNSS #1, velocity",
        "EKF-GNSS #3, decorrelated",
    ),
    "receiver": ("clock bias", "clock drift", "position", "velocity"),
    "receiver_limits": ("limits of 50 m",),
    "troposphere": ("what the correction leaves", "the mask is needed"),
}
"""Beginnings of the items that hold with eight runs too."""


def test_every_campaign_of_the_folder_is_in_the_study_and_has_a_small_version() -> None:
    study, questions = load_study(FOLDER, None, STUDY.figures)
    files = {path.stem for path in FOLDER.glob("*.yaml")} - {"study"}
    assert files == {one.campaign.name for one in questions} == set(RUNS) | set(LOCI)
    assert study.assumptions


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in RUNS])
def test_what_is_published_holds_with_a_few_runs(name: str, tmp_path: Path) -> None:
    results = api.run(FOLDER / f"{name}.yaml", (*SMALL, *RUNS[name]), tmp_path, jobs=1, report=False)
    assert results.failures == []
    if not HOLD[name]:
        assert (results.tables.cases.run_count == 8).all()
        return
    frame = STUDY.table(results)
    asked = frame[frame.item.str.startswith(HOLD[name])]
    asked = asked[asked.ours.notna()]  # cases that the small version leaves out
    assert set(HOLD[name]) == {start for start in HOLD[name] if asked.item.str.startswith(start).any()}
    out = asked[~asked.in_band]
    assert out.empty, out.to_string()


@pytest.mark.parametrize("name", LOCI)
def test_loci_are_of_linear_covariance_alone(name: str, tmp_path: Path) -> None:
    assert load(FOLDER / f"{name}.yaml").monte_carlo is None
    results = api.run(FOLDER / f"{name}.yaml", (*SMALL[1:], *LOCI[name]), tmp_path, jobs=1, report=False)
    assert len(results.tables.cases) >= 2
    assert (results.rms.lincov_true_sigma > 0).any()


def test_the_filter_whose_biases_walk_meets_the_condition_of_a_bounded_error(tmp_path: Path) -> None:
    asked = ("covariance.error_bound=true", *LOCI["error_bound"])
    tables = api.run(FOLDER / "error_bound.yaml", (*SMALL[2:], *asked), tmp_path, jobs=1, report=False).tables
    noise = tables.error_bound[tables.error_bound.matrix == "Q"].set_index("case")
    by_label = {label: noise.loc[case] for case, label in tables.labels.items()}
    walks, constant = (by_label[f"filter={name}"] for name in ("tight_conae_000", "tight"))
    assert walks.rank_count == walks.state_count == 17
    assert constant.rank_count < 17
