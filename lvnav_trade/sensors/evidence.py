"""Evidence for a model: the tests that verify it, and the effects that it omits."""

from typing import NamedTuple


class Check(NamedTuple):
    """A test that compares a model with an independent result.

    by : Kind of comparison, one of those in `report/templates/models.toml`.
    shown : Verified property and accuracy.
    test : Id of the test.
    """

    by: str
    shown: str
    test: str


class Evidence(NamedTuple):
    """Evidence for a model as printed in the report: name, tests that verify it, omitted effects."""

    name: str
    checks: tuple[Check, ...]
    omits: str
