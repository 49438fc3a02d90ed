"""The emulated inertial sensor: its samples, its clock, and what it does not know."""

import math
import statistics

import numpy as np
import pytest
from tests.unit.emulator_stand_in import StandIn, paper_rig

from sinew.emulator.device import ImuNode
from sinew.hardware.registers import OPENCR_NODE, decode
from sinew.plan.rig import Imu

GYRO_LSB, FORCE_LSB = math.radians(2000) / 32_768, 2 * 9.80665 / 32_768


def chip(**values: float) -> Imu:
    """Return the paper's sensor without noise, bias and dead band, but for `values`."""
    quiet = {"gyro_noise": 0.0, "gyro_bias": 0.0, "accelerometer_noise": 0.0, **values}
    imu = paper_rig().imu
    whole = {name: int(quiet.pop(name)) for name in ("average_samples", "dead_band") if name in quiet}
    rows = {name: getattr(imu, name).model_copy(update={"value": value}) for name, value in quiet.items()}
    return imu.model_copy(update={"dead_band": 0, **whole, **rows})


class Node:
    """A sensor on a plant, looked at when a test likes to."""

    def __init__(self, imu: Imu, *, seed: int = 0, **more: object) -> None:
        self.plant = StandIn()
        self.imu = ImuNode(imu, self.plant, np.random.default_rng(seed), **more)  # type: ignore[arg-type]

    def run(self, until: float) -> None:
        while self.imu.due <= until:
            due = self.imu.due
            self.plant.advance(due)
            self.imu.advance(due)
        self.plant.advance(until)

    def get(self, *names: str) -> list[float]:
        start, length = OPENCR_NODE.block(names)
        answer = self.imu.answer(start, length, self.plant.time)
        assert answer is not None
        rows = [OPENCR_NODE[name] for name in names]
        return [decode(row, answer.params[row.address - start : row.stop - start]) for row in rows]


def gyro(node: Node) -> list[float]:
    return node.get("gyro_x", "gyro_y", "gyro_z")


def test_the_accelerometer_clips_at_two_g() -> None:
    node = Node(chip())
    node.plant.acceleration = (0.0, 30.0, -30.0)
    node.run(0.1)
    found = node.get("acceleration_y", "acceleration_z")
    assert found == pytest.approx([2 * 9.80665, -2 * 9.80665], abs=2 * FORCE_LSB)


def test_the_gyro_clips_at_its_range() -> None:
    node = Node(chip())
    node.plant.gyro = (50.0, -50.0, 0.0)
    node.run(0.1)
    assert gyro(node)[:2] == pytest.approx([math.radians(2000), -math.radians(2000)], abs=2 * GYRO_LSB)


@pytest.mark.parametrize(("counts", "shown"), [(3, 0), (4, 4), (-3, 0), (-4, -4)])
def test_readings_of_at_most_the_dead_band_are_zero(counts: int, shown: int) -> None:
    node = Node(chip(dead_band=3))
    node.plant.gyro = (counts * GYRO_LSB, 0.0, 0.0)
    node.run(0.1)
    assert gyro(node)[0] == pytest.approx(shown * GYRO_LSB)


def test_a_reading_is_the_mean_of_the_newest_samples() -> None:
    node = Node(chip(average_samples=3))
    node.run(0.1)
    readings = []
    node.plant.gyro = (0.9, 0.0, 0.0)
    for _ in range(4):
        due = node.imu.due
        node.run(due + 1e-3)
        readings.append(gyro(node)[0])
    assert readings == pytest.approx([0.3, 0.6, 0.9, 0.9], abs=GYRO_LSB)


def test_a_reading_appears_after_the_chips_residual_delay() -> None:
    node = Node(chip(average_samples=1, residual_delay=1e-3))
    node.run(0.1)
    node.plant.gyro = (1.0, 0.0, 0.0)
    due = node.imu.due
    node.run(due + 0.9e-3)
    early = gyro(node)[0]
    node.run(due + 1.1e-3)
    assert (early, gyro(node)[0]) == (0.0, pytest.approx(1.0, abs=GYRO_LSB))


def test_clock_less_sample_time_is_the_age_of_the_sample() -> None:
    node = Node(chip(residual_delay=1e-3), ppm=0.0)
    due = node.imu.due
    node.run(due + 4e-3)
    sample, clock = node.get("sample_time", "clock")
    assert clock - sample == pytest.approx(3e-3, abs=2e-6)


@pytest.mark.parametrize("ppm", [-100.0, 0.0, 50.0])
def test_samples_come_at_200_hz_by_the_nodes_own_crystal(ppm: float) -> None:
    node = Node(chip(), ppm=ppm)
    first = node.imu.due
    node.run(first + 99.9975)
    taken = (node.imu.due - first) / 5e-3 * (1 + 1e-6 * ppm)
    assert taken == pytest.approx(20_000, abs=3)
    assert node.imu.clock(100.0) - node.imu.clock(0.0) == pytest.approx(100 * (1 + 1e-6 * ppm), abs=1e-9)


@pytest.mark.parametrize(
    ("low_pass", "residual_ms", "told"), [(41.0, 0.4103, (0x71, 5.9e-3)), (72.4, 0.0, (0xE0, 3.109e-3))]
)
def test_the_node_is_the_chip_whose_filter_is_the_rigs(
    low_pass: float, residual_ms: float, told: tuple[int, float]
) -> None:
    node = Node(chip(low_pass=low_pass, residual_delay=1e-3 * residual_ms))
    assert node.get("who_am_i", "filter_delay") == pytest.approx(told, rel=1e-3)


def test_the_bias_is_drawn_once_and_stays() -> None:
    node = Node(chip(gyro_bias=0.1), seed=3)
    node.run(0.1)
    before = gyro(node)
    node.run(60.0)
    assert gyro(node) == before
    assert max(map(abs, before)) > 0.01


@pytest.mark.parametrize(("average", "within"), [(1, 0.06), (3, 0.09)])  # 4 standard errors
def test_the_noise_of_a_mean_of_samples_is_the_specs_over_the_root_of_their_number(average: int, within: float) -> None:
    node = Node(chip(gyro_noise=0.05, average_samples=average))
    values = []
    for _ in range(2000 if average == 1 else 3000):
        node.run(node.imu.due + 1e-3)
        values.append(gyro(node)[0])
    assert statistics.stdev(values[::average]) == pytest.approx(0.05 / math.sqrt(average), rel=within)
