"""Matching of the cases of a candidate with those of a base, on the same trajectory."""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities.errors import InputError, Mistake, refuse_all
from lvnav_trade.results.statistics.select import SAME_TIME, flight_events, pick
from lvnav_trade.results.tables.read import Tables

# Largest distance (m) between equal trajectories: rounding of different compilers
_SAME_PLACE = 1.0
_EARTH = 6378137.0


class Pair(NamedTuple):
    """A pair of cases to compare."""

    base: str  # digest in the base
    candidate: str  # digest in the candidate
    label: str  # label of the case; of both cases if their labels differ


def match(base: Tables, candidate: Tables, mapping: Mapping[str, str] | None = None) -> list[Pair]:
    """Return the pairs of cases to compare, in the order of the base.

    Cases with equal labels form a pair. A single case on each side forms a pair with any labels.

    Parameters
    ----------
    base, candidate : Tables
        The two result sets.
    mapping : mapping of str to str, optional
        Name in the candidate by name in the base, of a case (label or digest) or of a level of an axis
        (``{"tactical_fog": "tactical_fog_worse"}``).

    Returns
    -------
    list of Pair
        Pairs of cases.

    Raises
    ------
    InputError
        One line per reason: another seed, no common case, an unknown name in `mapping`, another trajectory or other
        events.
    """
    base_seed = base.campaign.get("seed")
    candidate_seed = candidate.campaign.get("seed")
    if base_seed != candidate_seed:
        raise InputError(
            f"does not compare: other seed ({base.folder} drew with {base_seed}, {candidate.folder} with "
            f"{candidate_seed}); runs belong together only on the same draws"
        )
    pairs = _find_pairs(base, candidate, dict(mapping or {}))
    reasons = [_trajectory_difference(base, candidate, pair) for pair in pairs]
    refuse_all([Mistake(f"does not compare: {reason}") for reason in reasons if reason])
    return pairs


def unmatched_case_notes(base: Tables, candidate: Tables, pairs: Sequence[Pair]) -> list[str]:
    """Return a note on the cases that have no partner."""
    base_cases = {pair.base for pair in pairs}
    candidate_cases = {pair.candidate for pair in pairs}
    notes = []
    for tables, paired_cases, other_tables in ((base, base_cases, candidate), (candidate, candidate_cases, base)):
        unmatched_labels = [label for case, label in tables.labels.items() if case not in paired_cases]
        if unmatched_labels:
            label_text = "; ".join(unmatched_labels)
            notes.append(f"Not compared, because {other_tables.folder} has no such case: {label_text}.")
    return notes


def _find_pairs(base: Tables, candidate: Tables, mapping: dict[str, str]) -> list[Pair]:
    """Return the pairs of cases by the mapping, by equal levels, or the single case of each side.

    Parameters
    ----------
    base, candidate : Tables
        Results to compare.
    mapping : dict of str to str
        Case or level of the candidate, by case or level of the base.

    Raises
    ------
    InputError
        A name of the mapping is unknown, or there is no common case.
    """
    _check_names(base, mapping)
    _check_names(candidate, mapping.values())
    digests = {label: digest for digest, label in candidate.labels.items()}
    partners = {}
    for case in base.labels:
        partner = _find_partner(base, case, candidate, digests, mapping)
        if partner is not None:
            partners[case] = partner
    if not partners and len(base.labels) == len(candidate.labels) == 1:
        partners = dict(zip(base.labels, candidate.labels, strict=True))
    if not partners:
        raise InputError(
            f"does not compare: no common case; {base.folder} has {_case_list(base)}, {candidate.folder} has "
            f"{_case_list(candidate)}; --map BASE:CANDIDATE says which belong together"
        )
    pairs = []
    for case, partner in partners.items():
        label = base.labels[case]
        partner_label = candidate.labels[partner]
        pairs.append(Pair(case, partner, label if partner_label == label else f"{label} → {partner_label}"))
    return pairs


def _find_partner(
    base: Tables, case: str, candidate: Tables, digests: dict[str, str], mapping: dict[str, str]
) -> str | None:
    """Return the case of the candidate that belongs to a case of the base; None if there is none.

    Parameters
    ----------
    base : Tables
        Results of the base.
    case : str
        Digest of a case of the base.
    candidate : Tables
        Results of the candidate.
    digests : dict of str to str
        Digests of the cases of the candidate, by label.
    mapping : dict of str to str
        Case or level of the candidate, by case or level of the base.
    """
    label = base.labels[case]
    levels = base.levels[case]
    mapped_case = mapping.get(label) or mapping.get(case)
    mapped_levels = {axis: mapping.get(level, level) for axis, level in levels.items()}
    if mapped_case or mapped_levels == levels:
        name = mapped_case or label
        return digests.get(name) or (name if name in candidate.labels else None)
    for digest, candidate_levels in candidate.levels.items():
        if candidate_levels == mapped_levels:
            return digest
    return None


def _check_names(tables: Tables, names: Iterable[str]) -> None:
    """Raise InputError for the first name that is neither a case (label or digest) nor a level of an axis."""
    words = [*tables.labels, *tables.labels.values()]
    for levels in tables.levels.values():
        words += [level for _, level in sorted(levels.items())]
    words = list(dict.fromkeys(words))
    for name in names:
        if name not in words:
            near = difflib.get_close_matches(name, words, 1)
            hint = f" (did you mean {near[0]!r}?)" if near else f"; it has {_case_list(tables)}"
            raise InputError(f"--map: {tables.folder} has no case or level {name!r}{hint}")


def _case_list(tables: Tables) -> str:
    return "; ".join(tables.labels.values()) or "no case"


def _trajectory_difference(base: Tables, candidate: Tables, pair: Pair) -> str:
    """Return the difference between the trajectories of a pair, in words; empty if they are equal."""
    epoch = base.cases.set_index("case").epoch[pair.base]
    candidate_epoch = candidate.cases.set_index("case").epoch[pair.candidate]
    if epoch != candidate_epoch:
        return f"{pair.label}: other trajectory (lift-off at {epoch} and at {candidate_epoch})"
    times = flight_events(base, pair.base).set_index("event").t_s.to_dict()
    candidate_times = flight_events(candidate, pair.candidate).set_index("event").t_s.to_dict()
    differing_events = sorted(set(times) ^ set(candidate_times))
    if differing_events:
        return f"{pair.label}: other events (only one of the two has {', '.join(differing_events)})"
    for name, t in times.items():
        if abs(t - candidate_times[name]) > SAME_TIME:
            return f"{pair.label}: other events ({name} at {t:g} s and at {candidate_times[name]:g} s)"
    if not all((tables.folder / "reference.parquet").exists() for tables in (base, candidate)):
        return ""
    trajectory = pick(base.reference, case=pair.base)
    candidate_trajectory = pick(candidate.reference, case=pair.candidate)
    distance = _largest_distance(trajectory, candidate_trajectory)
    if distance > _SAME_PLACE:
        return f"{pair.label}: other trajectory ({distance:.3g} m apart)"
    return ""


def _largest_distance(first: pd.DataFrame, second: pd.DataFrame) -> float:
    """Return the largest distance (m) between two trajectories at their common times."""
    common = first.merge(second, on="t_s", suffixes=("", "_other"))
    if common.empty:
        return 0.0
    longitude_difference = common.longitude_rad - common.longitude_rad_other
    longitude_difference = np.angle(np.exp(1j * longitude_difference))  # in [-pi, pi]
    latitude_difference = common.latitude_rad - common.latitude_rad_other
    north = latitude_difference * _EARTH
    east = longitude_difference * _EARTH * np.cos(common.latitude_rad)
    up = common.altitude_m - common.altitude_m_other
    distance = np.sqrt(north**2 + east**2 + up**2)
    return float(distance.max())
