"""The bent joint linear: against all coordinates, the torsional joint, and a simulation; the spinal engine."""

import json
import math
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from scipy import io
from scipy.spatial.transform import Rotation
from tests.experiments.rests import PlainJoint, least

from sinew.apps.cli import main
from sinew.measure.arrays import Complexes
from sinew.measure.attitude import tilt_from, torsion_of
from sinew.mechanics.space import Space
from sinew.plan.toml import load_rig
from sinew.predict.bent import INPUTS, OUTPUTS, SLOW_HZ, driven, response, servo_speed, spinal_engine, state_space
from sinew.predict.linear import linear_joints
from sinew.predict.modes import Finder, ModesRequest
from sinew.solve.march import swing
from sinew.solve.spatial import Linear, patterns, slow_down

FREQUENCIES = np.array([0.5, 2.0, 4.0, 6.0, 9.3, 11.0])
MM = 12.0


@pytest.fixture(scope="module")
def finder() -> Finder:
    """Return the paper's rig at 12 mm, straight and bent by 30°."""
    return Finder(load_rig("paper"), ModesRequest((MM,), (0.0, 30.0)))


def test_a_state_space_of_all_shapes_is_the_response_of_the_linear_equations(finder: Finder) -> None:
    linear, space = finder.linear(MM, 30)
    q = finder.at(MM, 30).coordinates
    whole = response(linear, space, q, FREQUENCIES)
    found = state_space(linear, space, q, shapes=18).response(FREQUENCIES)
    assert np.abs(found - whole).max(axis=0) == pytest.approx(np.zeros((4, 5)), abs=1e-7 * np.abs(whole).max())


def test_few_shapes_are_right_to_a_hundredth_below_the_sways(finder: Finder) -> None:
    linear, space = finder.linear(MM, 30)
    q = finder.at(MM, 30).coordinates
    low = FREQUENCIES[:4]
    whole, found = response(linear, space, q, low), state_space(linear, space, q).response(low)
    assert off(found, whole) < 0.01


def off(found: Complexes, whole: Complexes) -> float:
    """Return the largest difference of responses (frequency, output, input), of what is not all but nothing."""
    largest = np.abs(whole).max(axis=0)
    heard = largest > 1e-6 * largest.max(axis=0)
    return float((np.abs(found - whole).max(axis=0)[heard] / largest[heard]).max())


def test_files_of_a_bent_joint_give_its_response_to_other_programs(finder: Finder, tmp_path: Path) -> None:
    """Each file is read anew; the response is worked out from its matrices here, and by python-control where it is."""
    assert (
        main(["model", "paper", "--to", "control", "--pretension-mm", "12", "--bend-deg", "30", "--out", str(tmp_path)])
        == 0
    )
    linear, space = finder.linear(MM, 30)
    whole = response(linear, space, finder.at(MM, 30).coordinates, FREQUENCIES[:4])
    (told,) = json.loads((tmp_path / "transfer.json").read_text(encoding="utf-8"))["space"]
    struct = io.loadmat(tmp_path / "transfer.mat")["space"][0, 0]
    assert [str(cell[0]) for cell in struct["inputs"].ravel()] == told["inputs"] == list(INPUTS)
    assert [str(cell[0]) for cell in struct["outputs"].ravel()] == told["outputs"] == list(OUTPUTS)
    for a, b, c, d in ([np.array(told[key]) for key in "abcd"], [struct[key][0, 0] for key in "ABCD"]):
        found = [c @ np.linalg.solve(2j * np.pi * hz * np.eye(len(a)) - a, b) + d for hz in FREQUENCIES[:4]]
        assert off(np.array(found), whole) < 0.01
    try:
        import control
    except ImportError:
        return
    theirs = control.ss(*(told[key] for key in "abcd"))(2j * np.pi * FREQUENCIES[:4])
    assert np.moveaxis(theirs, -1, 0) == pytest.approx(np.array(found), rel=1e-9)


def test_a_straight_joint_without_weight_is_the_torsional_one(finder: Finder) -> None:
    rig = load_rig("paper")
    light = Finder(rig, finder.request)
    light.space = light.space._replace(weight=np.zeros(3))
    linear, space = light.linear(MM, 0)
    system = state_space(linear, space, light.at(MM, 0).coordinates)
    (plain,) = linear_joints(rig, [MM])
    mine, other = (next(p for p in one.poles() if p.s.imag > 0 and p.frequency_hz < 6) for one in (system, plain.lever))
    # The rod's own inertia, a third of its moment, is in the joint in space only.
    rod = float(space.rod.line_inertia[0]) * float(space.rod.joint.length) / 3
    slower = 1 / math.sqrt(1 + rod / (rig.inertia.head.value + rig.inertia.lever.value))
    assert mine.frequency_hz == pytest.approx(other.frequency_hz * slower, rel=5e-4)
    assert mine.damping_ratio == pytest.approx(other.damping_ratio, rel=5e-3)
    static = plain.lever.channel("torsion_rad", "torque_n_m").static_gain
    found = system.response([1e-4])[0, OUTPUTS.index("torsion_rad"), INPUTS.index("torque_n_m")]
    assert found.real == pytest.approx(static, rel=2e-3)


@pytest.mark.slow
def test_the_engine_is_what_a_simulation_of_the_same_drive_gives(finder: Finder) -> None:
    linear, space = finder.linear(MM, 30)
    q = finder.at(MM, 30).coordinates
    # Away from the resonance of torsion, and at it; there with a lever that is locked, and one that its motor holds.
    asked = ((2.6597, 1e-3, False), (4.38854, 2e-4, False), (4.38854, 2e-4, True))
    lanes = [driven_in_pitch(linear, space, hz, pull, held=held) for hz, pull, held in asked]
    every = jax.tree.map(lambda *leaves: np.stack(leaves), *lanes)
    for (hz, pull, held), seen in zip(asked, swing(every, np.stack([q] * 3), [1600] * 3, 5e-3), strict=True):
        torsion, pitch = (amplitude(angle, hz) for angle in angles(seen.rotations))
        moved, lever = driven(linear, space, q, hz, pull * np.eye(len(INPUTS))[1], held=held)
        found = [*np.abs(moved[:2]), abs(lever)]
        assert found == pytest.approx([torsion, pitch, amplitude(seen.lever, hz)], rel=0.02)


def driven_in_pitch(linear: Linear, space: Space, hz: float, pull: float, *, held: bool) -> Any:
    """Return a lane whose tendons are driven [m] while the lever stays where it is, or where its motor holds it."""
    slowed = slow_down(linear, space)
    joint = slowed.rod.joint._replace(omega=np.float64(math.tau * hz), amplitude=0.0, prescribed=float(not held))
    lane = slowed._replace(rod=slowed.rod._replace(joint=joint), pulls=pull * patterns(space)[1])
    return jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), lane)


def angles(turned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (torsion, pitch) [rad] of rotations (sample, 3, 3): twist about the head's own axis, then a swing."""
    torsion = np.arctan2(turned[:, 2, 1] - turned[:, 1, 2], turned[:, 1, 1] + turned[:, 2, 2])
    sideways = np.hypot(turned[:, 1, 0], turned[:, 2, 0])
    return torsion, -turned[:, 2, 0] * np.arctan2(sideways, turned[:, 0, 0]) / sideways


def amplitude(angle: np.ndarray, hz: float) -> float:
    """Return the amplitude of the fundamental over the last four periods of a record at 200 Hz."""
    last = slice(-round(4 * 200 / hz), None)
    time = np.arange(angle.size)[last] / 200
    table = np.stack([np.ones_like(time), np.cos(math.tau * hz * time), np.sin(math.tau * hz * time)], axis=1)
    return float(np.hypot(*np.linalg.lstsq(table, angle[last], rcond=None)[0][1:]))


def test_a_motor_takes_up_cable_as_its_torque_line_says() -> None:
    rig = load_rig("paper")
    free, half = servo_speed(rig, 0.0), servo_speed(rig, 0.5 * 3.4 / 0.0125)
    assert free == pytest.approx(math.pi * 0.0125)
    assert half == pytest.approx(0.5 * free)


def test_tendons_twist_a_bent_head_at_resonance_and_hardly_when_slow(finder: Finder) -> None:
    rig = load_rig("paper")
    torsion = finder.at(MM, 30).of("torsion")
    assert torsion is not None
    slow, resonant = (spinal_engine(finder, rig, MM, 30, hz) for hz in (SLOW_HZ, torsion.frequency_hz))
    assert slow.per_tilt < 2e-3
    assert resonant.per_tilt > 100 * slow.per_tilt
    assert resonant.take_up * 2 * math.pi * torsion.frequency_hz < servo_speed(rig, 0.0)


def test_a_motor_that_gives_way_takes_twist_from_the_engine(finder: Finder) -> None:
    rig = load_rig("paper")
    hz = finder.at(MM, 30).torsion_hz()
    held, locked = (spinal_engine(finder, rig, MM, 30, hz, locked=locked) for locked in (False, True))
    assert locked.give == 0
    assert 0 < held.give < 0.2 * held.torsion
    assert held.torsion < 0.8 * locked.torsion


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "curved"])
def test_a_slow_sideways_drive_twists_the_head_as_a_minimiser_of_the_energy_says(name: str) -> None:
    """Slowly guides hold as a spring, which the minimiser does not have: it is taken off the response."""
    rig, bend, azimuth, small = load_rig(name), math.radians(30.0), math.radians(90.0), 1e-3
    at = Finder(rig, ModesRequest((MM,), (30.0,), 90.0))
    linear, space = at.linear(MM, 30.0)
    q = at.at(MM, 30.0).coordinates
    slow = response(linear, space, q, np.array([1e-6]))[0].real
    drive, torque = INPUTS.index("roll_take_up_m"), INPUTS.index("torque_n_m")
    twist = slow[0, drive] / (1 - linear.guides * slow[0, torque])
    joint, moved = PlainJoint(rig), []
    for take_up in (-small, small):
        ends = np.asarray(space.cable_end) - take_up * np.array([1.0, 0.0, -1.0, 0.0])
        turned = joint.shape(least(joint, q.ravel(), ends, None).x)[2]
        head = Rotation.from_matrix(turned).as_quat(scalar_first=True)[None]
        moved.append((torsion_of(head)[0], tilt_from(head, bend, azimuth)[0, 1]))
    torsion, across = (np.array(moved[1]) - moved[0]) / (2 * small)
    assert twist == pytest.approx(torsion, rel=0.01)
    # As a turn of the head the tilt is more than its axis leans out of the plane of the bend, by β/sin β.
    assert slow[OUTPUTS.index("roll_rad"), drive] == pytest.approx(-across * bend / math.sin(bend), rel=0.01)
