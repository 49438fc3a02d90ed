"""`sinew emulate`: a bench on a pseudo-terminal, emulated motors and sensor with the twin behind them."""

import json as json_
import math
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from sinew.apps.bench.bench_run import signals_to
from sinew.apps.bench.run_control import keeping_time
from sinew.apps.console import Json, Rig, Seed, flag, number_list, option, remark, require_file, write_json
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.emulator.bench import EmulatedRig, Start
    from sinew.emulator.port_server import PtyServer


def emulate(
    link: Annotated[Path, option("PATH", "Name of the port: a link to make.")],
    rig: Rig = "paper",
    baud: Annotated[int | None, option("N", "What the devices are set to; else the rig's.")] = None,
    fault: Annotated[
        list[str] | None, option("SPEC", "A fault, as drop:p=0.01 or unplug@12.5; may be repeated.")
    ] = None,
    seed: Seed = 0,
    tilt: Annotated[
        float | None, option("DEG", "Tilt of the slack head plate; else drawn, about 1.", min=0.0, max=20.0)
    ] = None,
    slack: Annotated[str | None, option("MM,...", "Cable to take up until each tendon pulls; else drawn.")] = None,
    in_space: Annotated[
        bool, flag("--in-space", "A head with mass on a rod that bends and sways: for plans with a [pose].")
    ] = False,
    new: Annotated[bool, flag("--new", "Motors out of their boxes, none plugged in, the lever anywhere.")] = False,
    supply_current: Annotated[
        bool, flag("--supply-current", "The drive's register of current tells its supply's.")
    ] = False,
    for_s: Annotated[float | None, option("S", "End after so much emulated time.", "--for", min=0.0)] = None,
    own_time: Annotated[
        bool, flag("--own-time", "Go on while Sinew's run is held up by the computer, as a real bench.")
    ] = False,
    truth: Annotated[Path | None, option("FILE", "Write at the end what truly happened, as JSON.")] = None,
    json: Json = False,
) -> None:
    """Play a bench on a pseudo-terminal, until interrupted.

    It answers byte by byte as a bench does. The line on stdout says when a master can open the port. Ctrl-C or
    SIGTERM end it with status 0.

    Beside the port lies PATH.clock, by which Sinew's runs share the bench's time: where the computer holds one of the
    two up, the other waits. A run that ends, or is silent for 5 s, is left to the motors' watchdogs. For other
    programs, and with --own-time, the bench keeps real time.

    SPEC is KIND[:key=value,...][@START[-STOP]], times in emulated seconds. To packets, each with probability p: drop,
    flip, duplicate, truncate, delay (by=20ms). To the bench: unplug, brown-out (to=5V), imu-freeze, imu-lose
    (share=5%), overload (motor=2), overheat (motor=3,rate=20), stuck-tendon (tendon=1), slip-tendon (tendon=2,by=1mm),
    push (torque=0.5).

    For `sinew doctor --guide`: the bench is wired as the rig's file says, so a file with another [wiring] is a bench
    that is wired otherwise than the guide is told. What the guide asks of a person, the emulated bench does itself;
    with --own-time nobody does.
    """
    from sinew.emulator.bench import drawn_start, emulated_bench
    from sinew.emulator.faults import parse_fault  # numpy: not for --help
    from sinew.emulator.port_server import ClockSocket, PtyServer, refuse_taken
    from sinew.hardware.bus import MonotonicClock
    from sinew.plan.toml import load_rig

    rig_ = load_rig(rig)
    faults = [parse_fault(text) for text in fault or ()]
    start = drawn_start(rig_, seed, tilt, None if slack is None else _parse_slack(slack, rig_.tendons.count))
    refuse_taken(link)
    if truth is not None:
        require_file(truth, option="--truth")
    bench = emulated_bench(
        rig_, start, seed, faults, baud=baud, in_space=in_space, is_new=new, tells_supply=supply_current
    )
    shared = None if own_time else ClockSocket(link)
    try:
        server = PtyServer(bench, link, clock=MonotonicClock(), shared=shared)
    except BaseException:
        if shared is not None:
            shared.close()
        raise
    try:
        with signals_to(lambda _: server.stop(), (signal.SIGINT, signal.SIGTERM)), keeping_time(collecting=True):
            said = _description(bench, server, start, seed)
            more = {"faults": [str(one) for one in faults], "clock": None if shared is None else str(shared.link)}
            _say_ready(said | more, as_json=json)
            end = math.inf if for_s is None else bench.time + for_s
            server.run(end)
        if bench.time >= end:
            remark(f"{link} ended after {for_s:g} s, as --for says; the next one knows nothing of what was done here")
    finally:
        server.close()
    if truth is not None:
        write_json(_truth(bench, server, seed), truth)


def _parse_slack(text: str, count: int) -> tuple[float, ...]:
    expected = f"{count} numbers from 0 to 50 mm, one for each tendon"
    slack = number_list("--slack", text, expected, low=0, high=50)
    if len(slack) != count:
        raise SpecError(f"--slack is {text!r}, which is {len(slack)} numbers; expected {expected}")
    return tuple(slack)


def _description(bench: "EmulatedRig", server: "PtyServer", start: "Start", seed: int) -> dict[str, Any]:
    """Return what is emulated, as the line on stdout says it."""
    return {
        "link": str(server.link),
        "terminal": server.terminal,
        "rig": bench.spec.name,
        "baud": bench.imu.baud,
        "devices": sorted(device.id for device in bench.line.devices),
        "seed": seed,
        "tilt_deg": [math.degrees(angle) for angle in start.tilt],
        "slack_mm": [length * 1e3 for length in start.slack],
    }


def _say_ready(said: dict[str, Any], *, as_json: bool) -> None:
    if as_json:
        print(json_.dumps(said, ensure_ascii=False, allow_nan=False))
    else:
        faults = f"; faults {', '.join(said['faults'])}" if said["faults"] else ""
        devices = f"devices {', '.join(map(str, said['devices']))} at {said['baud']} baud"
        what = f"rig {said['rig']}, the joint on its twin, {devices}, seed {said['seed']}{faults}"
        print(f"{said['link']}: {what}; Ctrl-C ends it")
    sys.stdout.flush()


def _truth(bench: "EmulatedRig", server: "PtyServer", seed: int) -> dict[str, Any]:
    """Return how the bench was at the end, and what had happened to it."""
    motion, states = bench.motion(), bench.states()
    motors = [
        {
            "id": motor.id,
            "torque": motor.torque,
            "operating_mode": motor.registers["operating_mode"],
            "goal_pwm": motor.registers["goal_pwm"],
            "watchdog_tripped": motor.is_tripped,
            "hardware_error": motor.registers["hardware_error_status"],
            "temperature_c": motor.temperature,
            "angle_deg": math.degrees(states[number].angle),
            "speed_deg_s": math.degrees(states[number].speed),
            "current_a": states[number].current,
        }
        for number, motor in bench.motors.items()
    ]
    return {
        "rig": bench.spec.name,
        "seed": seed,
        "time_s": bench.time,
        "clock_s_at_zero": server.clock_time(0.0),
        "slipped_s": server.slipped,
        "lost_bytes": server.lost,
        "motors": motors,
        "stopped": bench.stopped(),
        "in_safe_state": bench.in_safe_state(),
        "frozen_since_s": bench.frozen_since(),
        "torsion_deg": math.degrees(motion.torsion),
        "tilt_deg": [math.degrees(angle) for angle in motion.tilt],
        "tension_n": list(motion.tension),
        "pretension_mm": bench.plant.pretension * 1e3,
        "instructions": bench.line.instructions,
        "faults": [{"time_s": each.time, "kind": each.kind, "what": each.what} for each in bench.log],
    }
