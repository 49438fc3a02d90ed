"""A rig that is wired otherwise than its file says is named before it pulls or swings."""

import cmath
import math
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.unit.bench_virtual import virtual_bench

from sinew.bench.pretension import _board_advice, _refuse_astray, refuse_wrong_wiring
from sinew.emulator.bench import EmulatedRig
from sinew.measure.errors import LostError, StartError
from sinew.plan.toml import load_rig, parse_plan

SPEC = load_rig("paper")

TENSION_N = 31.47  # of each tendon at 4 mm, as the twin has it


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "neighbouring ids swapped": ({"tendon_ids": (2, 1, 3, 4)}, "tendons 1 and 2 answer to each other's commands"),
    "opposite ids swapped": ({"tendon_ids": (3, 2, 1, 4)}, "tendons 1 and 3 answer to each other's commands"),
    "pull sign": ({"tendon_pull": (1, 1, -1, 1)}, "tendon 3 has travelled"),
    "drive sign": ({"drive_sign": -1}, "wiring.drive_sign is wrong"),
    "drive zero off by 61°": ({"drive_zero_counts": 2048 + round(61 / 360 * 4096)}, "correct wiring.drive_zero_counts"),
    "board turned by 90°": ({"imu_axes": ("+x", "+z", "-y")}, "the board is turned about x"),
    "board turned by 180°": ({"imu_axes": ("+x", "-y", "-z")}, "the board is turned about x"),
}
"""What is wrong in the rig's wiring, and how it is named."""


class Watcher:
    """Notes the largest tension [N], and how far the lever went [rad]."""

    tension = lever = 0.0

    def __init__(self, emulated: EmulatedRig) -> None:
        self.emulated = emulated

    def on_sample(self, _: object) -> None:
        motion = self.emulated.motion()
        self.tension = max(self.tension, *motion.tension)
        self.lever = max(self.lever, abs(motion.drive.angle))

    def on_event(self, _: object) -> None:
        pass


def play(wiring: dict[str, Any], mode: str, seed: int, folder: Path) -> tuple[str, Watcher]:
    """Run a bench that is wired as the paper's with a rig whose wiring is another, and return how that ended."""
    rng = np.random.default_rng(seed)
    slack, lean = rng.uniform(2e-4, 3e-3, SPEC.tendons.count).tolist(), rng.normal(0.0, 0.015, 2)
    told = SPEC.model_copy(update={"wiring": SPEC.wiring.model_copy(update=wiring)})
    bench = virtual_bench(SPEC, slack_m=slack, rest_tilt=(float(lean[0]), float(lean[1])), seed=seed, told=told)
    watcher = Watcher(bench.emulated)
    plan = parse_plan(
        f'name = "wrong"\n[pretension]\npretension_mm = [4.0]\nmode = "{mode}"\nrest_s = 0.3\n'
        "[sweep]\nfrequency_hz = [3.5]\nsettle_s = 0.3\nperiods = 2\nrepeats = 1"
    )
    try:
        return bench.run(plan, folder, {4.0: TENSION_N}, listener=watcher).sentence, watcher
    except StartError as refusal:
        return str(refusal), watcher


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_rig_is_named_before_the_lever_moves_and_pulls_no_more_than_the_twin(name: str, tmp_path: Path) -> None:
    wiring, sentence = WRONG[name]
    said, watcher = play(wiring, "position", 0, tmp_path)
    assert sentence in said
    assert watcher.tension <= 1.3 * TENSION_N
    assert math.degrees(watcher.lever) <= (3.5 if name == "drive sign" else 0.5)  # its sign is found by a move of 3°


class SwayingPlate:
    """A plate that rises as horns turn back, by an order of ids, or a turned board, and sways at 3 Hz.

    It is a loop as far as the wiring is looked at: the gyroscope shows the tilt's rate, the accelerometer the tilt and
    the sway's acceleration, four times as large at the height of the paper's head.
    """

    period, pulley_radius = 0.005, SPEC.tendons.pulley_radius.value

    def __init__(self, order: tuple[int, ...], *, turn: complex = 1, sway_deg: float = 0.0) -> None:
        self.order, self.turn = order, turn
        self.sway, self.time, self.tilt = math.radians(sway_deg), 0.0, 0j
        self.watch = SimpleNamespace(goals=(0.0,) * 4)

    def set_goals(self, goals: Sequence[float]) -> None:
        self.watch.goals = tuple(goals)

    def cycle(self) -> Any:
        gives = [max(0.0, -goal) * self.pulley_radius / SPEC.tendons.head_radius.value for goal in self.watch.goals]
        highest = sum(give * 1j ** self.order[i] * self.turn for i, give in enumerate(gives))
        swayed = self.sway * math.exp(-self.time) * cmath.exp(2j * math.pi * 3.0 * self.time)
        self.time += self.period
        before, self.tilt = self.tilt, -1j * (highest + swayed)
        rate, told = (self.tilt - before) / self.period, -1j * (highest + 4 * swayed)
        acceleration = (9.81, -9.81 * told.imag, 9.81 * told.real)
        return SimpleNamespace(
            tendon_rad=(0.0,) * 4, gyro_rad_s=(0.0, rate.real, rate.imag), acceleration_m_s2=acceleration
        )

    def run(self, duration: float) -> list[Any]:
        return [self.cycle() for _ in range(round(duration / self.period))]


def look_at(plate: SwayingPlate) -> None:
    refuse_wrong_wiring(cast("Any", plate), cast("Any", SimpleNamespace(spec=SPEC)), (0.16,) * 4)


WIRED = (0, 1, 2, 3)


@pytest.mark.parametrize("sway_deg", [0.0, 1.0, 20.0])
def test_a_right_wiring_is_not_accused_however_the_head_sways(sway_deg: float) -> None:
    look_at(SwayingPlate(WIRED, sway_deg=sway_deg))


@pytest.mark.parametrize("sway_deg", [0.0, 1.0])
@pytest.mark.parametrize(("order", "named"), [((1, 0, 2, 3), "1 and 2"), ((0, 3, 2, 1), "2 and 4")])
def test_swapped_ids_are_named_though_the_head_sways_at_first(
    order: tuple[int, ...], named: str, sway_deg: float
) -> None:
    with pytest.raises(LostError, match=f"tendons {named} answer to each other's commands"):
        look_at(SwayingPlate(order, sway_deg=sway_deg))


@pytest.mark.parametrize(("turn", "degrees"), [(1j, 90), (-1, 180), (-1j, 90)])
def test_a_turned_board_is_named_though_the_head_sways_at_first(turn: complex, degrees: int) -> None:
    with pytest.raises(LostError, match=f"rises {degrees}° beside it: the board is turned about x"):
        look_at(SwayingPlate(WIRED, turn=turn, sway_deg=1.0))


def test_ids_that_went_round_are_named() -> None:
    with pytest.raises(LostError, match="tendons 1, 2 and 3 answer to each other's commands"):
        look_at(SwayingPlate((2, 0, 1, 3)))


def test_a_head_plate_that_never_moves_has_no_sensor_on_it() -> None:
    with pytest.raises(LostError, match="is the sensor on it"):
        look_at(SwayingPlate(WIRED, turn=0))


@pytest.mark.parametrize("axes", [("+x", "+z", "-y"), ("+x", "-y", "-z"), ("+x", "-z", "+y")])
def test_the_advice_for_a_turned_board_is_the_frame_that_it_has(axes: tuple[str, ...]) -> None:
    # The rig says axes, the chip lies along its own: what y and z of the head are is shown turned by that angle.
    quarter = {"+z": 3, "-y": 2, "-z": 1}[axes[1]]
    assert "['+x', '+y', '+z']" in _board_advice(quarter, axes)


ONE, ENOUGH = math.radians(1.0), math.radians(0.2)


def test_a_correction_as_large_as_the_tilt_that_leaves_it_there_ends_levelling() -> None:
    # A right rig tilts back by at least 0.75 of its correction, so that 1.4 times the tilt leaves nothing.
    with pytest.raises(LostError, match=r"tilted by 1.00°, 1.00° before, though its tendons were corrected by 1.40°"):
        _refuse_astray(ONE, ONE, 1.4 * ONE, ENOUGH)


@pytest.mark.parametrize(("left", "corrected"), [(1.0, 0.9), (0.4, 1.4), (0.19, 9.0)])
def test_a_tilt_that_falls_or_was_hardly_corrected_goes_on_being_levelled(left: float, corrected: float) -> None:
    _refuse_astray(left * ONE, ONE, corrected * ONE, ENOUGH)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_right_rig_is_not_accused_nor_nearly(seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def watched(tilt: float, first: float, corrected: float, accepted: float) -> None:
        assert tilt <= max(accepted, 0.5 * first) or corrected < 1.1 * max(first, accepted)

    monkeypatch.setattr("sinew.bench.pretension._refuse_astray", watched)
    assert "groups are recorded" in play({}, "current" if seed % 2 else "position", seed, tmp_path)[0]
