"""A joint built from docs/explanation/physics.md alone moves as the twin does.

The rebuild takes its numbers from the page's tables and its equations from the page's text, is integrated by SciPy, and
imports nothing of Sinew; the twin is imported for the comparison alone.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

Floats = NDArray[np.float64]

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "physics.md"
SI = {"mm": 1e-3, "ms": 1e-3, "rpm": 2 * np.pi / 60}
POINTS = [
    (p, round(f + away, 2)) for p, f in ((0, 3.05), (3, 3.3), (6, 3.6), (9, 3.9), (12, 4.3)) for away in (-0.5, 0, 0.6)
]


def rows(name: str) -> list[list[str]]:
    """Return the cells of a marked table of the page."""
    text = PAGE.read_text(encoding="utf-8").split(f"<!-- table: {name} -->")[1].strip().split("\n\n")[0]
    return [[cell.strip().strip("`") for cell in line.strip("|").split("|")] for line in text.splitlines()[2:]]


def numbers() -> dict[str, float]:
    return {row[0]: float(row[2]) * SI.get(row[3], 1.0) for row in rows("rig")}


class Rebuilt:
    """The joint of the page at several pretensions [m] and drive frequencies [Hz], each of shape (lane,)."""

    def __init__(self, pretension: Floats, frequency: Floats) -> None:
        n = numbers()
        self.n, self.omega = n, 2 * np.pi * frequency
        branches = [[float(cell) for cell in row] for row in rows("branches")]
        self.tau = np.array([1 / (2 * np.pi * row[1]) for row in branches])[:, None]
        self.share = np.array([row[2] for row in branches])[:, None]
        polar, area = np.pi * n["d"] ** 4 / 32, np.pi * n["d"] ** 2 / 4
        self.ga = n["GJ"] / polar * area
        self.kt = 1 / (1 / n["k_c"] + 1 / n["k_s"])
        contact = brentq(lambda x: self._silicone_slope(x) + 4 * n["T_0"] * self._span(0.0, x)[1], 0.0, 0.03)
        self.slack = self._span(0.0, contact)[0] - n["T_0"] / self.kt - pretension
        self.rest = np.array([self._rest(slack) for slack in self.slack])

    def _silicone_slope(self, x: float) -> float:
        stretch = 1 - x / self.n["L"]
        return float(-0.5 * self.ga * (2 * stretch - 2 / stretch**2))

    def _span(self, torsion, x):  # type: ignore[no-untyped-def]
        """Return a tendon's length and its derivatives by shortening and torsion."""
        n = self.n
        along = n["L_t"] - x
        square = along**2 + n["r_b"] ** 2 + n["r_h"] ** 2 - 2 * n["r_b"] * n["r_h"] * np.cos(torsion)
        length = np.sqrt(square)
        return length, -along / length, n["r_b"] * n["r_h"] * np.sin(torsion) / length

    def _rest(self, slack: float) -> float:
        def slope(x: float) -> float:
            length, by_x, _ = self._span(0.0, x)
            return self._silicone_slope(x) + 4 * self.kt * max(0.0, length - slack) * by_x

        return float(brentq(slope, 0.0, 0.04))

    def rate(self, time: float, flat: Floats) -> Floats:
        n = self.n
        torsion, speed, x, sinking, lever, turning, z, *memory = flat.reshape(15, -1)
        twisted, sunk = np.array(memory[:4]), np.array(memory[4:])
        stretch = 1 - x / n["L"]
        length, by_x, by_torsion = self._span(torsion, x)
        tension = self.kt * np.maximum(0.0, length - self.slack)
        stiffness = n["GJ"] / (n["L"] * stretch)
        softer = n["GJ"] / (n["L"] * stretch) ** 2  # of the stiffness, by shortening: +GJ/(L² λ²)
        away = torsion - twisted
        torque = -stiffness * (torsion + (self.share * away).sum(axis=0)) - 4 * tension * by_torsion
        torque = torque - n["mu"] * 4 * tension * z
        axial = -0.5 * self.ga * (2 * stretch - 2 / stretch**2) + 4 * tension * by_x
        axial = axial + 0.5 * softer * (torsion**2 + (self.share * away**2).sum(axis=0))
        axial = axial + 3 * self.ga / n["L"] * (self.share * (x - sunk)).sum(axis=0)
        command = np.radians(20.0) * np.sin(self.omega * time)
        duty = np.clip(n["K_p"] * (command - lever), -n["d_max"], n["d_max"])
        horn = (n["M_s"] + n["M_f"]) * n["U"] / n["U_n"] * duty - n["M_s"] / n["w_0"] * turning
        horn = horn - n["M_f"] * np.tanh(turning / n["w_s"])
        a, b, c = n["I_h"] + n["I_l"], n["I_l"], n["I_l"] + n["J_a"]
        whole = a * c - b * b
        moved = (c * torque - b * horn) / whole, (a * horn - b * torque) / whole
        gripping = (speed - np.abs(speed) * z) / n["phi_s"]
        rates = [speed, moved[0], sinking, -axial / n["m_h"], turning, moved[1], gripping]
        return np.concatenate([*rates, *((torsion - twisted) / self.tau), *((x - sunk) / self.tau)])

    def steady(self) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the complex fundamentals of torsion and lever over five periods after 3 s, (lane,) each."""
        zero = np.zeros(self.rest.size)
        start = np.concatenate([zero, zero, self.rest, *[zero] * 8, *[self.rest] * 4])
        last = 3.0 + 5 / (self.omega.min() / (2 * np.pi)) + 0.01
        found = solve_ivp(self.rate, (0.0, last), start, method="RK45", rtol=1e-6, atol=1e-8, dense_output=True)
        answers = []
        for lane, omega in enumerate(self.omega):
            time = np.arange(600, 600 + round(200 * 5 * 2 * np.pi / omega)) / 200
            states = found.sol(time).reshape(15, self.rest.size, -1)
            answers.append([fundamental(omega, time, states[row, lane]) for row in (0, 4)])
        both = np.array(answers)
        return both[:, 0], both[:, 1]


def fundamental(omega: float, time: Floats, values: Floats) -> complex:
    """Return the complex amplitude against sin ωt, by least squares with an offset."""
    design = np.stack([np.sin(omega * time), np.cos(omega * time), np.ones(time.size)], axis=1)
    sine, cosine, _ = np.linalg.lstsq(design, values, rcond=None)[0]
    return complex(sine, cosine)


@pytest.mark.slow
def test_a_joint_built_from_the_page_alone_has_the_twins_gain_and_phase() -> None:
    from sinew.plan.plan import Group
    from sinew.plan.toml import load_rig
    from sinew.twin.simulate import lane_parameters, simulate_tracks

    pretension, frequency = np.array(POINTS, dtype=float).T
    torsion, lever = Rebuilt(pretension * 1e-3, frequency).steady()
    groups = [Group("steady", p, f, 20.0, 0, 3.0, 5 / f) for p, f in zip(pretension, frequency, strict=True)]
    tracks = simulate_tracks(lane_parameters(groups, load_rig("paper")), groups, 200.0)
    for track, group, mine, mine_lever in zip(tracks, groups, torsion, lever, strict=True):
        time, omega = np.arange(600, track.torsion.size) / 200, 2 * np.pi * group.frequency_hz
        theirs, their_lever = (fundamental(omega, time, values[600:]) for values in (track.torsion, track.lever))
        here = f"{group.pretension_mm:g} mm, {group.frequency_hz:g} Hz"
        assert abs(mine) == pytest.approx(abs(theirs), rel=2e-3), here
        assert abs(mine / mine_lever) == pytest.approx(abs(theirs / their_lever), rel=2e-3), here
        assert abs(np.degrees(np.angle(mine / theirs))) < 0.2, here
        assert abs(np.degrees(np.angle(mine / mine_lever / (theirs / their_lever)))) < 0.2, here


def test_the_pages_numbers_are_those_of_the_shipped_rig() -> None:
    from sinew.mechanics.drive import SLIDING_SPEED
    from sinew.mechanics.silicone import prony_shares, relaxation_times
    from sinew.plan.toml import load_rig

    rig = load_rig("paper")
    parameters, found = dict(rig.parameters()), numbers()
    for symbol, _, _, _, name in rows("rig"):
        expected = SLIDING_SPEED if name == "fixed" else parameters[name].value
        assert found[symbol] == pytest.approx(expected, rel=1e-9), symbol
    _, corners, shares = np.array([[float(cell) for cell in row] for row in rows("branches")]).T
    assert corners == pytest.approx(1 / (2 * np.pi * relaxation_times()), rel=1e-6)
    assert shares == pytest.approx(prony_shares(rig.silicone.loss_factor.value), rel=1e-6)


def test_no_number_of_the_rebuild_comes_from_sinew() -> None:
    source = Path(__file__).read_text(encoding="utf-8").split("@pytest.mark.slow")[0]
    assert not re.search(r"^\s*(from|import) sinew", source, re.MULTILINE)
