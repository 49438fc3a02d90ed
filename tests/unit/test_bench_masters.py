"""What another program does to the motors, or a bus watchdog, is seen while a group runs and not only at its end."""

from collections.abc import Callable

import pytest
from tests.unit.bench_virtual import VirtualBench, virtual_bench
from tests.unit.emulator_stand_in import StandIn

from sinew.bench.guard import Guard, Watch
from sinew.bench.loop import WATCHDOG_S, Loop
from sinew.bench.preflight import refuse_unready
from sinew.bench.tilt import TiltEstimator
from sinew.hardware import codec as ask
from sinew.hardware.codec import encode
from sinew.measure.errors import LostError, StartError
from sinew.plan.plan import TendonMode
from sinew.plan.toml import load_rig, parse_plan

SPEC = load_rig("paper")
PLAN = parse_plan('name = "x"\n[pretension]\npretension_mm = [2]\n[sweep]\nfrequency_hz = [3.4]')
TURN = 10  # cycles: of five motors one tells its climate, and then its orders


def running(mode: TendonMode = "position") -> tuple[VirtualBench, Loop]:
    """Return a bench under torque and its loop, after two turns of all motors."""
    bench = virtual_bench(SPEC, plant=StandIn())
    rig = bench.rig
    rig.configure()
    rig.set_tendon_mode(mode)
    for motor in rig.motors:
        motor.arm_watchdog(WATCHDOG_S)
        motor.torque_on()
    loop = Loop(rig, bench.port, Guard(SPEC), TiltEstimator(SPEC), 0.005, lambda _: None)
    angles = rig.stand()
    loop.watch = Watch(angles, angles if mode != "current" else (0.0,) * 4, by_current=mode == "current")
    loop.restart()
    loop.run(2 * TURN * loop.period)
    return bench, loop


def watchdog_trips(bench: VirtualBench) -> None:
    bench.emulated.motors[3].registers["bus_watchdog"] = -1


def watchdog_is_made_patient(bench: VirtualBench) -> None:
    bench.emulated.motors[5].registers["bus_watchdog"] = 100


def duty_is_widened(bench: VirtualBench) -> None:
    bench.emulated.motors[2].registers["goal_pwm"] = 500


@pytest.mark.parametrize("mode", ["position", "position-with-current-limit", "current"])
@pytest.mark.parametrize(
    ("happens", "said"),
    [
        (watchdog_trips, "the bus watchdog has stopped tendon 3"),
        (watchdog_is_made_patient, r"bus_watchdog of drive \(id 5\) reads 100, 4 when the run set it"),
        (duty_is_widened, r"goal_pwm of tendon 2 \(id 2\) reads 500, 885 when"),
    ],
)
def test_a_register_that_somebody_changes_ends_a_run_within_two_turns(
    happens: Callable[[VirtualBench], None], said: str, mode: TendonMode
) -> None:
    bench, loop = running(mode)
    happens(bench)
    with pytest.raises(LostError, match=said):
        loop.run((2 * TURN + 1) * loop.period)


@pytest.mark.parametrize("mode", ["position", "position-with-current-limit", "current"])
def test_goals_of_this_program_are_nobody_elses(mode: TendonMode) -> None:
    _, loop = running(mode)
    for step in range(8 * TURN):
        loop.set_goals([0.001 * step if mode != "current" else 0.01] * 4)
        loop.cycle(lambda time: 0.1 * (time % 0.2))


def test_a_goal_that_another_program_has_written_is_seen() -> None:
    bench, loop = running()
    drive = bench.emulated.motors[5]
    drive.loses, drive.registers["goal_position"] = {"goal_position"}, 2200  # ours come before the other's each time
    with pytest.raises(LostError, match=r"drive \(id 5\) holds goal_position 2200, which this program has not told it"):
        loop.run((2 * TURN + 1) * loop.period)


def overheard(bench: VirtualBench, packet: bytes, every: int) -> None:
    """Have the port hear, with every so many answers, what another master sends."""
    read, count = bench.port.read, 0

    def hears(deadline: float) -> bytes:
        nonlocal count
        data = read(deadline)
        count += bool(data)
        return packet + data if data and count % every == 0 else data

    bench.port.read = hears  # type: ignore[method-assign]


def test_another_master_on_the_line_ends_a_run() -> None:
    bench, loop = running()
    overheard(bench, encode(ask.ping(3)), 20)
    with pytest.raises(LostError, match="instructions of another program came on the line"):
        loop.run(0.5)


def test_an_adapter_that_returns_what_is_sent_is_no_other_master() -> None:
    bench, loop = running()
    bench.emulated.line.echoes = True
    loop.run(0.2)
    assert (bench.rig.bus.others, bench.rig.bus.statistics.echoes > 0) == (0, True)


def test_a_run_does_not_start_on_a_line_where_another_program_speaks() -> None:
    bench = virtual_bench(SPEC, plant=StandIn())
    read, spoken = bench.port.read, iter([b"", encode(ask.ping(3)), encode(ask.ping(4))])
    bench.port.read = lambda deadline: next(spoken, None) or read(deadline)  # type: ignore[method-assign]
    with pytest.raises(StartError, match=r"2 packets come on the line .* though nothing was sent"):
        refuse_unready(bench.rig, bench.port, PLAN)
