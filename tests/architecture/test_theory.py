"""The Jacobians that the theory prints are those of the code: its tables are read and evaluated."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lvnav_trade.kernels import transition
from lvnav_trade.kernels.attitude import matrix
from lvnav_trade.kernels.earth import gravity_gradient, height_and_normal
from lvnav_trade.kernels.strapdown import N_SUM, SUM_C, SUM_F, SUM_TH, SUM_V
from lvnav_trade.quantities.line_of_sight import antenna
from lvnav_trade.sensors import (
    altimeter,
    ground_station,
    magnetometer,
    ranges,
    receiver_solution,
    star_tracker,
    sun_sensor,
)
from lvnav_trade.sensors.jacobian_row import H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL, N_ENTRY
from tests.latex import Value, evaluate

NAV = np.array([0.8, -0.2, 0.5, 0.26, 3100.0, 4200.0, -900.0, 4.05e6, -3.10e6, -4.12e6])
NAV[:4] /= np.linalg.norm(NAV[:4])
C = np.array(matrix(*NAV[:4])).reshape(3, 3)
LEVER, RATE = np.array([3.0, -0.7, 1.1]), np.array([0.02, -0.05, 0.01])
SATELLITE, SATELLITE_V = np.array([2.1e7, -9.0e6, -1.3e7]), np.array([1900.0, 2600.0, -1200.0])
STATES = {"$\\delta r$": H_POS, "$\\psi$": H_ATT, "$\\delta v$": H_VEL}
Rows = dict[str, Value]


def column(*v: object) -> Value:
    return np.concatenate([np.atleast_1d(np.asarray(one, dtype=float)) for one in v])[:, None]


def table(root, first: str) -> tuple[list[str], dict[str, list[str]]]:
    """Return heads and rows (by the first cell) of the table of the page whose first head is given."""
    text = (root / "docs/theory.md").read_text(encoding="utf-8")
    lines = text[text.index(f"| {first} |") :].split("\n\n")[0].splitlines()
    cells = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines]
    return cells[0][1:], {row[0]: row[1:] for row in cells[2:]}


def at() -> Value:
    out = np.zeros(21)
    antenna(out, NAV, RATE, LEVER, -1.0)  # the filter knows the rate by a gyro bias
    return out


def symbols() -> Rows:
    """Return what the page's symbols are here."""
    place = at()
    line = SATELLITE - place[:3]
    rho = float(np.linalg.norm(line))
    e, w = line / rho, SATELLITE_V - place[3:6]
    found: Rows = {r"\rho_s": np.asarray(rho), "e_s": column(e), "w": column(w), "C_b^i": C, r"\ell": column(LEVER)}
    found |= {r"\ell^i": column(C @ LEVER), r"\dot\ell^i": column(C @ np.cross(RATE, LEVER)), "I": np.eye(3)}
    text = r"-\frac{1}{\rho_s} (w - (w \cdot e_s)\, e_s)"
    return found | {"p": evaluate(text, found), "printed p": text}  # type: ignore[dict-item]


def coded() -> dict[str, tuple[Value, Rows]]:
    """Return for every measurement of the table the rows of the code, and symbols beside those of `symbols`."""
    place, found, view, z = at(), {}, symbols(), np.zeros(3)
    e, rho = view["e_s"].ravel(), float(view[r"\rho_s"])

    h = np.full(N_ENTRY, np.nan)
    ranges.range_row(h, place, *e, rho, 5.0)
    found["pseudorange"] = h.copy()[None], {}
    ranges.rate_row(h, place, SATELLITE_V, *e, rho, 5.0)
    found["range rate"] = h.copy()[None], {}
    H = np.zeros((6, N_ENTRY))
    for scalar in range(6):
        receiver_solution.row(H[scalar], place, scalar)
    of_velocity = np.abs(H[:3, H_VEL : H_VEL + 3]).max() > 0.0
    first, second = (H[:3], H[3:]) if of_velocity else (H[3:], H[:3])
    found["velocity"], found["position"] = (first, {}), (second, {})

    H = np.zeros((3, N_ENTRY))
    altimeter.fill(H, z, 0, np.zeros(1), NAV)
    found["altitude, pressure altitude"] = H[:1].copy(), {"n": column(*height_and_normal(*NAV[7:])[1:])}

    mounting = np.array([0.5, 0.1, -0.7, 0.5])
    mounting /= np.linalg.norm(mounting)
    axes = C @ np.array(matrix(*mounting)).reshape(3, 3)  # of the sensor, frame i
    star_tracker.fill(H, z, 0, np.array([1.0, 0.0, 0.0, 0.0]), NAV, mounting)
    found["star tracker"] = H.copy(), {"C_i^s": axes.T}

    light = axes @ np.array([0.2, -0.3, 0.9])
    light /= np.linalg.norm(light)
    sun_sensor.fill(H, z, 0, np.array([1.0, 0.0, 1.0, 0.0]), NAV, np.concatenate([mounting, light]))
    seen = axes.T @ light
    beside: Rows = {"s_x": np.asarray(seen[0]), "s_z": np.asarray(seen[2]), "s": column(light)}
    found["sun sensor, x axis"] = H[:1].copy(), beside | {"c_x": column(axes[:, 0]), "c_z": column(axes[:, 2])}

    field, gradient = np.array([2e-5, -3e-5, 4e-5]), 1e-11 * np.arange(9.0).reshape(3, 3)
    known = np.concatenate([field, gradient.ravel(), NAV[7:]])
    magnetometer.fill(H, z, 0, np.zeros(3), NAV, known)
    found["magnetometer"] = H.copy(), {"C_i^b": C.T, "B": column(field), "B'": gradient}

    east, north = np.array([0.6, 0.8, 0.0]), np.array([-0.8, 0.6, 0.0])
    up = np.cross(east, north)
    away = np.array([4e4, -3e4, 6e4])
    flat = float(np.hypot(away @ east, away @ north))
    known = np.concatenate([NAV[7:] - away, north, up, [0.0, 0.0, 1.0, 0.0, 7.0]])
    ground_station.fill(H, z, 0, np.zeros(3), NAV, known)
    beside = {"D": np.asarray(np.linalg.norm(away)), "L": np.asarray(flat), "D_s": column(away)}
    beside |= {"D_n": np.asarray(away @ north), "D_e": np.asarray(away @ east), "D_u": np.asarray(away @ up)}
    beside |= {"a_n": column(north), "a_e": column(east), "a_u": column(up)}
    for row, name in enumerate(("range", "azimuth", "elevation")):
        found[f"station: {name}"] = H[row : row + 1].copy(), beside
    return found


def formulas(cell: str) -> list[str]:
    return re.findall(r"\$([^$]+)\$", cell)


def test_the_printed_rows_are_those_of_the_code(root):
    heads, rows = table(root, "measurement")
    code = coded()
    assert set(rows) == set(code)
    for name, cells in rows.items():
        H, beside = code[name]
        values = symbols() | beside
        for head, cell in zip(heads[:3], cells[:3], strict=True):
            mine = H[:, STATES[head] : STATES[head] + 3]
            printed = evaluate(formulas(cell)[0], values) if cell else np.zeros(mine.shape)
            np.testing.assert_allclose(
                printed, mine, rtol=1e-10, atol=1e-13 * np.abs(H).max(), err_msg=f"{name}, {head}"
            )
        clock = [evaluate(text, values) for text in re.findall(r"\$[bd]\$: \$([^$]+)\$", cells[3])]
        assert [float(one) for one in clock] == [value for value in H[0, H_CLOCK : H_CLOCK + 1] if value != 0.0], name
        gyro = re.findall(r"gyro bias: \$([^$]+)\$", cells[3])
        mine = H[:, H_RATE : H_RATE + 3]
        printed = evaluate(gyro[0], values) if gyro else np.zeros(mine.shape)
        np.testing.assert_allclose(printed, mine, rtol=1e-10, atol=1e-14, err_msg=f"{name}, gyro bias")


def test_what_the_page_says_of_p_is_what_the_rows_are_tested_with(root):
    text = (root / "docs/theory.md").read_text(encoding="utf-8")
    assert f"p = {symbols()['printed p']}" in text


def test_the_printed_dynamics_are_the_transition_of_a_short_window(root):
    """To first order in the window; gyros with a scale factor, accelerometers with the square of the input."""
    seconds, force, rate = 1e-3, np.array([30.0, -2.0, 1.5]), np.array([0.02, -0.05, 0.01])
    sums = np.zeros(N_SUM)
    sums[SUM_C : SUM_C + 9] = C.ravel() * seconds
    sums[SUM_V : SUM_V + 3] = C @ force * seconds
    sums[SUM_TH : SUM_TH + 3], sums[SUM_F : SUM_F + 3] = rate * seconds, force * seconds
    place = NAV[7:]
    kinds = np.array(
        [transition.VEL_ATT, transition.VEL_POS, transition.POS_VEL, transition.ATT_GYRO, transition.VEL_ACCEL]
    )
    drivers = np.array([0, 0, 0, transition.OWN_0, transition.SQUARE])
    blocks = np.zeros((kinds.size, 9))
    transition.fill(blocks, kinds, drivers, sums, *place, seconds)
    xx, xy, xz, yy, yz, zz = gravity_gradient(*place)
    values: Rows = {"I": np.eye(3), "C_b^i": C, "f^i": column(C @ force), "u_g": column(rate), "u_a": column(force**2)}
    values["G"] = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    heads, rows = table(root, "derivative of")
    where = {
        ("$\\delta v$", "$\\psi$"): 0,
        ("$\\delta v$", "$\\delta r$"): 1,
        ("$\\delta r$", "$\\delta v$"): 2,
        ("$\\psi$", "$p_g$"): 3,
        ("$\\delta v$", "$p_a$"): 4,
    }
    printed = {(name, head) for name, cells in rows.items() for head, cell in zip(heads, cells, strict=True) if cell}
    assert printed == set(where)
    for name, cells in rows.items():
        for head, cell in zip(heads, cells, strict=True):
            if cell:
                mine = blocks[where[name, head]].reshape(3, 3) / seconds
                np.testing.assert_allclose(evaluate(formulas(cell)[0], values), mine, rtol=1e-12, atol=1e-15)


def test_equations_are_numbered_in_their_order(root):
    text = (root / "docs/theory.md").read_text(encoding="utf-8")
    numbers = [int(one) for one in re.findall(r"\\tag\{(\d+)\}", text)]
    assert numbers == list(range(1, len(numbers) + 1))
    assert len(re.findall(r"\$\$.*?\$\$", text, re.DOTALL)) == len(numbers)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        (r"a \times b", [[-3.0], [6.0], [-3.0]]),
        (r"[a \times] b - a \times b", [[0.0], [0.0], [0.0]]),
        (r"\frac{a \cdot b}{2^2}", 8.0),
        (r"a b^\mathsf{T}", [[4.0, 5.0, 6.0], [8.0, 10.0, 12.0], [12.0, 15.0, 18.0]]),
        (r"-(a - 2 b)", [[7.0], [8.0], [9.0]]),
        (r"\mathrm{diag}(a) b", [[4.0], [10.0], [18.0]]),
    ],
)
def test_formulas_are_evaluated_as_they_are_read(text, value):
    given = {"a": column(1.0, 2.0, 3.0), "b": column(4.0, 5.0, 6.0)}
    np.testing.assert_array_equal(evaluate(text, given), value)


@pytest.mark.parametrize("text", ["q", "a +", r"a \div b", "a ) b"])
def test_a_formula_that_cannot_be_read_is_refused(text):
    with pytest.raises(AssertionError):
        evaluate(text, {"a": column(1.0, 2.0, 3.0), "b": column(4.0, 5.0, 6.0)})
