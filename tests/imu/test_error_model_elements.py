import numpy as np

from lvnav_trade.imu.error_model import DeadElement, sensor_output

INCREMENTS = np.array([[0.1, -0.2, 0.3], [0.5, -0.7, 0.2], [-0.1, 0.2, -0.9], [0.2, 0.1, 0.4]])
AXES = np.eye(3)


def test_what_is_beyond_full_scale_is_clipped_and_nothing_else():
    found = sensor_output(INCREMENTS, AXES, 0.5)
    np.testing.assert_allclose(found, np.clip(INCREMENTS, -0.5, 0.5), atol=1e-15)
    within = np.abs(INCREMENTS) <= 0.5
    np.testing.assert_array_equal(found[within], INCREMENTS[within])


def test_a_unit_within_its_range_puts_out_its_input_to_the_bit():
    assert sensor_output(INCREMENTS, AXES, np.inf) is INCREMENTS
    assert sensor_output(INCREMENTS, AXES, 1.0) is INCREMENTS


def test_a_dead_element_puts_out_nothing_or_what_it_did_before():
    ticks = np.array([False, False, True, True])
    nothing, last = (sensor_output(INCREMENTS, AXES, np.inf, [DeadElement(1, ticks, kept)]) for kept in (False, True))
    np.testing.assert_array_equal(nothing[:, 1], [-0.2, -0.7, 0.0, 0.0])
    np.testing.assert_array_equal(last[:, 1], [-0.2, -0.7, -0.7, -0.7])
    np.testing.assert_array_equal(nothing[:, [0, 2]], INCREMENTS[:, [0, 2]])


def test_skewed_elements_lack_their_own_readings_only():
    axes = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.6, 0.8]])
    found = sensor_output(INCREMENTS, axes, 0.4, [DeadElement(2, np.array([True, False, False, False]), False)])
    expected = np.clip(INCREMENTS @ axes.T, -0.4, 0.4)
    expected[0, 2] = 0.0
    np.testing.assert_allclose(found @ axes.T, expected, atol=1e-15)


def test_what_is_across_a_single_element_stays():
    axes = np.array([[0.0, 1.0, 0.0]])
    found = sensor_output(INCREMENTS, axes, 0.5)
    np.testing.assert_allclose(found[1], [0.5, -0.5, 0.2], atol=1e-15)
