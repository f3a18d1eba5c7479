"""The data dictionary: which tables there are, which columns, in which unit."""

from __future__ import annotations

from typing import NamedTuple

import pyarrow as pa

SUFFIXES = {
    "s": "second",
    "m": "metre",
    "m_per_s": "metre per second",
    "m_per_s2": "metre per second squared",
    "m_per_s3": "metre per second cubed",
    "rad": "radian",
    "rad_per_s": "radian per second",
    "rad_per_s2": "radian per second squared",
    "rad_s_per_m": "radian per second, per metre per second squared",
    "db_hz": "decibel-hertz",
    "ratio": "dimensionless number",
    "count": "how many",
    "number": "a name that is a number (run, lag, seed)",
    "si2": "the square of the SI unit that the column `unit` of the same row names",
    "si": "the SI unit that the column `unit` of the same row names",
}
"""The last part of the name of every column of numbers is one of these."""

SI_SUFFIX = {
    "m": "m",
    "s": "s",
    "m/s": "m_per_s",
    "m/s**2": "m_per_s2",
    "m/s^2": "m_per_s2",
    "rad": "rad",
    "rad/s": "rad_per_s",
    "rad*s/m": "rad_s_per_m",
    "dimensionless": "ratio",
    "": "ratio",
    "1": "ratio",
}
"""Suffix of a column of errors in the table `runs`, by the SI unit of the output."""


class Column(NamedTuple):
    """Name (with unit suffix where it holds numbers), kind, and what it is."""

    name: str
    kind: str
    meaning: str


_KINDS = {"text": pa.string(), "real": pa.float64(), "whole": pa.int64(), "truth": pa.bool_()}

_CASE = Column("case", "text", "digest of the resolved scenario and the seed, 12 hexadecimal digits")
_TIME = Column("t_s", "real", "time since lift-off")
_WHAT = (
    Column("quantity", "text", "attitude, velocity, position, gyro_bias, ..."),
    Column("axis", "text", "axis of the component, or 3d for the norm of the three"),
    Column("unit", "text", "SI unit of the columns that end in _si"),
)
_EVENT = Column("event", "text", "name of the event")
_RUNS = Column("run_count", "whole", "good Monte-Carlo runs behind the row; 0 where there is only LinCov")

TABLES: dict[str, tuple[Column, ...]] = {
    "cases": (
        _CASE,
        Column("label", "text", "the values of the axes, for people"),
        Column("axes", "text", "the same as a JSON object"),
        Column("run_count", "whole", "Monte-Carlo runs, failed ones among them"),
        Column("failed_count", "whole", "runs that failed"),
        Column("nees_dof_count", "whole", "components in the normalised estimation error squared"),
        Column("gate_ratio", "real", "gate on normalised innovations; empty where there is none"),
        Column("logic", "truth", "whether the filter starts, rejects and stops by a logic of its own"),
        Column("acquire_above_db_hz", "real", "C/N0 above which satellites are found; empty where none is computed"),
        Column("track_above_db_hz", "real", "C/N0 above which they are kept; loops may let go earlier"),
        Column("epoch", "text", "UTC of lift-off"),
        Column("facts", "text", "what the trajectory achieves, a JSON object in SI"),
    ),
    "outputs": (
        _CASE,
        *_WHAT,
        Column("label_unit", "text", "unit for people"),
        Column("label_factor_ratio", "real", "label_unit per SI unit"),
    ),
    "runs": (
        _CASE,
        Column("run_number", "whole", "number of the run, from 0"),
        _EVENT,
        _TIME,
        Column("failure", "text", "empty, or why the run failed"),
        Column("t_failed_s", "real", "when it failed; empty if it did not"),
        Column("nees_ratio", "real", "normalised estimation error squared at the event"),
    ),
    "worst": (
        _CASE,
        Column("run_number", "whole", "number of the run, from 0"),
        _TIME,
        Column(
            "t_end_s",
            "real",
            "end of the span, from an event to the next; beside it the largest |error| within, its RMS",
        ),
        Column("failure", "text", "empty, or why the run failed"),
    ),
    "logic": (
        _CASE,
        Column("run_number", "whole", "number of the run, from 0"),
        _TIME,
        Column("from_mode", "text", "what the filter did before: waiting, converging, aiding, predicting, stopped"),
        Column("to_mode", "text", "what it does from then on; outputs are corrected while aiding or predicting"),
        Column("reason", "text", "good samples in a row, converged, data lost, data again, ... persists"),
    ),
    "starts": (
        _CASE,
        Column("run_number", "whole", "number of the run, from 0"),
        Column("source", "text", "error source that is drawn once, at the start"),
        Column("axis", "text", "of the sensor, or of the error"),
        Column("draw_ratio", "real", "the draw, in sigmas"),
    ),
    "history": (
        _CASE,
        _TIME,
        *_WHAT,
        _RUNS,
        Column("mean_si", "real", "mean error (truth minus estimate); for a norm the mean norm"),
        Column("rms_si", "real", "root mean square error"),
        Column("filter_sigma_si", "real", "root mean square of the filter's own sigma"),
        Column("q50_si", "real", "median of |error|, to 1 %"),
        Column("q95_si", "real", "95 % quantile of |error|, to 1 %"),
        Column("q997_si", "real", "99.7 % quantile of |error|, to 1 %"),
        Column("lincov_formal_si", "real", "LinCov: the filter's own sigma"),
        Column("lincov_true_si", "real", "LinCov: sigma of the true error about its mean"),
        Column("lincov_mean_si", "real", "LinCov: mean of the true error (its norm for 3d)"),
        Column("dof_ratio", "real", "chi-square degrees of freedom that one run gives to the mean square, by LinCov"),
    ),
    "consistency": (
        _CASE,
        _TIME,
        _RUNS,
        Column("nees_mean_ratio", "real", "mean over runs of the normalised estimation error squared"),
        Column("nees_dof_count", "whole", "its expectation for a matched filter"),
        Column("expected_nees_ratio", "real", "its expectation by LinCov"),
    ),
    "innovations": (
        _CASE,
        _TIME,
        _RUNS,
        Column("nis_sum_ratio", "real", "sum over runs of the normalised innovations squared of accepted rows"),
        Column("row_count", "whole", "accepted rows, summed over runs"),
        Column("reject_count", "whole", "rows rejected by the gate, summed over runs"),
        Column("lincov_row_count", "whole", "rows of one run in LinCov"),
        Column("expected_nis_ratio", "real", "expectation of one run's sum by LinCov"),
        Column("false_rejection_ratio", "real", "LinCov: probability that the gate rejects a good row, the worst one"),
    ),
    "whiteness": (
        _CASE,
        Column("channel", "text", "innovation channel"),
        Column("lag_number", "whole", "epochs between the two innovations"),
        Column("pair_count", "whole", "pairs in the sum"),
        Column("product_sum_ratio", "real", "sum over runs and epochs of the product of normalised innovations"),
    ),
    "budget": (
        _CASE,
        Column("event", "text", "name of the event, or empty for a row of the history"),
        _TIME,
        Column("source", "text", "error source"),
        *_WHAT,
        Column("sigma_si", "real", "one sigma of the true error from this source alone"),
        Column("share_ratio", "real", "its part of the variance; the parts of all sources sum to 1"),
    ),
    "covariances": (
        _CASE,
        _EVENT,
        _TIME,
        Column("source", "text", "error source, or empty for all together"),
        Column("quantity", "text", "attitude, velocity, position"),
        Column("axis", "text", "axis of the one component"),
        Column("other_axis", "text", "axis of the other component"),
        Column("unit", "text", "SI unit of the components"),
        Column("true_si2", "real", "LinCov: covariance of the two components of the true error"),
        Column("formal_si2", "real", "formal variance, by the filter's model; empty for a source"),
    ),
    "states": (
        _CASE,
        Column("event", "text", "name of the event, or empty for a time of the history"),
        _TIME,
        Column("earth_angle_rad", "real", "from the inertial to the Earth-fixed x axis"),
        *(Column(f"position_{axis}_m", "real", "true position, frame i") for axis in "xyz"),
        *(Column(f"velocity_{axis}_m_per_s", "real", "true velocity, frame i") for axis in "xyz"),
        *(Column(f"axes_q{k}_ratio", "real", "unit quaternion, reporting axes to frame i") for k in range(4)),
    ),
    "joint": (
        _CASE,
        Column("event", "text", "name of the event, or empty for a time of the history"),
        _TIME,
        Column("component", "text", "velocity x, ..., position z, frame i"),
        Column("other_component", "text", "the other component"),
        Column("true_si2", "real", "LinCov: covariance of the two components of the true error"),
        Column("formal_si2", "real", "formal variance, by the filter's model"),
        Column("mean_si", "real", "LinCov: mean of the true error, where the two are the same; else empty"),
    ),
    "adjoint": (
        _CASE,
        Column("event", "text", "the event that is explained"),
        _TIME,
        Column("bin_start_s", "real", "start of the bin of time"),
        Column("bin_end_s", "real", "its end"),
        Column("source", "text", "error source"),
        *_WHAT,
        Column("variance_si2", "real", "what the source put into the variance at the event during the bin"),
    ),
    "sensitivity": (
        _CASE,
        Column("event", "text", "the event that is explained"),
        _TIME,
        Column("source", "text", "error source"),
        Column("quantity", "text", "attitude, velocity, position"),
        Column("unit", "text", "SI unit of the columns that end in _si"),
        Column("factor_ratio", "real", "by which the sigma of the source is multiplied"),
        Column("frozen_si", "real", "LinCov: root mean square of the norm with the gains of the campaign's filter"),
        Column("retuned_si", "real", "the same with a filter that knows the new sigma"),
    ),
    "observability": (
        _CASE,
        Column("phase", "text", "the two events between which the phase lies"),
        _TIME,
        Column("t_end_s", "real", "end of the phase"),
        Column("row_count", "whole", "scalar measurements in it"),
        Column("state_count", "whole", "states of the filter"),
        Column("rank_count", "whole", "singular values above the tolerance"),
        Column("tolerance_ratio", "real", "of singular values"),
        Column("singular_number", "whole", "1 for the largest"),
        Column("singular_ratio", "real", "of the stacked rows in sigmas of their noise, states in initial sigmas"),
        Column("weakest", "text", "direction of the smallest in words, in initial sigmas of the states"),
        Column("direction", "text", "direction of this one"),
    ),
    "error_bound": (
        _CASE,
        Column("matrix", "text", "Q: the noise between two updates; R: that of the rows"),
        Column("unit", "text", "of the bounds: states in initial sigmas; one-sigma of rows"),
        Column("low_si", "real", "the lowest eigenvalue over the nominal flight"),
        Column("high_si", "real", "the highest"),
        Column("rank_count", "whole", "of Q, the smallest of all intervals"),
        Column("state_count", "whole", "states of the filter"),
        Column("weakest", "text", "direction of the lowest of Q in words, in initial sigmas of the states"),
    ),
    "nonlinearity": (
        _CASE,
        _EVENT,
        _TIME,
        Column(
            "motion_ratio",
            "real",
            "second-order part of one update interval's propagation of one-sigma true "
            "errors, in the filter's sigma; the largest of all states and directions",
        ),
        Column("state", "text", "the state of the largest"),
        Column(
            "transition_ratio", "real", "largest first-order difference of the strapdown to the filter's transition"
        ),
        Column("row_ratio", "real", "second-order part of predicted measurements, in sigmas of their innovations"),
    ),
    "satellites": (
        _CASE,
        Column("t_s", "real", "time since lift-off at which the signal is received; latency later a filter has it"),
        Column("satellite", "text", "name such as G05; those above the horizontal or with a channel"),
        Column("system", "text", "its letter as in RINEX: G, E, R"),
        Column("azimuth_rad", "real", "from north over east, at the antenna"),
        Column("elevation_rad", "real", "above the local horizontal"),
        Column("tracked", "truth", "measured at this time"),
        Column("state", "text", "what its channel does: idle, search, acquire, track, lost"),
        Column("antenna_number", "whole", "of the antenna that hears it best, from 1 in the receiver's list"),
        Column("cn0_db_hz", "real", "C/N0 as the loops have it; empty without link budget, or where nothing is heard"),
        Column("range_sigma_m", "real", "true white noise of its pseudorange, one sigma; empty where not tracked"),
        Column("rate_sigma_m_per_s", "real", "true white noise of its range rate, one sigma; empty where not tracked"),
        Column("troposphere_m", "real", "true delay of its pseudorange; empty where not tracked, as the next three"),
        Column("troposphere_left_m", "real", "what the filter's correction leaves of it"),
        Column("ionosphere_m", "real", "true delay of its pseudorange"),
        Column("ionosphere_left_m", "real", "what the filter's correction leaves of it"),
        Column("latency_s", "real", "age of the measurement when the filter takes it"),
    ),
    "transitions": (
        _CASE,
        Column("t_s", "real", "time since lift-off at which the receiver's channels were looked at"),
        Column("satellite", "text", "name such as G05"),
        Column("from_state", "text", "what its channel did before: idle, search, acquire, track, lost"),
        Column("to_state", "text", "what it does from then on"),
        Column("reason", "text", "found, loops closed, dynamics, weak signal, no antenna, fault, out of view, ..."),
    ),
    "reference": (
        _CASE,
        _TIME,
        Column("latitude_rad", "real", "geodetic, WGS-84"),
        Column("longitude_rad", "real", "east positive"),
        Column("altitude_m", "real", "above the ellipsoid"),
        Column("inertial_speed_m_per_s", "real", "in frame i"),
        Column("ground_speed_m_per_s", "real", "relative to the rotating Earth"),
        Column("specific_force_m_per_s2", "real", "its magnitude"),
        Column("body_rate_rad_per_s", "real", "magnitude of the inertial rate of the body"),
    ),
    "nozzle": (
        _CASE,
        Column("feed", "text", "rate that the controller is fed: raw, filtered, true"),
        Column("run_number", "whole", "number of the run, from 0"),
        Column("burn", "text", "burn 1, burn 2, ...; flight for all of it"),
        Column("axis", "text", "pitch, yaw"),
        Column("moved_rad", "real", "integral of the magnitude of the nozzle's rate"),
    ),
    "movement": (
        _CASE,
        _TIME,
        Column("feed", "text", "rate that the controller is fed: raw, filtered, true"),
        Column("axis", "text", "pitch, yaw"),
        Column("mean_rad", "real", "mean over runs of the nozzle's movement so far"),
        Column("low_rad", "real", "least of the runs"),
        Column("high_rad", "real", "most of the runs"),
    ),
    "turning": (
        _CASE,
        Column("feed", "text", "rate that the controller is fed: raw, filtered, true"),
        Column("axis", "text", "pitch, yaw"),
        Column("phase", "text", "burn, coast, change (from a second before a change of phase to two after)"),
        Column("tick_count", "whole", "ticks of the unit in this phase, over all runs"),
        Column("inside_turning_ratio", "real", "part of them with the angular acceleration in its envelope"),
        Column("inside_jerk_ratio", "real", "part of them with the lateral jerk in its envelope"),
        Column("furthest_turning_ratio", "real", "largest angular acceleration over its envelope"),
        Column("furthest_jerk_ratio", "real", "largest lateral jerk over its envelope"),
        Column("attitude_error_rad", "real", "root mean square of attitude less the commanded one"),
        Column("rate_error_rad_per_s", "real", "root mean square of the rate that is fed less the true one"),
        Column("rate_sigma_rad_per_s", "real", "formal sigma of it; of the raw rate that of a sample"),
    ),
    "motion": (
        _CASE,
        _TIME,
        Column("axis", "text", "pitch, yaw; one run with the filtered rate, of each 50 ms the tick furthest out"),
        Column("turning_rad_per_s2", "real", "true angular acceleration"),
        Column("turning_bound_rad_per_s2", "real", "its envelope"),
        Column("jerk_m_per_s3", "real", "true lateral jerk"),
        Column("jerk_bound_m_per_s3", "real", "its envelope"),
    ),
    "events": (
        _CASE,
        _EVENT,
        Column("kind", "text", "event, or fault"),
        _TIME,
        Column("t_end_s", "real", "end of a fault; equal to t_s for an event"),
    ),
}


def error_column(quantity: str, axis: str, unit: str) -> str:
    """Return the column of the table `runs` that holds one error, such as ``velocity_3d_error_m_per_s``."""
    return f"{quantity}_{axis}_error_{SI_SUFFIX[unit]}"


def rms_column(quantity: str, axis: str, unit: str) -> str:
    """Return the column of the table `worst` with one error's root mean square over a span."""
    return f"{quantity}_{axis}_rms_{SI_SUFFIX[unit]}"


def arrow_schema(table: str, extra: tuple[str, ...] = ()) -> pa.Schema:
    """Return the Arrow schema of a table; `extra` names more columns of real numbers at its end."""
    fields = [pa.field(c.name, _KINDS[c.kind], metadata={"meaning": c.meaning}) for c in TABLES[table]]
    return pa.schema(fields + [pa.field(name, pa.float64()) for name in extra])
