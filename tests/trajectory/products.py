"""Readers of precise orbits and recorded observations, for tests only, and times of GPS."""

from datetime import UTC, datetime

import numpy as np

from lvnav_trade.quantities.times import GPS_ORIGIN


def gps_time(*moment):
    """Return s of GPS time at year, month, day, hour, minute, second of GPS time."""
    return (datetime(*moment, tzinfo=UTC) - GPS_ORIGIN).total_seconds()


def read_sp3(path):
    """Return {time: {name: position}} (s of GPS time, m) and the names that have a clock at any time."""
    orbits, timed = {}, set()
    for line in path.read_text().splitlines():
        if line.startswith("*"):
            words = line[1:].split()
            here = orbits.setdefault(gps_time(*map(int, words[:5])) + float(words[5]), {})
        elif line.startswith("P"):
            here[line[1:4]] = 1e3 * np.array([float(line[4 + 14 * k : 18 + 14 * k]) for k in range(3)])
            if float(line[46:60]) < 999999.0:
                timed.add(line[1:4])
    return orbits, timed


def read_observations(path, code):
    """Return {time: {name: range}} (s of the receiver's time, m) of one code of a RINEX 2 file, and the approximate
    position of its header.
    """
    lines = path.read_text().splitlines()
    end = next(at for at, line in enumerate(lines) if "END OF HEADER" in line)
    labels = {line[60:].strip(): line[:60] for line in lines[:end]}
    codes = labels["# / TYPES OF OBSERV"].split()[1:]
    assert len(codes) <= 5  # one line a satellite
    column = 16 * codes.index(code)
    epochs, at = {}, end + 1
    while at < len(lines):
        words = lines[at][:26].split()
        count = int(lines[at][29:32])
        if int(lines[at][26:29]) > 1:  # no observations but header lines
            at += 1 + count
            continue
        assert count <= 12
        names = [f"G{int(lines[at][33 + 3 * k : 35 + 3 * k]):02d}" for k in range(count)]
        time = gps_time(2000 + int(words[0]), *map(int, words[1:5])) + float(words[5])
        rows = lines[at + 1 : at + 1 + count]
        epochs[time] = {
            name: float(row[column : column + 14])
            for name, row in zip(names, rows, strict=True)
            if row[column : column + 14].strip()
        }
        at += 1 + count
    return epochs, np.array([float(word) for word in labels["APPROX POSITION XYZ"].split()])
