"""Ascent rebuilt from a record of speed and altitude: the card, and the flight along a great-circle ground track."""

import math
import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy.interpolate import BSpline, make_interp_spline
from scipy.optimize import root_scalar

from lvnav_trade.kernels.earth import OMEGA, gravity_along
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, gmst, rotation_e_n, unit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import (
    AccelerationLimit,
    Angle,
    AngularRateLimit,
    Duration,
    Length,
    Pause,
    Speed,
    TimeConstant,
)
from lvnav_trade.trajectory.ascent.equations_of_motion import Drag, accelerations, fly
from lvnav_trade.trajectory.ascent.great_circle import circle_coordinates
from lvnav_trade.trajectory.ascent.launch import achieved_orbit, pad_knots, site_phase
from lvnav_trade.trajectory.ascent.legs import COASTING, site_axes
from lvnav_trade.trajectory.ascent.plausibility import FileFlightCard, Peak, add_limit_remarks
from lvnav_trade.trajectory.ascent.record import (
    LONGEST_HOLE,
    AscentRecord,
    Climb,
    path_force,
    read,
    residual_facts,
    smooth,
)
from lvnav_trade.trajectory.ascent.steering_law import (
    Steering,
    ascent_attitude,
    smoothsteps,
    stretch_knots,
    thrust_directions,
)
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY, Roll, Site
from lvnav_trade.trajectory.discontinuities import bridged_gaps, gap_remarks, missing_events
from lvnav_trade.trajectory.disturbances import OscillationCard
from lvnav_trade.trajectory.truth import NOTE, WARNING, Phase, Trajectory, join_samples, motion, position_spline

_STEP = 0.5  # s between knots
_COARSEST = 5.0  # s; longest interval over which the force is averaged to distinguish a jump from noise
_UPRIGHT = (4.0, 12.0)  # s; thrust is vertical before, along the specific force after, blended between
_BREAK = re.compile(r"stage\d+_(ignition|cutoff)(_\d+)?$")


class RecordedAscent(FileFlightCard):
    """A trajectory rebuilt from a record of Earth-relative speed and altitude against time.

    The file is CSV with the header ``time_s,speed_m_s,altitude_m``; lines that begin with # are comments. Altitude is
    relative to the site. Thrust jumps at the events ``stageN_ignition`` and ``stageN_cutoff``, and is zero from a
    cut-off to the next ignition.
    """

    kind: Literal["profile"] = "profile"
    site: Site  # launch site
    azimuth: Angle | None = Field(None, description="azimuth of the ground track at the site, from north towards east")
    inclination: Angle | None = Field(
        None, description="inclination of the final orbit; determines the azimuth if that is not stated"
    )
    direction: Literal["ascending", "descending"] = "ascending"  # of the ground track at the site, by inclination
    file: str = Field(description="the record", json_schema_extra={"path": True})
    events: dict[str, Duration] = Field(description="times of the named events, from lift-off")
    speed_noise: Annotated[Speed, Field(gt=0.0)] = Field(description="one-sigma error of a recorded speed")
    altitude_noise: Annotated[Length, Field(gt=0.0)] = Field(description="one-sigma error of a recorded altitude")
    pad_hold: Pause = 60.0  # rest on the pad before lift-off
    roll: Roll = Roll()  # roll angle on the pad and in flight
    coast_after_injection: TimeConstant = 20.0  # time from injection to the end of the flight
    oscillation: tuple[OscillationCard, ...] = Field((), description="coning and vibration, by parts of the flight")
    highest_load: AccelerationLimit = Field(
        147.09975,  # 15 g: launchers end a burn with 4 to 7 g, the lightest of solid motors with 13 g
        description="largest specific force; a trajectory beyond it is refused",
    )
    highest_spin: AngularRateLimit = Field(
        0.5235987755982988,  # 30 deg/s: a record has no attitude, so that it cannot show a spin
        description="largest body rate about the roll axis; a trajectory beyond it is refused",
    )
    highest_misfit: Annotated[float, Field(gt=0.0)] = Field(
        2.0,
        description="largest RMS of trajectory minus record, in sigmas of the stated noise; a trajectory beyond it is"
        " refused",
    )

    def _faults(self) -> Iterator[str]:
        if (self.azimuth is None) == (self.inclination is None):
            yield "give the azimuth or the inclination, one of the two"
        if "injection" not in self.events:
            yield "events must name injection"


Course = list[tuple[Floats, Floats, Floats]]  # of each stretch between breaks: t (n,), r_i and v_i (n, 3)


class RebuiltPhase(NamedTuple):
    """A phase of a rebuilt flight and its position spline, frame i."""

    name: str
    start: float
    end: float
    position: BSpline


def course(site: Site, azimuth: float, climb: Climb, breaks: list[float], theta0: float) -> Course:
    """Return the flight to injection above a great circle on the sphere of ellipsoid normals.

    azimuth : rad. Azimuth at the site, on the ellipsoid.
    breaks : s since lift-off. Times at which acceleration jumps.
    theta0 : rad. Earth angle at lift-off.
    """
    stretches: Course = []
    range_angle = 0.0
    for begin, end in pairwise([0.0, *breaks, float(climb.altitude.t[-1])]):
        t = stretch_knots(begin, end)
        inside = np.clip(t, begin + 1e-9, end - 1e-9)  # one-sided values at the breaks
        psi = _range_angle(site, azimuth, t, climb, inside, range_angle)
        range_angle = float(psi[-1])
        r_e, v_e = _circle_motion(site, azimuth, psi, climb, inside)
        theta = earth_angle(theta0, t)
        earth_rotation = np.cross([0.0, 0.0, OMEGA], r_e)
        r_i = eci_from_ecef(r_e, theta)
        v_i = eci_from_ecef(v_e + earth_rotation, theta)
        stretches.append((t, r_i, v_i))
    return stretches


def _range_angle(site: Site, azimuth: float, t: Floats, climb: Climb, inside: Floats, first: float) -> Floats:
    """Return the angle along the circle from the site, (n,) rad.

    The rate is horizontal speed over the radius of curvature, which hardly depends on the angle: four iterations of the
    quadrature are accurate to 1e-11 rad.

    t : (n,) s. Times.
    inside : (n,) s. The same times, moved off the breaks, at which the climb is evaluated.
    first : rad. Angle at the first time.
    """
    level = climb.level(inside)
    height = site.height + climb.altitude(inside)
    psi = np.full_like(t, first)
    for _ in range(4):
        _, _, derivatives = circle_coordinates(site, azimuth, psi, height)
        path_radius = np.hypot(*derivatives.T)
        rate = level / path_radius
        angle = make_interp_spline(t, rate, k=5).antiderivative()
        psi = first + angle(t)
    return np.asarray(psi)


def _circle_motion(site: Site, azimuth: float, psi: Floats, climb: Climb, t: Floats) -> tuple[Floats, Floats]:
    """Return position (m) and Earth-relative velocity (m/s), each (n, 3) in frame e, at times t (n,) s.

    psi : (n,) rad. Angles along the circle from the site.
    """
    height = site.height + climb.altitude(t)
    latitude, longitude, derivatives = circle_coordinates(site, azimuth, psi, height)
    track = unit(derivatives)
    horizontal = climb.level(t)[:, None] * track
    fall_rate = -climb.altitude(t, 1)
    v_n = np.column_stack([horizontal, fall_rate])
    r_e = ecef_from_geodetic(latitude, longitude, height)
    C_e_n = rotation_e_n(latitude, longitude)
    v_e = np.einsum("kji,kj->ki", C_e_n, v_n)
    return r_e, v_e


def _injection_orbit(stretches: Course) -> dict[str, float]:
    """Return perigee, apogee and inclination at injection."""
    _, r_i, v_i = stretches[-1]
    state = np.concatenate([r_i[-1], v_i[-1]])
    return achieved_orbit(state)


def rebuilt_phases(stretches: Course, coast: float) -> list[RebuiltPhase]:
    """Return the phases to injection and the final coast of `coast` seconds.

    Velocity is interpolated and integrated to position, each phase from the end of the previous phase, so that both are
    continuous. The position differs from the fitted altitude by less than a millimetre.
    """
    phases: list[RebuiltPhase] = []
    for number, (t, r, v) in enumerate(stretches, start=1):
        position = make_interp_spline(t, v, k=5).antiderivative()
        position.c += phases[-1].position(t[0]) if phases else r[0]
        phase = RebuiltPhase(
            name=f"stretch {number}",
            start=float(t[0]),
            end=float(t[-1]),
            position=position,
        )
        phases.append(phase)
    return [*phases, _final_coast(phases[-1], coast)]


def _final_coast(last: RebuiltPhase, duration: float) -> RebuiltPhase:
    """Return the free fall after the last phase."""
    state = np.concatenate([last.position(last.end), last.position(last.end, 1), [1.0]])
    # Without thrust and drag the steering has no effect.
    no_numbers, no_vectors = np.zeros(0), np.zeros((0, 3))
    steering = Steering(
        up_e=np.eye(3)[2],
        downrange_e=np.eye(3)[0],
        theta0=0.0,
        kick_start=np.inf,
        kick_duration=1.0,
        kick_angle=0.0,
        follow_start=np.inf,
        slew=1.0,
        law_start=no_numbers,
        normal_i=no_vectors,
        tangent=no_numbers,
        rate=no_numbers,
    )
    vacuum = Drag(0.0, np.array([0.0, 1.0]), np.zeros(2))
    n_step = max(8, int(np.ceil(duration / _STEP)))
    t, y = fly(last.end, duration, n_step, state, steering, COASTING, vacuum)
    end_accelerations = accelerations(t[[0, -1]], y[[0, -1]], steering, COASTING, vacuum)
    position = position_spline(t, y[:, :3], y[[0, -1], 3:6], end_accelerations)
    return RebuiltPhase(
        name="final coast",
        start=last.end,
        end=float(t[-1]),
        position=position,
    )


def _thrust_spline(phase: RebuiltPhase, t: Floats) -> BSpline:
    """Return the spline of the direction of the specific force of a phase, through its knots t (n,)."""
    gravity = gravity_along(phase.position(t))
    force = phase.position(t, 2) - gravity
    return make_interp_spline(t, unit(force), k=5)


def _pointing(
    card: RecordedAscent, azimuth: float, phases: list[RebuiltPhase], coasts: list[tuple[float, float]]
) -> BSpline:
    """Return the attitude spline over pad and flight, x along the specific force of the powered phases."""
    up_e, _, right_e = site_axes(card.site, azimuth)
    theta0 = gmst(card.epoch)
    coast_starts = [begin for begin, _ in coasts]
    coast_starts.append(phases[-1].start)
    times = [stretch_knots(phase.start, phase.end) for phase in phases]
    thrusts: list[BSpline | None] = []
    for phase, phase_t in zip(phases, times, strict=True):
        is_coast = phase.start in coast_starts
        thrusts.append(None if is_coast else _thrust_spline(phase, phase_t))
    pad_t = pad_knots(card.pad_hold, _STEP)
    no_directions = np.zeros((pad_t.size, 3))
    t = np.concatenate([pad_t, join_samples(times)])
    thrust_axes = np.concatenate([no_directions, *thrust_directions(times, thrusts)])
    vertical_axes = eci_from_ecef(up_e, earth_angle(theta0, t))
    first, last = _UPRIGHT
    progress = smoothsteps((t - first) / (last - first))
    weight = progress[:, None]
    blend = (1.0 - weight) * vertical_axes + weight * thrust_axes
    x = unit(blend)
    return ascent_attitude(t, x, right_e, theta0, card.roll)


def rebuild(card: RecordedAscent) -> Trajectory:
    """Return the true trajectory of a recorded ascent.

    Altitude and horizontal speed are fitted together to the record. The ground track is a great circle of the normals
    of the ellipsoid (fixed to the Earth), which begins at the site in the direction of the azimuth. The body x axis
    lies along the specific force, without a distinction of drag and thrust, and rotates smoothly in coasts.

    Raises
    ------
    InputError
        The record cannot be read or does not reach injection, the site cannot reach the inclination, or the flight
        exceeds a limit of the card.
    """
    record, notes = _until_injection(card, read(card.file))
    breaks, coasts = _breaks_and_coasts(card, record)
    climb = smooth(record, breaks, coasts, card.speed_noise, card.altitude_noise)
    azimuth = _azimuth(card, climb, breaks)
    theta0 = gmst(card.epoch)
    stretches = course(card.site, azimuth, climb, breaks, theta0)
    tracks = rebuilt_phases(stretches, card.coast_after_injection)
    attitude = _pointing(card, azimuth, tracks, coasts)
    pad = site_phase(card.site, theta0, card.pad_hold, attitude)
    phases = (*pad, *(Phase(*track, attitude) for track in tracks))
    flight = Trajectory(
        phases=phases,
        events={"liftoff": 0.0, **card.events},
        theta0=theta0,
        epoch=card.epoch,
    )
    load_t = np.linspace(0.0, flight.end, 4000)
    load = np.linalg.norm(motion(flight, load_t).f_b, axis=1)
    flight.facts.update(
        {
            "record": card.source,
            **_injection_orbit(stretches),
            "azimuth_rad": azimuth,
            "max_load_g": float(np.max(load)) / STANDARD_GRAVITY,
            "smoothing_misfit": climb.misfit,
            **residual_facts("smoothing", record, climb.speed(record.t), climb.altitude(record.t)),
        }
    )
    # Noise of a velocity: that of the speed, plus that of gravity along the path over an interval, g dh / v
    gravity_noise = STANDARD_GRAVITY * card.altitude_noise / np.maximum(record.speed, 1.0)
    noise = card.speed_noise + gravity_noise
    event_warning = missing_events(record.t, path_force(record), flight.events, _COARSEST, noise)
    flight = flight.add_remarks(NOTE, notes).add_remarks(WARNING, [event_warning] if event_warning else [])
    return add_limit_remarks(flight, card, card.file, (_misfit(card, record, climb),))


def _breaks_and_coasts(card: RecordedAscent, record: AscentRecord) -> tuple[list[float], list[tuple[float, float]]]:
    """Return the times (s) at which thrust jumps, and the intervals (s) from a cut-off to the next jump or the end."""
    jumps = {name: time for name, time in card.events.items() if _BREAK.match(name)}
    record_end = record.t[-1]
    breaks = sorted(time for time in jumps.values() if time < record_end)
    cutoffs = [time for name, time in jumps.items() if "cutoff" in name]
    intervals = pairwise([*breaks, card.events["injection"]])
    coasts = [interval for interval in intervals if interval[0] in cutoffs]
    return breaks, coasts


def _misfit(card: RecordedAscent, record: AscentRecord, climb: Climb) -> Peak:
    """Return the normalised RMS misfit, with the time of the worst row."""
    speed_residual = climb.speed(record.t) - record.speed
    altitude_residual = climb.altitude(record.t) - record.altitude
    speed = speed_residual / card.speed_noise
    altitude = altitude_residual / card.altitude_noise
    worst = np.argmax(np.hypot(speed, altitude))
    return Peak("highest_misfit", climb.misfit, float(record.t[worst]))


def _until_injection(card: RecordedAscent, record: AscentRecord) -> tuple[AscentRecord, list[str]]:
    """Return the rows from lift-off, at rest, to injection, and the remarks on gaps in them."""
    injection = card.events["injection"]
    for name, time in card.events.items():
        if not 0.0 <= time <= injection:
            raise InputError(f"{card.name}: event {name!r} at {time:g} s is outside lift-off to injection")
    interval = float(np.median(np.diff(record.t)))
    if record.t[0] > 0.0:
        record = AscentRecord(*(np.append(0.0, column) for column in record))
    # from lift-off to injection, and a row on either side
    first_inside, end = np.searchsorted(record.t, [0.0, injection], side="right")
    first = max(first_inside - 1, 0)
    record = _slice_record(record, first, end + 1)
    gaps, last = bridged_gaps(record.t, injection - interval, LONGEST_HOLE, card.file)
    if last is not None:
        record = _slice_record(record, 0, last.row + 1)
    if record.t[-1] < injection - interval:
        raise InputError(
            f"{card.file}: the record goes from {record.t[0]:g} to {record.t[-1]:g} s, lift-off to injection at "
            f"{injection:g} s is needed"
        )
    inside = (record.t > 0.0) & (record.t < injection)
    t = np.concatenate([[0.0], record.t[inside], [injection]])
    speed = np.interp(t, record.t, record.speed)
    altitude = np.interp(t, record.t, record.altitude)
    return AscentRecord(t, speed, altitude), gap_remarks(gaps)


def _slice_record(record: AscentRecord, first: int, end: int) -> AscentRecord:
    """Return the rows of a record from `first` (included) to `end` (excluded)."""
    return AscentRecord(*(column[first:end] for column in record))


def _azimuth(card: RecordedAscent, climb: Climb, breaks: list[float]) -> float:
    """Return the azimuth (rad) of the card, or the azimuth that leads to the card's inclination."""
    if card.azimuth is not None:
        return card.azimuth
    inclination = card.inclination or 0.0
    # Without Earth rotation: cos(inclination) = sin(azimuth) cos(latitude)
    sine = math.cos(inclination) / math.cos(card.site.latitude)
    if abs(sine) >= 1.0:
        raise InputError(
            f"{card.name}: an inclination of {math.degrees(inclination):.2f} deg cannot be reached from a latitude of "
            f"{math.degrees(card.site.latitude):.2f} deg"
        )
    first = math.asin(sine) if card.direction == "ascending" else math.pi - math.asin(sine)
    theta0 = gmst(card.epoch)

    def excess(azimuth: float) -> float:
        orbit = _injection_orbit(course(card.site, azimuth, climb, breaks, theta0))
        return orbit["inclination_rad"] - inclination

    solution = root_scalar(excess, x0=first, x1=first + 0.01, xtol=1e-10, maxiter=30)
    if not solution.converged or abs(excess(solution.root)) > 1e-6:
        raise InputError(f"{card.name}: no azimuth ends in an inclination of {math.degrees(inclination):.2f} deg")
    return float(solution.root)
