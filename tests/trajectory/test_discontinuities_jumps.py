"""Jumps of the specific force that suggest events, and noise that suggests none."""

from __future__ import annotations

import numpy as np
import pytest
from ruamel.yaml import YAML

from lvnav_trade.trajectory.discontinuities import force_jumps, missing_events

EVENTS = {"stage1_cutoff": 150.3, "stage2_ignition": 161.1, "stage2_cutoff": 520.75}
OWN = {"liftoff": 0.0, "end": 600.0}


def burn(t, start, end, first, last):
    """Specific force of a burn at constant thrust, whose mass falls; zero outside."""
    part = np.clip((t - start) / (end - start), 0.0, 1.0)
    return np.where((t >= start) & (t < end), 1.0 / (1.0 / first + part * (1.0 / last - 1.0 / first)), 0.0)


def force(t):
    return burn(t, -1.0, EVENTS["stage1_cutoff"], 13.0, 42.0) + burn(
        t, EVENTS["stage2_ignition"], EVENTS["stage2_cutoff"], 8.0, 45.0
    )


def means(rate, sigma=0.0, seed=0, of=force, end=600.0):
    """Times at a rate (Hz) and mean forces between them; sigma: noise of the velocity (m/s) that they come from."""
    t = np.arange(0.0, end + 0.5 / rate, 1.0 / rate)
    fine = np.linspace(0.0, end, 60_001)
    gained = np.append(0.0, np.cumsum(0.5 * (of(fine)[1:] + of(fine)[:-1]) * np.diff(fine)))
    v = np.interp(t, fine, gained) + sigma * np.random.default_rng(seed).standard_normal(t.size)
    return t, np.diff(v) * rate


def suggested(text):
    return {
        name: float(time.split()[0])
        for name, time in YAML(typ="safe").load(text.partition("as YAML: ")[2])["events"].items()
    }


@pytest.mark.parametrize(
    ("rate", "sigma"), [(2.0, 0.0), (10.0, 0.0), (100.0, 0.0), (1.0, 0.0), (2.0, 0.1), (10.0, 0.3), (30.0, 0.3)]
)
def test_cut_offs_and_ignitions_are_found_to_the_sample_and_can_be_pasted(rate, sigma):
    found = suggested(missing_events(*means(rate, sigma), OWN, 2.0))
    assert list(found) == list(EVENTS)
    tolerance = max(1.0 / rate, 0.5 if sigma else 0.0)
    assert all(abs(found[name] - time) < tolerance for name, time in EVENTS.items())


def test_declared_events_are_not_suggested_and_one_that_is_declared_elsewhere_is():
    assert missing_events(*means(2.0), {**OWN, **EVENTS}, 2.0) == ""
    early = {**OWN, **EVENTS, "stage2_cutoff": 510.0}
    assert suggested(missing_events(*means(2.0), early, 2.0)) == pytest.approx({"stage2_cutoff": 520.75}, abs=0.1)


def test_a_step_between_burning_engines_is_named_by_its_sense():
    def boosted(t):
        return burn(t, -1.0, 200.0, 12.0, 30.0) + np.where(t < 80.0, 8.0, 0.0)

    assert suggested(missing_events(*means(2.0, of=boosted, end=190.0), OWN, 2.0)) == pytest.approx(
        {"fall_1": 80.0}, abs=0.1
    )


def level(t):
    return np.full_like(t, 15.0)


def throttled(t):
    """A throttle that moves by a third within 4 s and back."""
    return 20.0 - 6.0 * (np.clip((t - 48.0) / 4.0, 0.0, 1.0) - np.clip((t - 60.0) / 4.0, 0.0, 1.0))


@pytest.mark.parametrize("of", [level, throttled, lambda t: burn(t, -1.0, 601.0, 13.0, 45.0)])
@pytest.mark.parametrize(
    ("rate", "sigma"), [(1.0, 0.0), (2.0, 0.0), (10.0, 0.0), (2.0, 1.0), (10.0, 1.0), (30.0, 3.0), (30.0, 30.0)]
)
def test_neither_noise_nor_a_force_that_changes_smoothly_suggests_an_event(of, rate, sigma):
    for seed in range(10):
        assert missing_events(*means(rate, sigma, seed, of), OWN, 2.0) == ""


def test_single_wrong_rows_suggest_no_event():
    t, mean = means(2.0, 0.05, of=level)
    v = np.append(0.0, np.cumsum(mean * np.diff(t)))
    v[[100, 230, 231, 600]] += [28.0, 280.0, 280.0, -50.0]
    assert missing_events(t, np.diff(v) / np.diff(t), OWN, 2.0) == ""


def test_few_rows_have_no_jumps():
    assert force_jumps(np.arange(6.0), np.arange(5.0), 2.0) == []
