"""Card of a trajectory in a user's file: the columns with their units and frames, and the events."""

import re
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field

from lvnav_trade.quantities.units import (
    Angle,
    AngleLimit,
    AngleSigma,
    Card,
    Duration,
    LengthSigma,
    Pause,
    SpeedSigma,
    parse,
)
from lvnav_trade.trajectory.ascent.plausibility import FileFlightCard
from lvnav_trade.trajectory.ascent.vehicle_cards import Roll
from lvnav_trade.trajectory.disturbances import OscillationCard

_NAME = re.compile(r"[A-Za-z_]\w*$")
OWN_EVENTS = ("start", "liftoff", "end")


def _unit_validator(si_unit: str) -> AfterValidator:
    """Return the validator of a unit that must be convertible to an SI unit."""

    def require_convertible(unit: str) -> str:
        parse(f"1 {unit}", si_unit)
        return unit

    return AfterValidator(require_convertible)


TimeUnit = Annotated[str, _unit_validator("s")]
LengthUnit = Annotated[str, _unit_validator("m")]
SpeedUnit = Annotated[str, _unit_validator("m/s")]
AngleUnit = Annotated[str, _unit_validator("rad")]
Three = Annotated[tuple[str, ...], Field(min_length=3, max_length=3)]


class TimeColumn(Card):
    """The column of time, and its value at lift-off."""

    column: str
    unit: TimeUnit
    liftoff: float = Field(0.0, description="value of the column at lift-off, in its unit")


class PositionColumns(Card):
    """Three columns of position: latitude, longitude and ellipsoidal height (WGS-84), or x, y and z.

    Frame eci has the true equator of date (TEME if `greenwich` is omitted). Frame j2000 is EME2000; GCRF and ICRF
    agree with it to 1 m on the ground.
    """

    frame: Literal["geodetic", "ecef", "eci", "j2000"]
    columns: Three = Field(description="latitude, longitude, height; or x, y, z")
    unit: str = Field(description="unit of the angles if the frame is geodetic, otherwise of x, y and z")
    height_unit: LengthUnit | None = Field(None, description="unit of the height if the frame is geodetic")

    def _faults(self) -> Iterator[str]:
        is_geodetic = self.frame == "geodetic"
        parse(f"1 {self.unit}", "rad" if is_geodetic else "m")
        if is_geodetic and self.height_unit is None:
            yield "height_unit is missing: the unit of the height"
        if not is_geodetic and self.height_unit is not None:
            yield f"height_unit means nothing in frame {self.frame}"


class VelocityColumns(Card):
    """Three columns of velocity: relative to the Earth in frame ecef or ned, inertial in frames eci and j2000."""

    frame: Literal["ecef", "eci", "j2000", "ned"]
    columns: Three = Field(description="x, y, z; or north, east, down")
    unit: SpeedUnit


class AttitudeColumns(Card):
    """Columns of attitude of the body (x forward along the roll axis, y right, z down) against a frame.

    A quaternion or matrix turns components in one frame into those in the other, by rows of the matrix. Euler angles
    turn about z, then y, then x (yaw, pitch, roll).
    """

    form: Literal["quaternion", "matrix", "euler"]
    frame: Literal["ecef", "eci", "j2000", "ned"] = Field(description="frame to which the attitude refers")
    columns: tuple[str, ...] = Field(
        description="4 columns of a quaternion, 9 of a matrix by rows, or yaw, pitch, roll"
    )
    scalar: Literal["first", "last"] | None = Field(None, description="position of the scalar in the quaternion")
    turns: Literal["body_to_frame", "frame_to_body"] | None = Field(
        None, description="direction of the transformation by a quaternion or matrix"
    )
    unit: AngleUnit | None = Field(None, description="unit of Euler angles")

    def _faults(self) -> Iterator[str]:
        n_column = {"quaternion": 4, "matrix": 9, "euler": 3}[self.form]
        if len(self.columns) != n_column:
            yield f"{self.form} takes {n_column} columns, not {len(self.columns)}"
        if (self.scalar is None) == (self.form == "quaternion"):
            yield "scalar is for a quaternion, and a quaternion needs it: first or last"
        if (self.turns is None) == (self.form != "euler"):
            yield "turns is for a quaternion or matrix, and they need it: body_to_frame or frame_to_body"
        if (self.unit is None) == (self.form == "euler"):
            yield "unit is for Euler angles, and they need it"


class TableTrajectory(FileFlightCard):
    """A trajectory in a user's file, CSV or Parquet, with a row for each time.

    The specific force may jump at the events only. With velocity columns the true velocity is a spline through their
    rows and the true position its integral, which is compared with the position rows. Without them the true position is
    a spline through the position rows. Without attitude columns the body x axis lies along the specific force.
    """

    kind: Literal["table"] = "table"
    file: str = Field(
        description="file with the rows: Parquet (.parquet, .pq) or CSV", json_schema_extra={"path": True}
    )
    delimiter: str = Field(",", min_length=1, max_length=1, description="separator of the fields of a CSV file")
    time: TimeColumn  # column of time
    position: PositionColumns  # columns of position
    velocity: VelocityColumns | None = None  # columns of velocity; none: derivative of the position
    attitude: AttitudeColumns | None = None  # columns of attitude; none: from the motion
    greenwich: Angle | None = Field(
        None,
        description="angle from the x axis of the file's frame eci to Greenwich at lift-off; none: sidereal time of "
        "the epoch",
    )
    events: dict[str, Duration] = Field(default_factory=dict, description="times of the named events, from lift-off")
    position_noise: LengthSigma | None = Field(
        None, description="one-sigma of a row; none: the rounding error implied by its digits"
    )
    velocity_noise: SpeedSigma | None = Field(
        None, description="one-sigma of a row; none: the rounding error implied by its digits"
    )
    attitude_noise: AngleSigma | None = Field(
        None, description="one-sigma of a row; none: the rounding error implied by its digits"
    )
    smallest_jump: LengthSigma = Field(
        0.5, description="a larger step of the position at an event is treated as a change of its reference point"
    )
    moving_reference: tuple[tuple[str, str], ...] = Field(
        (), description="pairs of events between which the reference point of the position moves in the body"
    )
    largest_force_angle: AngleLimit = Field(
        0.5235987755982988,  # 30 deg
        description="largest median angle between the body's x axis and specific forces above 1 g; beyond it the "
        "attitude is refused",
    )
    pointing: Literal["thrust", "velocity"] = Field(
        "thrust",
        description="direction of the x axis if the file has no attitude: along the specific force, or along the "
        "Earth-relative velocity",
    )
    roll: Roll = Field(Roll(), description="roll angle if the file has no attitude")
    pad_hold: Pause = Field(
        0.0, description="duration of rest on the pad before the first row, at the position of that row"
    )
    oscillation: tuple[OscillationCard, ...] = Field((), description="coning and vibration, by parts of the flight")

    coast_after_injection: ClassVar[float] = 0.0  # the flight ends with the last row

    def _faults(self) -> Iterator[str]:
        columns = [group for group in (self.position, self.velocity, self.attitude) if group is not None]
        if self.greenwich is not None and all(group.frame != "eci" for group in columns):
            yield "greenwich is the angle of frame eci, and no columns are in it"
        yield from self._without_effect()
        for name in self.events:
            if name in OWN_EVENTS:
                yield f"{name!r} cannot name an event: it is one already"
            elif not _NAME.match(name):
                yield f"{name!r} cannot name an event"
        events = (*self.events, *OWN_EVENTS)
        for pair in self.moving_reference:
            for name in pair:
                if name not in events:
                    raise ValueError(
                        f"moving_reference names {name!r}, which is no event (there are {', '.join(events)})"
                    )
        if self.moving_reference and self.velocity is None:
            yield "moving_reference needs a velocity: without it nothing tells how the point moves"

    def _without_effect(self) -> Iterator[str]:
        """Yield the settings that differ from their default and have no effect with the columns of the card."""
        is_idle = {
            "largest_force_angle": self.attitude is None,
            "attitude_noise": self.attitude is None,
            "velocity_noise": self.velocity is None,
            "pointing": self.attitude is not None,
            "roll": self.attitude is not None,
        }
        for name, has_no_effect in is_idle.items():
            default = type(self).model_fields[name].default
            if has_no_effect and getattr(self, name) != default:
                quantity = "velocity" if name.startswith("velocity") else "attitude"
                verb = "states" if name in ("pointing", "roll") else "does not state"
                yield f"{name} has no effect: the card {verb} columns of {quantity}; leave it out"
