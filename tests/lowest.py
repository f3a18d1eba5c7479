"""Constraints that pin every dependency to the lowest version in pyproject.toml; `make lowest` installs them."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


def lowest(text: str) -> list[str]:
    """Return `name==version` for each requirement of a pyproject.toml and its extra `test`; ValueError for one without
    a lower bound.
    """
    project = tomllib.loads(text)["project"]
    pins = []
    for requirement in (*project["dependencies"], *project["optional-dependencies"]["test"]):
        found = re.fullmatch(r"([\w.-]+)>=([\w.]+)(,<[\w.]+)?", requirement)
        if found is None:
            raise ValueError(f"{requirement!r} is not of the form name>=lowest,<highest")
        pins.append(f"{found[1]}=={found[2]}")
    return pins


if __name__ == "__main__":
    sys.stdout.write("\n".join(lowest(PROJECT.read_text(encoding="utf-8"))) + "\n")
