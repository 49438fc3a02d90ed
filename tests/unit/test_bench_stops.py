"""Both stops, from every state that a run can leave a bench in; the truth is the emulated devices'."""

import math

import pytest
from tests.unit.bench_virtual import VirtualBench, set_going, virtual_bench
from tests.unit.emulator_stand_in import StandIn

from sinew.bench.stops import FREEZE_MOST_S, STAND_S, freeze, stop
from sinew.hardware.believable import STATE
from sinew.hardware.codec import Decoder, Status, encode
from sinew.hardware.registers import lay_out
from sinew.plan.plan import TendonMode
from sinew.plan.toml import load_rig

SPEC = load_rig("paper")
MODES: tuple[TendonMode, ...] = ("position", "position-with-current-limit", "current")


def powered(mode: TendonMode = "position") -> VirtualBench:
    """Return a bench under torque, its drive on the way to 30°, its tendon motors holding."""
    bench = virtual_bench(SPEC, plant=StandIn())
    set_going(bench.rig, bench.port, mode, cycles=20, drive_step=math.radians(1.5))
    return bench


def states(bench: VirtualBench) -> list[bool]:
    return [state.torque for state in bench.emulated.states().values()]


def test_a_held_lever_is_braked_with_a_fifth_of_the_output() -> None:
    # Decision 20: at a fifth of the output a swinging lever stays within about 20°.
    bench = powered()
    stop(bench.rig, bench.port, "hold")
    drive = bench.emulated.states()[SPEC.wiring.drive_id]
    assert drive.law.duty_limit == pytest.approx(0.2, abs=1.5 / 885)  # a whole count, rounded down


def test_an_emergency_while_the_tension_is_let_down_freezes_all_motors_and_then_goes_on() -> None:
    bench = powered("current")
    asked = bench.port.now() + 0.3
    frozen: list[tuple[float, bool]] = []
    report = stop(
        bench.rig,
        bench.port,
        "release",
        lambda _: frozen.append((bench.port.now() - asked, bench.emulated.frozen_since() is not None)),
        emergency_requested=lambda: bench.port.now() >= asked,
    )
    after, is_frozen = frozen[-1]
    assert (len(frozen), is_frozen, 0 < after < 0.2) == (2, True, True)
    assert bench.port.now() - asked > STAND_S
    assert (report.is_safe, any(states(bench))) == (True, False)


@pytest.mark.parametrize("state", ["hold", "release"])
def test_a_motor_stopped_by_its_watchdog_never_runs_to_its_old_goal(state: str) -> None:
    bench = powered()
    bench.port.wait_until(bench.port.now() + 0.5)  # nobody speaks: all watchdogs trip
    before = bench.emulated.states()
    assert all(motor.is_tripped for motor in before.values())
    stop(bench.rig, bench.port, state)
    bench.port.wait_until(bench.port.now() + 1.0)
    after = bench.emulated.states()
    moved = [abs(after[device].angle - before[device].angle) for device in before]
    assert max(moved) < math.radians(1.0)


@pytest.mark.parametrize("silent", [*SPEC.wiring.tendon_ids, SPEC.wiring.drive_id])
def test_a_silent_motor_does_not_keep_the_others_from_standing_at_once(silent: int) -> None:
    bench = powered()
    bench.emulated.line.devices = [device for device in bench.emulated.line.devices if device.id != silent]
    frozen = freeze(bench.rig, bench.port)
    assert frozen.names == {motor.name for motor in bench.rig.motors if motor.id != silent}
    assert frozen.took_s < FREEZE_MOST_S


def lie_once(bench: VirtualBench, register: str, count: int) -> set[int]:
    """Have every motor's first answer about its state tell another count of one register; return who has lied."""
    tables = {motor.id: motor.table for motor in bench.rig.motors}
    liars: set[int] = set()

    def disturb(at: float, data: bytes) -> list[tuple[float, bytes]]:
        (packet,) = Decoder().feed(data)
        assert isinstance(packet, Status)
        layout = lay_out(tables[packet.id], STATE) if packet.id in tables else None
        if layout is None or packet.id in liars or len(packet.params) != layout.length:
            return [(at, data)]
        liars.add(packet.id)
        row, params = tables[packet.id][register], bytearray(packet.params)
        place = row.address - layout.address
        params[place : place + row.size] = count.to_bytes(row.size, "little")
        return [(at, encode(Status(packet.id, packet.error, bytes(params))))]

    bench.emulated.line.disturb_up = disturb
    return liars


@pytest.mark.parametrize("state", ["hold", "release"])
@pytest.mark.parametrize(
    ("register", "count"),
    [("torque_enable", 0), ("present_position", 0), ("profile_velocity", 1 << 18), ("bus_watchdog", 255)],
)
def test_one_false_answer_moves_no_horn_and_leaves_no_motor_unlimited(register: str, count: int, state: str) -> None:
    bench = powered()
    before = bench.emulated.states()
    liars = lie_once(bench, register, count)
    turned = dict.fromkeys(before, 0.0)

    def look(_report: object) -> None:
        for device, motor in bench.emulated.states().items():
            turned[device] = max(turned[device], abs(motor.angle - before[device].angle))

    report = stop(bench.rig, bench.port, state, look)
    look(report)
    after = bench.emulated.states()
    assert liars == set(before)
    assert report.is_safe
    assert all(not motor.torque or motor.is_limited for motor in after.values())
    tendons = list(turned)[:-1]  # the drive is on its way to 30°; a release lets 0.02 m/s of cable go while one pulls
    assert max(turned[device] for device in tendons) < math.radians(15.0)
