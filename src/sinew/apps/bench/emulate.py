"""`sinew emulate`: a bench on a pseudo-terminal, emulated motors and sensor with the twin behind them."""

import json as json_
import math
import signal
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from sinew.apps.bench.bench_run import signals_to
from sinew.apps.bench.run_control import keeping_time
from sinew.apps.console import Json, Rig, Seed, flag, number_list, option, remark, require_file, write_json
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.emulator.faults import FaultyRig
    from sinew.emulator.found import Start
    from sinew.emulator.plant import Plant
    from sinew.emulator.port_server import Port, PtyServer
    from sinew.emulator.rig import Trip
    from sinew.plan.rig import RigSpec


def emulate(
    link: Annotated[Path, option("PATH", "Name of the port: a link to make.")],
    rig: Rig = "paper",
    baud: Annotated[int | None, option("N", "What the devices are set to; else the rig's.")] = None,
    speed: Annotated[float, option("X", "Emulated seconds in a second.", min=0.01, max=100.0)] = 1.0,
    fault: Annotated[
        list[str] | None, option("SPEC", "A fault, as drop:p=0.01 or unplug@12.5; may be repeated.")
    ] = None,
    seed: Seed = 0,
    tilt: Annotated[
        float | None, option("DEG", "Tilt of the slack head plate; else drawn, about 1.", min=0.0, max=20.0)
    ] = None,
    slack: Annotated[str | None, option("MM,...", "Cable to take up until each tendon pulls; else drawn.")] = None,
    unloaded: Annotated[bool, flag("--unloaded", "Motors on the table, without the joint.")] = False,
    in_space: Annotated[
        bool, flag("--in-space", "A head with mass on a rod that bends and sways: for plans with a [pose].")
    ] = False,
    unbuilt: Annotated[
        str | None, option("WHAT", "Wired or set wrongly, drawn by --seed: all, or some of the words below.")
    ] = None,
    supply_current: Annotated[
        bool, flag("--supply-current", "The drive's register of current tells its supply's.")
    ] = False,
    for_s: Annotated[float | None, option("S", "End after so much emulated time.", "--for", min=0.0)] = None,
    socket: Annotated[
        bool, flag("--socket", "A socket, not a terminal: for Sinew alone; keeps time on a busy computer.")
    ] = False,
    own_time: Annotated[
        bool, flag("--own-time", "Go on while Sinew's run is held up by the computer, as a real bench.")
    ] = False,
    truth: Annotated[Path | None, option("FILE", "Write at the end what truly happened, as JSON.")] = None,
    json: Json = False,
) -> None:
    """Play a bench on a pseudo-terminal, byte by byte, until interrupted.

    The line on stdout says when a master can open the port. Ctrl-C or SIGTERM end it with status 0.

    Beside the port lies PATH.clock, by which Sinew's runs share the bench's time: where the computer holds one of the
    two up, the other waits. A run that ends, or is silent for 5 s, is left to the motors' watchdogs. For other
    programs, and with --own-time, the bench keeps real time.

    SPEC is KIND[:key=value,...][@START[-STOP]], times in emulated seconds. To packets, each with probability p: drop,
    flip, duplicate, truncate, delay (by=20ms). To the bench: unplug, brown-out (to=5V), imu-freeze, imu-lose
    (share=5%), overload (motor=2), overheat (motor=3,rate=20), stuck-tendon (tendon=1), slip-tendon (tendon=2,by=1mm),
    push (torque=0.5).

    WHAT is what `sinew doctor --guide` is there for: new (motors out of the box, none plugged in), ids, double (two
    with one id), baud, tendons (two swapped), pulls (pulleys wound the other way), lever (reversed), zero, board
    (turned), with commas between; all: a rig out of its boxes. Beside the port lies PATH.hands then, where the guide
    has done what a person would do.
    """
    from sinew.emulator.faults import parse_fault  # numpy: not for --help
    from sinew.emulator.found import Hands, draw_unbuilt, drawn_start, found_bench, parse_kinds
    from sinew.emulator.port_server import ClockSocket, HandsSocket, PtyPort, PtyServer, SocketPort, refuse_taken
    from sinew.hardware.bus import MonotonicClock
    from sinew.plan.toml import load_rig

    rig_ = load_rig(rig)
    faults = [parse_fault(text) for text in fault or ()]
    start = drawn_start(rig_, seed, tilt, None if slack is None else _parse_slack(slack, rig_.tendons.count))
    refuse_taken(link)
    if truth is not None:
        require_file(truth, option="--truth")
    wrong = None if unbuilt is None else draw_unbuilt(rig_, parse_kinds(unbuilt), seed)
    bench = found_bench(
        rig_,
        start,
        seed,
        faults,
        baud=baud,
        unloaded=unloaded,
        in_space=in_space,
        unbuilt=wrong,
        tells_supply=supply_current,
    )
    shared = hands = None
    try:
        shared = None if own_time else ClockSocket(link)
        hands = None if wrong is None else HandsSocket(link, Hands(bench.rig, wrong).do)
        make_port: Callable[[Path], Port] = partial(SocketPort, host_baud=rig_.wiring.baud) if socket else PtyPort
        server = PtyServer(
            bench, link, clock=MonotonicClock(), speed=speed, make_port=make_port, shared=shared, hands=hands
        )
    except BaseException:
        for other in (shared, hands):
            if other is not None:
                other.close()
        raise
    try:
        with signals_to(lambda _: server.stop(), (signal.SIGINT, signal.SIGTERM)), keeping_time(collecting=True):
            said = _description(rig_, bench, server, start, unloaded, seed, speed)
            said["unbuilt"] = None if wrong is None else list(wrong.kinds)
            _say_ready(said | {"clock": None if shared is None else str(shared.link)}, as_json=json)
            end = math.inf if for_s is None else bench.time + for_s
            server.run(end)
        if bench.time >= end:
            remark(f"{link} ended after {for_s:g} s, as --for says; the next one knows nothing of what was done here")
    finally:
        server.close()
    if truth is not None:
        told = _truth(rig_, bench, server, unloaded, seed)
        write_json(told | {"unbuilt": None if wrong is None else wrong.document()}, truth)


def _parse_slack(text: str, count: int) -> tuple[float, ...]:
    expected = f"{count} numbers from 0 to 50 mm, one for each tendon"
    slack = number_list("--slack", text, expected, low=0, high=50)
    if len(slack) != count:
        raise SpecError(f"--slack is {text!r}, which is {len(slack)} numbers; expected {expected}")
    return tuple(slack)


def _description(
    rig: "RigSpec", bench: "FaultyRig", server: "PtyServer", start: "Start", unloaded: bool, seed: int, speed: float
) -> dict[str, Any]:
    """Return what is emulated, as the line on stdout says it."""
    return {
        "link": str(server.link),
        "terminal": server.terminal,
        "rig": rig.name,
        "plant": "unloaded" if unloaded else "joint",
        "baud": bench.rig.imu.baud,
        "devices": sorted(device.id for device in bench.line.devices),
        "seed": seed,
        "speed": speed,
        "tilt_deg": None if unloaded else [math.degrees(angle) for angle in start.tilt],
        "slack_mm": None if unloaded else [length * 1e3 for length in start.slack],
        "faults": [str(spec) for spec in bench.faults.specs],
    }


def _say_ready(said: dict[str, Any], *, as_json: bool) -> None:
    if as_json:
        print(json_.dumps(said, ensure_ascii=False, allow_nan=False))
    else:
        what = "motors without a joint" if said["plant"] == "unloaded" else "the joint on its twin"
        faults = f"; faults {', '.join(said['faults'])}" if said["faults"] else ""
        devices = f"devices {', '.join(map(str, said['devices']))} at {said['baud']} baud"
        if said["unbuilt"] is not None:
            devices = f"wrong about it: {', '.join(said['unbuilt'])}"
        print(f"{said['link']}: rig {said['rig']}, {what}, {devices}, seed {said['seed']}{faults}; Ctrl-C ends it")
    sys.stdout.flush()


def _truth(rig: "RigSpec", bench: "FaultyRig", server: "PtyServer", unloaded: bool, seed: int) -> dict[str, Any]:
    """Return how the bench was at the end, and what had happened to it."""
    motion, states = bench.rig.motion(), bench.rig.states()
    motors = [
        {
            "id": motor.id,
            "torque": motor.torque,
            "operating_mode": motor.registers["operating_mode"],
            "watchdog_tripped": motor.is_tripped,
            "hardware_error": motor.registers["hardware_error_status"],
            "temperature_c": motor.protection.temperature,
            "angle_deg": math.degrees(states[number].angle),
            "speed_deg_s": math.degrees(states[number].speed),
            "current_a": states[number].current,
        }
        for number, motor in bench.rig.motors.items()
    ]
    return {
        "rig": rig.name,
        "seed": seed,
        "time_s": bench.time,
        "clock_s_at_zero": server.clock_time(0.0),
        "slipped_s": server.slipped,
        "lost_bytes": server.lost,
        "motors": motors,
        "stopped": bench.rig.stopped(),
        "in_safe_state": bench.rig.in_safe_state(),
        "frozen_since_s": bench.rig.frozen_since(),
        "torsion_deg": math.degrees(motion.torsion),
        "tilt_deg": [math.degrees(angle) for angle in motion.tilt],
        "tension_n": list(motion.tension),
        "pretension_mm": None if unloaded else _pretension_mm(bench.rig.plant),
        "watchdog_trips": [_trip(trip) for trip in bench.rig.trips.trips],
        "instructions": bench.line.instructions,
        "group_reads": bench.line.group_reads,
        "faults": [{"time_s": each.time, "kind": each.kind, "what": each.what} for each in bench.faults.log],
    }


def _trip(trip: "Trip") -> dict[str, Any]:
    return {
        "id": trip.motor,
        "heard_s": trip.heard,
        "tripped_s": trip.tripped,
        "turned_deg": math.degrees(trip.turned),
        "instructions": trip.instructions,
        "group_reads": trip.group_reads,
    }


def _pretension_mm(plant: "Plant") -> float:
    from sinew.emulator.joint_plant import JointPlant

    assert isinstance(plant, JointPlant)
    return plant.pretension * 1e3
