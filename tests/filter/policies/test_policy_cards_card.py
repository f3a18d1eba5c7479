import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import chi2

from lvnav_trade.filter.policies.policy_cards import IntegrityCard, build_fault_tests


def test_thresholds_are_those_of_chi_square_at_the_level_of_one_test():
    found = build_fault_tests(
        IntegrityCard(false_alarm=1e-2, isolation=1e-4, window=3), n_test=500, max_satellite_count=8, interval=0.5
    )
    # 500 rows, each alone and in its window
    assert found.single_limit == pytest.approx(chi2.isf(1e-5, 1), rel=1e-9)
    assert found.window_limit == pytest.approx(chi2.isf(1e-5, 3), rel=1e-9)
    np.testing.assert_allclose(found.residual_limits[1:5], chi2.isf(1e-4, [1, 2, 3, 4]), rtol=1e-9)
    assert np.isinf(found.residual_limits[0])
    assert (found.shift_limit, found.clock_limit) == pytest.approx((chi2.isf(1e-4, 3), chi2.isf(1e-4, 1)), rel=1e-9)
    assert (found.hold, found.interval) == (20.0, 0.5)


@pytest.mark.parametrize("wrong", [{"false_alarm": 0.0}, {"isolation": 1.0}, {"window": 1}, {"exclusions": 0}])
def test_levels_and_counts_outside_their_range_are_refused(wrong):
    with pytest.raises(ValidationError):
        IntegrityCard(**wrong)
