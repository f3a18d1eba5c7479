"""Digest of a case: the identity by which its results are stored and resumed."""

import hashlib
import json
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from lvnav_trade.campaign.syntax import fields
from lvnav_trade.quantities.input_files import read_bytes
from lvnav_trade.quantities.input_limits import DATA_BYTES
from lvnav_trade.quantities.marks import MARKS
from lvnav_trade.quantities.shared_cards import Resources
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent

RESULTS_VERSION = 1  # raised when the same scenario and seed no longer give the same numbers

Cache = dict[int, tuple[BaseModel, Any]]
"""Contents of cards by `id` of the card. The cards are stored too, so that no new card gets the same `id`."""


def case_id(scenario: Scenario, seed: int, history: float, cache: Cache | None = None) -> str:
    """Return the digest of a case: 12 hexadecimal digits.

    The digest covers the scenario, the seed, the step of the history (s) and the version of the results. The step is
    included because covariance steps are cut at history times. A file named in the scenario enters by its content and
    not by its path: a copy of the campaign in another folder has the same digest, an edited almanac gives another.

    Parameters
    ----------
    scenario : Scenario
        The scenario.
    seed : int
        Seed of the campaign.
    history : float
        Step of the stored history, s.
    cache : dict, optional
        Cache of the contents of cards; extended here.

    Returns
    -------
    str
        Digest.
    """
    data = {
        "scenario": _scenario_content(scenario, cache),
        "seed": seed,
        "history": history,
        "results_version": RESULTS_VERSION,
    }
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _scenario_content(scenario: Scenario, cache: Cache | None) -> dict[str, Any]:
    """Return the content of a scenario without vehicle dispersions that no run draws (nominal guidance)."""
    content = _content(scenario, cache)
    card = scenario.trajectory
    if not isinstance(card, VehicleAscent) or card.guidance != "nominal":
        return content
    trajectory = content["trajectory"]
    vehicle = {key: value for key, value in trajectory["vehicle"].items() if key != "dispersions"}
    return {**content, "trajectory": {**trajectory, "vehicle": vehicle}}


def _content(model: BaseModel, cache: Cache | None = None) -> dict[str, Any]:
    """Return the content of a card that enters the digest, as plain data; `cache`: contents of the cards within it."""
    card_class = type(model)
    omitted_names: set[str] = set()
    contents: dict[str, Any] = {}  # of the fields that are not simply dumped
    for name, info in card_class.model_fields.items():
        value = getattr(model, name)
        if _is_omitted(name, value, info):
            omitted_names.add(name)
        elif isinstance(value, BaseModel):
            contents[name] = _cached_content(value, cache)
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            contents[name] = [_content(item) for item in value]
        elif isinstance(value, dict):
            entries = {}
            for key, entry in value.items():
                entries[key] = _content(entry) if isinstance(entry, BaseModel) else entry
            contents[name] = entries
        elif isinstance(value, str) and fields.is_path(card_class, name):
            contents[name] = _file_digest(value)
        elif isinstance(value, tuple) and fields.is_path(card_class, name):
            contents[name] = [_file_digest(file) for file in value]
    field_data = model.model_dump(mode="json", exclude={*contents, *omitted_names})
    return field_data | contents


def _is_omitted(name: str, value: Any, info: FieldInfo) -> bool:
    """Whether a field does not enter the digest: it does not affect results, or is a recent field at its default."""
    extra = info.json_schema_extra
    if isinstance(extra, dict) and extra.get("digest_if_set") and value == info.default:
        return True
    return name in MARKS or isinstance(value, Resources) or (name == "resources" and value is None)


def _cached_content(card: BaseModel, cache: Cache | None) -> Any:
    if cache is None:
        return _content(card)
    if id(card) not in cache:
        cache[id(card)] = card, _content(card)
    _, content = cache[id(card)]
    return content


def _file_digest(file: str) -> str:
    return hashlib.sha256(read_bytes(file, DATA_BYTES)).hexdigest()
