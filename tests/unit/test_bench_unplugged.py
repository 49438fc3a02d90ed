"""A cable pulled out in the middle of a swing, in virtual time: who stops the motors, and when."""

import math
from typing import NamedTuple

import pytest
from tests.unit.bench_virtual import virtual_bench

from sinew.bench.loop import WATCHDOG_S
from sinew.bench.record.journal import Journal
from sinew.bench.record.sample import Sample
from sinew.bench.run import Runner, RunReport
from sinew.emulator.bench import EmulatedRig
from sinew.plan.toml import dump_plan, dump_rig, load_rig, parse_plan
from sinew.twin.simulate import rest_tension

RIG = load_rig("paper")
PLAN = parse_plan("""
name = "unplugged"
pretension = { pretension_mm = [2], rest_s = 0.5 }
sweep = { frequency_hz = [3], repeats = 1 }
""")
SWINGS = 200  # samples, a second: three swings at full amplitude


class Puller:
    """Pulls the cable out a second after the lever has begun to swing; a Listener."""

    def __init__(self, bench: EmulatedRig) -> None:
        self._bench = bench
        self._swinging = 0

    def on_sample(self, sample: Sample) -> None:
        self._swinging += sample.drive_command_rad != 0.0 and abs(sample.drive_rad) > 0.1
        if self._swinging == SWINGS:
            self._bench.unplugged = True

    def on_event(self, event: object) -> None:
        pass


class Pulled(NamedTuple):
    """report: of the run. last_byte: when it had come to the motors [s]. goal: of the lever when the cable went [rad].

    tripped: when each watchdog had stopped its motor [s], by id. travel: how far its horn went after that [rad].
    """

    report: RunReport
    last_byte: float
    goal: float
    tripped: dict[int, float]
    travel: dict[int, float]
    bench: EmulatedRig


@pytest.fixture(scope="module")
def pulled(tmp_path_factory: pytest.TempPathFactory) -> Pulled:
    virtual = virtual_bench(RIG)
    bench, tension = virtual.emulated, dict(zip([2.0], rest_tension([2.0], RIG).tolist(), strict=True))
    path = tmp_path_factory.mktemp("pulled") / "journal.sqlite"
    with Journal.create(path, dump_plan(PLAN), dump_rig(RIG)) as journal:
        report = Runner(virtual.rig, virtual.port, PLAN, journal, tension, listener=Puller(bench)).run()
    last_byte = virtual.rig.bus.left_wire
    goal = bench.motors[5].servo.law.goal
    tripped: dict[int, float] = {}
    caught: dict[int, float] = {}
    travel = dict.fromkeys(bench.motors, 0.0)
    while bench.time < last_byte + 3.0:
        bench.advance(bench.time + 1e-3)
        for device, state in bench.states().items():
            if state.is_tripped:
                tripped.setdefault(device, bench.time)
                travel[device] = max(travel[device], abs(state.angle - caught.setdefault(device, state.angle)))
    return Pulled(report, last_byte, goal, tripped, travel, bench)


def test_the_run_ends_with_a_sentence_that_names_the_port_and_the_bench_is_safe_three_seconds_later(
    pulled: Pulled,
) -> None:
    stop = pulled.report.stop
    assert pulled.report.sentence == "the port is gone; plug it in again"
    assert stop is not None
    assert (stop.is_safe, stop.port_lost) == (False, True)
    assert pulled.bench.in_safe_state()
    assert abs(pulled.goal) > math.radians(3.0)  # it went in the middle of a swing


def test_every_watchdog_stops_its_motor_in_its_time_and_within_100_ms_of_the_last_byte(pulled: Pulled) -> None:
    assert set(pulled.tripped) == set(pulled.bench.motors)
    assert min(pulled.tripped.values()) - pulled.last_byte >= WATCHDOG_S
    assert max(pulled.tripped.values()) - pulled.last_byte < 0.1


def test_what_moves_after_that_is_the_joint_on_its_springs(pulled: Pulled) -> None:
    tendons = [pulled.travel[device] for device in (1, 2, 3, 4)]
    assert 1e3 * max(tendons) * RIG.tendons.pulley_radius.value < 0.5  # mm of cable
    assert pulled.travel[5] < math.radians(6.0)
