"""Synonyms of the names of settings, for suggestions in messages."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType

# Each line: words, and parts of names with the same meaning, the closest first
_LINES = (
    ("sextant star_sensor stellar", "star_tracker stellar"),
    ("compass", "magnetometer magnetic_field azimuth heading"),
    ("gps gnss navstar", "receiver constellation"),
    ("rx", "receiver"),
    ("ins irs sigi unit inertial_unit mems fog rlg", "imu"),
    ("gyros gyroscope gyroscopes", "gyro imu"),
    ("accelerometer accelerometers acc", "accel imu"),
    ("arw angle_random_walk vrw velocity_random_walk noise_density white_noise", "random_walk noise"),
    ("rrw", "rate_random_walk"),
    ("bias turn_on_bias", "bias_repeatability bias"),
    ("flicker bias_stability in_run_bias", "bias_instability"),
    ("sf scalefactor", "scale_factor"),
    ("nonorthogonality cross_axis", "misalignment"),
    ("range_limit saturation measuring_range", "full_scale"),
    ("lsb resolution", "quantisation"),
    ("rocket launcher flight mission profile path", "trajectory vehicle"),
    ("orbit", "trajectory perigee apogee"),
    ("satellites almanac ephemeris sky", "constellation"),
    ("kalman kf ekf estimator navigator", "filter"),
    ("ukf sigma_points", "algorithm unscented"),
    ("coupling", "filter measurements"),
    ("observables aiding", "measurements sensors"),
    ("delay lag", "latency delay_compensation"),
    ("outage blackout loss", "satellite_outage faults"),
    ("failure failures anomalies", "faults"),
    ("fdir raim fde", "integrity"),
    ("altimeter radar", "altimeter"),
    ("baro pressure", "barometer pressure_altitude"),
    ("elevation_mask cutoff_angle", "mask"),
    ("lever_arm offset", "lever_arm lever antenna"),
    ("runs trials samples mc montecarlo", "monte_carlo runs"),
    ("lincov covariance_analysis", "covariance"),
    ("limits specs specification acceptance", "requirements"),
    ("sweep parameters trades variants", "axes"),
    ("azimuth_error yaw", "heading"),
    ("level leveling", "tilt alignment"),
    ("price", "cost"),
    ("weight", "mass"),
)
MEANINGS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {word: tuple(parts.split()) for words, parts in _LINES for word in words.split()}
)


def find_synonym(word: str, known_names: Iterable[str]) -> str:
    """Return the known name with the same meaning as a word; empty if there is none.

    A name equal to a term of the same meaning has priority, then a name in a folder of the term, then a name that
    begins with the term or contains it.
    """
    names = list(known_names)
    for term in MEANINGS.get(word.rpartition("/")[2].lower().replace("-", "_").replace(" ", "_"), ()):
        ranked_names = [(rank, name) for name in names if (rank := _rank(name.lower(), term))]
        if ranked_names:
            return min(ranked_names, key=lambda ranked: ranked[0])[1]
    return ""


def _rank(name: str, term: str) -> int:
    folder, _, last = name.rpartition("/")
    matches = (last == term, folder in (term, f"{term}s"), last.startswith(term), term in name)
    return next((number for number, is_match in enumerate(matches, 1) if is_match), 0)
