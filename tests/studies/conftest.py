"""Results with known answers (matched, wrong, linear covariance alone), and the small study of the campaigns' tests."""

from __future__ import annotations

from tests.campaign.conftest import study
from tests.results.conftest import alone, good, wrong

__all__ = ["alone", "good", "study", "wrong"]
