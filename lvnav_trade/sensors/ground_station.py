"""Ground radar or ranging station: range, azimuth and elevation of the vehicle from a station, or some of them.

With the line d = r - s from the station s to the vehicle, and the station's north, east and up,

    range = |d|,  azimuth = atan2(d.east, d.north),  elevation = asin(d.up / |d|)

z = h(r) + b_range + b_angle - dh/dd e_s + c (excess, 0, bending) + v, with biases, the survey error e_s of the station,
the fraction c of the refraction (`kernels/media/sight.py`) after the station's correction, and white noise v. The
filter knows position and axes of the station, and a reference direction from which angles count, so that the azimuth
does not jump at north.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, Field

from lvnav_trade.kernels.attitude import cross
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import sqrt, where
from lvnav_trade.kernels.media.refractivity import exponential_refractivity
from lvnav_trade.kernels.media.sight import along_line
from lvnav_trade.kernels.strapdown import R
from lvnav_trade.quantities.conditions import ELEVATIONS, SightConditions
from lvnav_trade.quantities.frames import ecef_from_geodetic, eci_from_ecef, rotation_e_n
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.units import (
    Angle,
    AngleSigma,
    Fraction,
    Length,
    LengthSigma,
    TimeConstant,
    require_distinct,
)
from lvnav_trade.sensors.jacobian_row import H_POS, arctangent, clear
from lvnav_trade.sensors.sensor import (
    Check,
    CorrelatedError,
    Evidence,
    FlightView,
    Registration,
    SensorCard,
    SensorModel,
    StateUnit,
)

Scalar = Literal["range", "azimuth", "elevation"]
SCALARS: tuple[Scalar, ...] = ("range", "azimuth", "elevation")
# Indices of the filter parameters: station position, horizontal reference direction and up (3 each, frame i); azimuth,
# elevation, and cosine and sine of the elevation of the reference; scalars as a bit mask: 1 + 2 + 4 for all.
PLACE, AHEAD, UP, AZIMUTH, ELEVATION, COSINE, SINE, WHICH = 0, 3, 6, 9, 10, 11, 12, 13


class StationModel(SensorModel):
    """A ground station as the filter models it: white noise of ranges and angles; biases as states."""

    states: ClassVar[Mapping[str, StateUnit]] = {
        "range_bias": StateUnit("station_range_bias", "m", "m", 1.0),
        "angle_bias": StateUnit("station_angle_bias", "rad", "mrad", 1e3),
    }

    range_sigma: LengthSigma = Field(gt=0.0)
    angle_sigma: AngleSigma = Field(gt=0.0)
    range_bias: LengthSigma = Field(0.0, description="of the extra state station_range_bias: its initial one-sigma")
    angle_bias: AngleSigma = Field(0.0, description="of the extra state station_angle_bias: its initial one-sigma")

    def variance(self, flight: FlightView) -> Floats:
        """Return the variance (1, 3) of range (m^2), azimuth and elevation (rad^2)."""
        return np.square([[self.range_sigma, self.angle_sigma, self.angle_sigma]])


class StationSight(NamedTuple):
    """Lines of sight from a station, frame i.

    values : (n, 3) m, rad, rad. Range, azimuth, elevation.
    partials : (n, 3, 3). Their derivatives by the vehicle's position.
    place : (n, 3) m. Position of the station.
    north : (n, 3). Unit vector to the north at the station.
    east : (n, 3). Unit vector to the east at the station.
    up : (n, 3). Unit vector upwards at the station.
    """

    values: Floats
    partials: Floats
    place: Floats
    north: Floats
    east: Floats
    up: Floats


class StationCard(SensorCard, SightConditions):
    """A radar or ranging station on the ground that tracks the IMU and sends its measurements to the filter.

    It measures above its elevation mask (elevation_above) and within its longest range.
    """

    measurement: ClassVar[str] = "ground_tracking"
    model: ClassVar[type[SensorModel]] = StationModel
    labels: ClassVar[tuple[str, ...]] = SCALARS
    unit: ClassVar[str] = "m or rad"
    jacobian: ClassVar[tuple[str, ...]] = ("position",)
    noise: ClassVar[str] = "ground tracking noise"
    noise_fields: ClassVar[tuple[str, ...]] = ("range_sigma", "angle_sigma")
    availability_phrase: ClassVar[str] = "the station sees the vehicle"

    kind: Literal["ground_station"] = "ground_station"
    latitude: Angle = Field(description="geodetic, of the station as surveyed")
    longitude: Angle = Field(description="surveyed longitude of the station")
    height: Length = Field(0.0, description="height of the station above the ellipsoid")
    measures: Annotated[tuple[Scalar, ...], AfterValidator(require_distinct)] = Field(
        SCALARS, min_length=1, description="measurements of the station"
    )
    range_sigma: LengthSigma = Field(0.0, description="white noise of a range; required if the station measures range")
    angle_sigma: AngleSigma = Field(
        0.0, description="white noise of azimuth and elevation; required if the station measures one of them"
    )
    range_bias: LengthSigma = Field(
        0.0, description="lasting error of the ranges, from the delay of transponder and receiver"
    )
    angle_bias: AngleSigma = Field(0.0, description="lasting error of azimuth and of elevation: orientation, levelling")
    survey: LengthSigma = Field(0.0, description="survey error of the station, for each of north, east, up")
    refraction: Fraction = Field(
        0.0,
        description="residual refraction after the station's correction, as a fraction of the refraction, equal for "
        "all scalars",
    )
    refraction_time: TimeConstant | None = Field(None, description="time constant of that fraction; none: constant")
    longest_range: Annotated[Length, Field(gt=0.0)] = Field(description="largest range at which the station measures")

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if abs(self.latitude) > 0.5 * math.pi:
            yield "latitude: is between -90 deg and 90 deg"
        yield from self._scalar_faults("range", "range" in self.measures)
        yield from self._scalar_faults("angle", set(self.measures) != {"range"})

    def _scalar_faults(self, name: str, is_measured: bool) -> Iterator[str]:
        """Yield the input errors of the fields of ranges or of angles."""
        if is_measured:
            if getattr(self, f"{name}_sigma") == 0.0:
                yield f"{name}_sigma: is missing, or zero; the station measures {name}s"
            return
        for field in (f"{name}_sigma", f"{name}_bias"):
            if getattr(self, field) > 0.0:
                yield f"{field}: no effect: the station measures no {name}"

    @property
    def scalars(self) -> tuple[str, ...]:
        """Measured scalars, in the order range, azimuth, elevation."""
        return tuple(name for name in SCALARS if name in self.measures)

    @property
    def _indices(self) -> list[int]:
        """Indices of the measured scalars in `SCALARS`."""
        return [SCALARS.index(name) for name in self.scalars]

    def lines_of_sight(self, flight: FlightView) -> StationSight:
        """Return the lines of sight to the vehicle at the epochs."""
        C_e_n = rotation_e_n(self.latitude, self.longitude)
        site_e = np.array(ecef_from_geodetic(self.latitude, self.longitude, self.height))
        place = _inertial_vectors(site_e, flight)
        north = _inertial_vectors(C_e_n[0], flight)
        east = _inertial_vectors(C_e_n[1], flight)
        up = _inertial_vectors(-C_e_n[2], flight)
        line = flight.r_i - place
        n = np.sum(line * north, axis=1)
        e = np.sum(line * east, axis=1)
        u = np.sum(line * up, axis=1)
        horizontal_distance = np.hypot(n, e)
        distance = np.linalg.norm(line, axis=1)
        azimuth = np.mod(np.arctan2(e, n), 2.0 * np.pi)
        elevation = np.arctan2(u, horizontal_distance)
        # derivatives by position: along the line, across it in the horizontal plane, and across it in the vertical one
        across = n[:, None] * east - e[:, None] * north
        azimuth_partial = across / horizontal_distance[:, None] ** 2
        horizontal = n[:, None] * north + e[:, None] * east
        ahead = horizontal / horizontal_distance[:, None]
        vertical = horizontal_distance[:, None] * up - u[:, None] * ahead
        elevation_partial = vertical / distance[:, None] ** 2
        range_partial = line / distance[:, None]
        return StationSight(
            values=np.stack([distance, azimuth, elevation], axis=1),
            partials=np.stack([range_partial, azimuth_partial, elevation_partial], axis=1),
            place=place,
            north=north,
            east=east,
            up=up,
        )

    def truth(self, flight: FlightView) -> Floats:
        """Return the measured scalars among range (m), azimuth and elevation (rad), (n_epoch, n_scalar)."""
        return self.lines_of_sight(flight).values[:, self._indices]

    def noise_sigma(self, flight: FlightView) -> Floats:
        """Return the one-sigma (1, n_scalar) in m or rad."""
        return np.array([[self.range_sigma, self.angle_sigma, self.angle_sigma]])[:, self._indices]

    def assumed_variance(self, model: SensorModel, flight: FlightView) -> Floats:
        """Return the variance (1, n_scalar) that a filter assumes for the measured scalars."""
        return model.variance(flight)[:, self._indices]

    def is_available(self, flight: FlightView) -> Bools:
        """Return whether the vehicle is above the mask and near enough, (n_epoch,)."""
        distance, _, elevation = self.lines_of_sight(flight).values.T
        return np.asarray((distance <= self.longest_range) & (elevation >= 0.0) & self.meets_elevation(elevation))

    @property
    def limiting_field(self) -> str:
        """Field with its elevation mask, or else with its longest range."""
        for name in ELEVATIONS:
            if name in self.condition_keys:
                return name
        return "longest_range"

    def filter_parameters(self, model: SensorModel, flight: FlightView) -> Floats:
        """Return the parameters of the station and the reference of its angles, (n_epoch, 14): `PLACE` to `WHICH`."""
        sight = self.lines_of_sight(flight)
        _, azimuth, elevation = sight.values.T
        ahead = np.cos(azimuth)[:, None] * sight.north + np.sin(azimuth)[:, None] * sight.east
        angles = np.stack([azimuth, elevation, np.cos(elevation), np.sin(elevation)], axis=1)
        mask = sum(2**k for k in self._indices)
        masks = np.full((flight.t.size, 1), mask)
        return np.hstack([sight.place, ahead, sight.up, angles, masks])

    def correlated_errors(self) -> tuple[CorrelatedError, ...]:
        """Return biases, survey error and residual refraction."""
        errors = []
        if 0 in self._indices:
            errors.append(
                CorrelatedError(
                    "station range bias",
                    "range",
                    self.range_bias,
                    "range_bias",
                    math.inf,
                    ("",),
                    lambda flight: self._select(np.eye(3)[None, :, :1]),
                )
            )
        angles = [k for k in self._indices if k > 0]
        if angles:
            names = tuple(SCALARS[k] for k in angles)
            errors.append(
                CorrelatedError(
                    "station angle bias",
                    "angle",
                    self.angle_bias,
                    "angle_bias",
                    math.inf,
                    names,
                    lambda flight: self._select(np.eye(3)[None, :, angles]),
                )
            )
        survey = CorrelatedError(
            "station survey",
            "survey",
            self.survey,
            "survey",
            math.inf,
            ("north", "east", "up"),
            self._survey_partials,
        )
        refraction = CorrelatedError(
            "refraction",
            "refraction",
            self.refraction,
            "refraction",
            self.refraction_time or math.inf,
            ("",),
            self._refraction_partials,
        )
        return (*errors, survey, refraction)

    def _select(self, partials: Floats) -> Floats:
        """Return partials (n_epoch, 3, n_label) of the scalars that it measures."""
        return partials[:, self._indices]

    def _survey_partials(self, flight: FlightView) -> Floats:
        """Return the derivative (n_epoch, n_scalar, 3) by the survey error north, east, up."""
        sight = self.lines_of_sight(flight)
        axes = np.stack([sight.north, sight.east, sight.up], axis=2)
        return self._select(-sight.partials @ axes)

    def _refraction_partials(self, flight: FlightView) -> Floats:
        """Return the refraction (n_epoch, n_scalar, 1): excess of the range (m), bending of the elevation (rad)."""
        distance, _, elevation = self.lines_of_sight(flight).values.T
        air = along_line(exponential_refractivity, self.height, np.maximum(elevation, 0.0), distance)
        refraction = np.stack([air.excess, 0.0 * distance, air.bending], axis=1)
        return self._select(refraction[:, :, None])


def _inertial_vectors(vector_e: Floats, flight: FlightView) -> Floats:
    """Return a vector that is constant in frame e in frame i at the epochs, (n_epoch, 3)."""
    return eci_from_ecef(np.broadcast_to(vector_e, (flight.t.size, 3)), flight.theta)


@jit
def _set_position_row(h, x, y, z):
    """Set a Jacobian row h (N_ENTRY,) to a derivative x, y, z by position; its other entries become zero."""
    clear(h)
    h[H_POS] = x
    h[H_POS + 1] = y
    h[H_POS + 2] = z


@jit
def _wrap_angle(angle):
    """Return an angle (rad) between -2 pi and 2 pi as an angle between -pi and pi."""
    wrapped_angle = where(angle < -math.pi, angle + 2.0 * math.pi, angle)
    return where(angle > math.pi, angle - 2.0 * math.pi, wrapped_angle)


@jit
def fill(H, z, first_row, measurement, nav, parameters):
    """Set the Jacobian rows of the measured scalars from `first_row` on, and the innovations (m, rad).

    Parameters
    ----------
    H, z : (n, n_entry) and (n,) Jacobian rows and innovations of the epoch, updated in place
    first_row : index of the first scalar measurement
    measurement : (4,) measured scalars, without those that the station does not measure, in order of `SCALARS` (m, rad)
    nav : (10,) navigation state, frame i
    parameters : (14,) parameters of station and reference direction, `PLACE` to `WHICH`
    """
    # line from the station
    x = nav[R] - parameters[PLACE]
    y = nav[R + 1] - parameters[PLACE + 1]
    w = nav[R + 2] - parameters[PLACE + 2]
    # axes: horizontal reference direction f, g to its right, up u
    fx, fy, fz = parameters[AHEAD], parameters[AHEAD + 1], parameters[AHEAD + 2]
    ux, uy, uz = parameters[UP], parameters[UP + 1], parameters[UP + 2]
    gx, gy, gz = cross(fx, fy, fz, ux, uy, uz)
    forward = x * fx + y * fy + w * fz
    right = x * gx + y * gy + w * gz
    up = x * ux + y * uy + w * uz
    level_square = forward * forward + right * right
    level = sqrt(level_square)
    distance_square = level_square + up * up
    distance = sqrt(distance_square)
    scalar_mask = int(parameters[WHICH])
    measures_range = scalar_mask % 2 == 1
    measures_azimuth = scalar_mask // 2 % 2 == 1
    measures_elevation = scalar_mask >= 4
    row, k = first_row, 0
    if measures_range:
        _set_position_row(H[row], x / distance, y / distance, w / distance)
        z[row] = measurement[k] - distance
        row, k = row + 1, k + 1
    if measures_azimuth:
        # tan(azimuth - reference) = right / forward
        right_partial = forward / level_square
        forward_partial = right / level_square
        azimuth_x = right_partial * gx - forward_partial * fx
        azimuth_y = right_partial * gy - forward_partial * fy
        azimuth_z = right_partial * gz - forward_partial * fz
        _set_position_row(H[row], azimuth_x, azimuth_y, azimuth_z)
        z[row] = _wrap_angle(measurement[k] - parameters[AZIMUTH]) - arctangent(right, forward)
        row, k = row + 1, k + 1
    if measures_elevation:
        # tan(elevation) = up / level; the horizontal part of the line has length `level`
        level_x = forward * fx + right * gx
        level_y = forward * fy + right * gy
        level_z = forward * fz + right * gz
        up_partial = level / distance_square
        level_partial = up / (level * distance_square)
        elevation_x = up_partial * ux - level_partial * level_x
        elevation_y = up_partial * uy - level_partial * level_y
        elevation_z = up_partial * uz - level_partial * level_z
        _set_position_row(H[row], elevation_x, elevation_y, elevation_z)
        # sine and cosine of the predicted elevation less that of the reference, times the distance
        c, s = parameters[COSINE], parameters[SINE]
        z[row] = measurement[k] - parameters[ELEVATION] - arctangent(up * c - level * s, level * c + up * s)


SENSORS = (
    Registration(
        StationCard,
        Evidence(
            "Ground radar or ranging station",
            checks=(
                Check(
                    "closed form",
                    "one range leaves the closed form along the line of sight to 0.2 %",
                    "tests/both_engines/test_ground.py::test_one_range_leaves_the_closed_form_along_the_line_of_sight",
                ),
                Check(
                    "closed form",
                    "residual refraction of a steep line in a flat atmosphere to 0.5 %",
                    "tests/sensors/test_ground_station.py"
                    "::test_the_residual_refraction_of_a_high_line_is_that_of_a_flat_atmosphere",
                ),
                Check(
                    "both engines",
                    "a station with every error",
                    "tests/both_engines/test_ground.py"
                    "::test_both_engines_agree_on_a_station_with_every_error_and_name_each_in_the_budget",
                ),
            ),
            omits="The link to the vehicle, servo lag, glint, range rate; refraction is that of one "
            "exponential atmosphere.",
        ),
        fill=fill,
        order=10,
    ),
)
