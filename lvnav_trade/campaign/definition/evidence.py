"""Evidence for the sensor models, as entries of the list of models in the report."""

from __future__ import annotations

from typing import Any

from lvnav_trade.sensors.evidence import Evidence
from lvnav_trade.sensors.family import FAMILY, kind_of


def of_sensors() -> list[dict[str, Any]]:
    """Return the entries of the sensors, in the form of `report/templates/models.toml`.

    Sensors with the same evidence are one entry, with a set of settings for each sensor.
    """
    used: dict[Evidence, list[dict[str, str]]] = {}
    for member in FAMILY:
        settings = {"sensors.*.kind": kind_of(member.card), "filter.measurements": member.card.measurement}
        used.setdefault(member.evidence, []).append(settings)
    return [
        {
            "name": evidence.name,
            "used": settings,
            "checks": [check._asdict() for check in evidence.checks],
            "omits": evidence.omits,
        }
        for evidence, settings in used.items()
    ]
