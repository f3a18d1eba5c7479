"""A small study in a temporary folder, for the tests of this folder."""

from __future__ import annotations

import textwrap
from pathlib import Path

CARDS = {
    "configs/imu/good.yaml": """\
        name: good
        source: test
        rate: "200 Hz"
        gyro: {random_walk: "0.03 deg/sqrt(h)", bias_repeatability: "1 deg/h"}
        accel: {random_walk: "0.05 mg/sqrt(Hz)", bias_repeatability: "2 mg"}
        """,
    "configs/imu/poor.yaml": """\
        name: poor
        source: test
        gyro: {random_walk: "0.2 deg/sqrt(h)", bias_repeatability: "10 deg/h"}
        accel: {random_walk: "0.5 mg/sqrt(Hz)", bias_repeatability: "3 mg"}
        """,
    "configs/vehicles/small.yaml": """\
        name: small
        source: test
        stages:
          - {name: one, propellant: "30 t", dry: "3 t", thrust: "600 kN", specific_impulse: "290 s"}
          - {name: two, propellant: "5 t", dry: "1 t", thrust: "60 kN", specific_impulse: "330 s"}
        payload: "300 kg"
        reference_area: "2 m^2"
        mach: [0, 10]
        drag_coefficient: [0.3, 0.3]
        max_load: "6 g"
        """,
    "configs/trajectories/climb.yaml": """\
        kind: vehicle
        name: climb
        source: test
        epoch: "2026-08-01T12:00:00Z"
        vehicle: vehicles/small
        site: {latitude: "-38.6 deg", longitude: "-62 deg"}
        target: {perigee: "350 km", apogee: "350 km", inclination: "45 deg"}
        """,
    "configs/constellations/two.yaml": """\
        kind: nominal
        name: two
        source: test
        epoch: "2026-08-01T00:00:00Z"
        greenwich: "0 deg"
        semi_major_axis: "26560 km"
        inclination: "55 deg"
        slots:
          - {name: A1, node: "0 deg", latitude_argument: "0 deg"}
          - {name: A2, node: "60 deg", latitude_argument: "0 deg"}
        """,
    "configs/receivers/plain.yaml": """\
        name: plain
        source: test
        pseudorange_sigma: "2 m"
        range_rate_sigma: "0.1 m/s"
        solution: {position_sigma: "3 m", velocity_sigma: "0.1 m/s"}
        clock: {h0: 2e-19, h_minus2: 2e-20}
        """,
    "configs/filters/near.yaml": """\
        name: near
        source: test
        measurements: [pseudorange, range_rate]
        """,
    "campaign.yaml": """\
        name: study
        seed: 7
        base:
          trajectory: trajectories/climb
          imu: imu/good
          constellation: constellations/two
          receiver: receivers/plain
          filter: filters/near
          initial: {tilt: "0.1 deg", heading: "0.05 deg", position: "1 m", velocity: "0.01 m/s"}
        """,
}


def write(folder: Path, name: str, text: str) -> Path:
    """Write a file of the study and return its path; a file that has this text is left, so that it is read once."""
    path = folder / name
    content = textwrap.dedent(text).encode()
    if not path.is_file() or path.read_bytes() != content:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return path


def make(folder: Path, extra: str = "") -> Path:
    """Write the whole study, `extra` appended to the campaign, and return the campaign's path."""
    for name, text in CARDS.items():
        write(folder, name, text)
    return write(folder, "campaign.yaml", textwrap.dedent(CARDS["campaign.yaml"]) + textwrap.dedent(extra))
