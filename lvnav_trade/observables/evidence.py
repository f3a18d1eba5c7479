"""Evidence for a model: the tests that check it, and what it leaves out."""

from typing import NamedTuple


class Check(NamedTuple):
    """A test that compares a model with something independent of it.

    by : What it is compared with, one of the sorts in `report/templates/models.toml`.
    shown : What the test shows, and how closely.
    test : Id of the test.
    """

    by: str
    shown: str
    test: str


class Evidence(NamedTuple):
    """What the report says of a model: its name, the tests that check it, what it leaves out."""

    name: str
    checks: tuple[Check, ...]
    omits: str
