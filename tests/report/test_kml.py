"""KML that any viewer reads: the schema's elements in its order, coordinates where the flight is."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.report.kml import KmlFlight, flights, write_kml
from lvnav_trade.results.tables.read import load
from tests import synthetic

NAMESPACE = "http://www.opengis.net/kml/2.2"
NS = {"k": NAMESPACE}


def cartesian(longitude, latitude, height):
    """Earth-fixed coordinates (m) from degrees and metres by the textbook formula, WGS-84."""
    lon, lat = math.radians(longitude), math.radians(latitude)
    e2 = 0.00669437999014
    n = 6378137.0 / math.sqrt(1.0 - e2 * math.sin(lat) ** 2)
    flat = (n + height) * math.cos(lat)
    return np.array([flat * math.cos(lon), flat * math.sin(lon), (n * (1.0 - e2) + height) * math.sin(lat)])


def points(element):
    return np.array([[float(x) for x in point.split(",")] for point in element.text.split()])


def flight(ellipses=None):
    t = np.arange(0.0, 11.0)
    reference = pd.DataFrame(
        {
            "t_s": t,
            "latitude_rad": 0.6 + 1e-4 * t,
            "longitude_rad": -1.0 + 2e-4 * t,
            "altitude_m": 100.0 + 1000.0 * t,
            "ground_speed_m_per_s": 100.0 * t,
        }
    )
    return KmlFlight("a & b", reference, pd.DataFrame({"event": ["cutoff"], "t_s": [7.2]}), ellipses or {})


def test_path_and_events_stand_where_the_flight_is(tmp_path):
    root = ET.parse(write_kml(tmp_path / "a.kml", "title", [flight()])).getroot()
    assert root.tag == f"{{{NAMESPACE}}}kml"
    line = root.find("k:Document/k:Folder/k:Placemark/k:LineString", NS)
    assert [child.tag.split("}")[1] for child in line] == ["altitudeMode", "coordinates"]  # the order of the schema
    assert line.find("k:altitudeMode", NS).text == "absolute"
    drawn, meant = points(line.find("k:coordinates", NS)), flight().reference
    assert len(drawn) == 11
    assert np.radians(drawn[:, 0]) == pytest.approx(meant.longitude_rad, abs=1e-10)
    assert np.radians(drawn[:, 1]) == pytest.approx(meant.latitude_rad, abs=1e-10)
    assert drawn[:, 2] == pytest.approx(meant.altitude_m)
    event = root.findall("k:Document/k:Folder/k:Placemark", NS)[1]
    assert event.find("k:name", NS).text == "cutoff"
    assert event.find("k:description", NS).text == "7.200 s, height 7.100 km, speed over the ground 700.0 m/s"
    assert points(event.find("k:Point/k:coordinates", NS))[0, 2] == pytest.approx(7100.0)
    assert root.find("k:Document/k:Folder/k:name", NS).text == "a & b"


def test_an_ellipse_is_the_outline_of_the_three_sigma_ellipsoid(tmp_path):
    turn = Rotation.from_euler("z", 30.0, degrees=True).as_matrix()  # long axis 30 deg east of north
    covariance = turn @ np.diag([100.0**2, 10.0**2, 20.0**2]) @ turn.T
    file = write_kml(tmp_path / "a.kml", "title", [flight({5.0: covariance})], magnify=2.0)
    place = ET.parse(file).getroot().findall("k:Document/k:Folder/k:Placemark", NS)[2]
    ring = points(place.find("k:Polygon/k:outerBoundaryIs/k:LinearRing/k:coordinates", NS))
    assert np.array_equal(ring[0], ring[-1])
    lon, lat = math.degrees(-1.0 + 1e-3), math.degrees(0.6 + 5e-4)
    middle = cartesian(lon, lat, 5100.0)
    offsets = np.array([cartesian(*point) for point in ring]) - middle
    size = np.linalg.norm(offsets, axis=1)
    assert size.max() == pytest.approx(2.0 * 3.0 * 100.0, rel=1e-4)
    assert size.min() == pytest.approx(2.0 * 3.0 * 10.0, rel=0.01)
    far = offsets[np.argmax(size)]
    east = np.array([-math.sin(math.radians(lon)), math.cos(math.radians(lon)), 0.0])
    assert abs(far @ east) / size.max() == pytest.approx(math.sin(math.radians(30.0)), abs=1e-3)
    reported = place.find("k:description", NS).text
    assert "half axes of the ellipsoid 300, 60, 30 m; drawn 2 times as large" in reported


def test_results_give_a_folder_per_case_with_ellipses_of_their_own_sigma(tmp_path):
    tables = load(synthetic.results(tmp_path / "synthetic", n_run=8))
    drawn = flights(tables, True, 60.0)
    assert [one.name for one in drawn] == list(tables.labels.values())
    history = tables.history
    case = next(iter(tables.labels))
    rows = history[(history["case"] == case) & (history.quantity == "position") & (history.axis == "east")]
    time, covariance = next(iter(drawn[0].ellipses.items()))
    sigma = rows.iloc[int(np.abs(rows.t_s - time).argmin())].lincov_true_si
    assert math.sqrt(covariance[1, 1]) == pytest.approx(sigma, rel=1e-6)
    root = ET.parse(write_kml(tmp_path / "a.kml", "title", drawn)).getroot()
    assert len(root.findall(".//k:Polygon", NS)) == sum(len(one.ellipses) for one in drawn) > 0
    assert flights(tables, False, 60.0)[0].ellipses == {}


def test_errors_in_other_axes_give_no_ellipses(tmp_path):
    tables = load(synthetic.results(tmp_path / "synthetic", n_run=8))
    tables.history["axis"] = tables.history["axis"].replace({"north": "x", "east": "y", "down": "z"})
    with pytest.raises(InputError, match="ellipses need errors that are reported in frame ned"):
        flights(tables, True, 60.0)


def test_a_folder_that_is_not_there_cannot_be_written_to(tmp_path):
    with pytest.raises(InputError, match=r"a\.kml: cannot be written: No such file"):
        write_kml(tmp_path / "none" / "a.kml", "title", [flight()])


def test_results_without_a_trajectory_are_one_line(tmp_path):
    tables = load(synthetic.results(tmp_path, n_run=4))
    with pytest.raises(InputError, match=r"reference\.parquet: damaged: no rows of the case"):
        flights(tables.with_frames(reference=tables.reference[:0]), ellipses=False, interval=60.0)
