"""The examination of a bench, without moving a motor or switching a torque on: who is there, and in what state."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np

from sinew.bench.loop import MISSED_MOST
from sinew.bench.tilt import frame_from, opposite
from sinew.hardware.bus import Bus, Clock, Outcome
from sinew.hardware.configuration import Post, Setting, answer_everything, may_be_widened, read_counts, unfit_settings
from sinew.hardware.imu import ImuReading, NodeReport
from sinew.hardware.motor import Identity, Motor, name_hardware_errors
from sinew.hardware.ports import WANTED_MS, LatencyTimer
from sinew.hardware.registers import BAUD_RATES, CHIPS, IMUS, MOTORS, WATCHDOG_TRIPPED
from sinew.hardware.rig import Rig
from sinew.measure.errors import TROUBLES, DeviceError, HardwareError, PortError
from sinew.measure.units import STANDARD_GRAVITY
from sinew.plan.rig import Imu, Limits

# It is said what the doctor found: one fact, how bad it is, and what to do.

Severity = Literal["ok", "note", "warning", "fault"]
"""note: nothing is wrong. warning: a run works, worse than it could. fault: a run is refused, or would be wrong."""


@dataclass(frozen=True, slots=True)
class Fix:
    """A safe setting that the doctor can write.

    device: name of the motor, or "port". register: of the motor; "reboot" and "latency_timer" are none.
    found, wanted: counts; of the timer milliseconds.
    """

    device: str
    register: str
    found: int
    wanted: int

    def __str__(self) -> str:
        if self.register == "reboot":
            return f"{self.device}: reboot, its torque being off"
        return f"{self.device}: {self.register} from {self.found} to {self.wanted}"


@dataclass(frozen=True, slots=True)
class Finding:
    """One fact about a bench.

    subject: the device, or "bus", "port", "loop". found, expected: texts, with units. advice: what to do; empty where
    nothing is to be done. fix: what the doctor could write himself; None where it takes a person.
    """

    severity: Severity
    subject: str
    found: str
    expected: str = ""
    advice: str = ""
    fix: Fix | None = None

    @property
    def fixable(self) -> bool:
        """Whether the doctor can put it right himself."""
        return self.fix is not None

    def __str__(self) -> str:
        expected = f" (expected {self.expected})" if self.expected else ""
        return f"{self.subject}: {self.found}{expected}{f'; {self.advice}' if self.advice else ''}"


_WARM = 10.0  # °C below the rig's limit
_MODES = {
    0: "current",
    1: "velocity",
    3: "position",
    4: "extended position",
    5: "position with current limit",
    16: "PWM",
}
STATE = (
    "homing_offset", "temperature_limit", "max_voltage_limit", "min_voltage_limit", "torque_enable",
    "hardware_error_status", "bus_watchdog", "present_input_voltage", "present_temperature",
)  # fmt: skip
"""The registers in which `examine_state` looks, by address."""


OpenBus = Callable[[int], AbstractContextManager[Bus]]


@dataclass(slots=True)
class Roll:
    """Who answered when all were called. present: by name. missing: names. findings: about them."""

    present: dict[str, Identity] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)

    @property
    def is_complete(self) -> bool:
        """Whether every device of the wiring is there, and of the right model."""
        return not self.missing


def call_roll(rig: Rig) -> Roll:
    """Return who answers on the bus: the devices of the wiring, and others. Raises PortError."""
    roll = Roll()
    scanned = rig.bus.scan()
    for device in rig.devices:
        try:
            identity = device.identify()
        except TROUBLES as trouble:
            roll.missing.append(device.name)
            roll.findings.append(Finding("fault", device.name, str(trouble)))
            continue
        roll.present[device.name] = identity
    if not roll.present:
        found = f"no device of the wiring answers at {rig.bus.timing.baud} baud"
        roll.findings = [Finding("fault", "bus", found, f"{len(rig.devices)} devices", "check supply, cable and baud")]
    known = {device.id for device in rig.devices}
    for stranger, reply in sorted(scanned.items()):
        if stranger not in known:
            model = model_name(int.from_bytes(reply.data[:2], "little")) if reply.ok else "unknown model"
            roll.findings.append(
                Finding(
                    "warning",
                    "bus",
                    f"id {stranger} answers ({model})",
                    "only the devices of the wiring",
                    "unplug it, or put its id into the rig's [wiring]",
                )
            )
    return roll


def search_bauds(open_bus: OpenBus, tried: int, *, nobody: bool) -> list[Finding]:
    """Return who answers at bauds other than the one tried, as faults; one note if nobody does.

    open_bus: gives a bus at a baud, and takes it back. nobody: whether no device answered at the baud tried.
    """
    findings = []
    for baud in sorted(set(BAUD_RATES) - {tried}, reverse=True):
        try:
            with open_bus(baud) as bus:
                found = sorted(bus.scan())
        except PortError:
            continue  # a port need not know every baud of the motors
        if found:
            if nobody or tried not in BAUD_RATES:
                advice = f"set the rig's wiring.baud to {baud}, or call the doctor with --baud {baud}"
            else:
                advice = f"set their register baud_rate to {BAUD_RATES.index(tried)}, as in the other motors"
            ids = ", ".join(map(str, found))
            findings.append(Finding("fault", "bus", f"id {ids} at {baud} baud", f"at {tried} baud", advice))
    return findings or [Finding("note", "bus", "no device at any other baud")]


def examine_port(timer: LatencyTimer | None, baud: int, wiring_baud: int, *, of_ftdi: bool = False) -> list[Finding]:
    """Return what is to be said about the port. timer: of its adapter; baud: it was opened with [1/s].

    of_ftdi: the adapter is one of FTDI's, which has a timer also where the system does not show it (macOS).
    """
    findings = []
    if baud != wiring_baud:
        findings.append(
            Finding("warning", "port", f"{baud} baud", f"{wiring_baud} baud", f"set the rig's wiring.baud to {baud}")
        )
    if timer is None and of_ftdi:
        # 16 ms, and settings of Windows alone: FTDI AN232B-04, "Adjusting the receive buffer latency timer". On macOS
        # FTDI's driver took it from its Info.plist (FTDI TN_105), which by users' reports cannot be changed since 11.
        found = "an FTDI adapter, whose latency timer this system does not show; by default it is 16 ms"
        advice = (
            "look at the loop below: if answers wait as long, use Linux, or an adapter without this timer, such as the "
            "OpenCR's own USB; macOS has no setting for it"
        )
        return [*findings, Finding("warning", "port", found, f"{WANTED_MS} ms", advice)]
    if timer is None:
        return [*findings, Finding("ok", "port", f"{baud} baud, no latency timer (no FTDI adapter)")]
    try:
        now = timer.read()
    except PortError as trouble:
        return [*findings, Finding("warning", "port", str(trouble), f"{WANTED_MS} ms")]
    if now > WANTED_MS:
        fix = Fix("port", "latency_timer", now, WANTED_MS)
        advice = f"echo {WANTED_MS} > {timer.path}"
        found = f"latency timer of {now} ms: every answer waits for it"
        return [*findings, Finding("warning", "port", found, f"{WANTED_MS} ms", advice, fix)]
    return [*findings, Finding("ok", "port", f"{baud} baud, latency timer {now} ms")]


def examine_motors(rig: Rig, roll: Roll) -> list[Finding]:
    """Return what is to be said about every motor present: settings, limits, errors, climate. Raises PortError.

    And of every sensor that has a node of its own, what it tells.
    """
    findings = [
        finding
        for motor in rig.motors
        if motor.name in roll.present
        for finding in _examine_motor(rig, motor, roll.present[motor.name])
    ]
    for sensor in rig.sensors:
        if sensor.name in roll.present:
            reply = sensor.ask()
            read = f"id {sensor.id}, {sensor.row.name} {sensor.value(reply):.4g} {sensor.row.unit}"
            findings.append(Finding("ok" if reply.ok else "fault", sensor.name, read if reply.ok else str(reply)))
    return findings


def _examine_motor(rig: Rig, motor: Motor, identity: Identity) -> list[Finding]:
    level = motor.bus.read(motor.id, *motor.table.block(("status_return_level",)))
    if level.outcome is Outcome.SILENT or (level.ok and level.data != b"\x02"):
        fix = Fix(motor.name, "status_return_level", level.data[0] if level.ok else 0, 2)
        found = "answers pings only" if not level.ok else "does not answer writes"
        advice = "set status_return_level to 2; then examine it again"
        return [Finding("fault", motor.name, found, "an answer to everything", advice, fix)]
    try:
        counts = motor.get_counts(STATE) | read_counts(motor)
    except TROUBLES as trouble:
        return [Finding("fault", motor.name, str(trouble), "its registers", "")]
    troubles = list(examine_state(motor, counts, rig.spec.limits))
    settings = unfit_settings(Post(motor, rig.spec, counts["operating_mode"]), counts)
    # Result apart above: why it matters is said there.
    troubles += [_setting_finding(motor, row, counts) for row in settings if row.register != "homing_offset"]
    return [_summary(motor, identity, counts), *troubles]


def _summary(motor: Motor, identity: Identity, counts: Mapping[str, int]) -> Finding:
    volt, mode = counts["present_input_voltage"] * motor.table["present_input_voltage"].scale, counts["operating_mode"]
    found = (
        f"id {motor.id}, {motor.table.model}, firmware {identity.firmware}, {volt:.1f} V, "
        f"{counts['present_temperature']} °C, mode {_MODES.get(mode, mode)}"
    )
    return Finding("ok", motor.name, found)


def examine_state(
    motor: Motor, counts: Mapping[str, int], limits: Limits, *, torque_may_be_on: bool = False
) -> Iterator[Finding]:
    """Yield what is to be said about a motor whose registers of `STATE` hold some counts: torque, errors, climate."""
    torque = bool(counts["torque_enable"])
    if torque and not torque_may_be_on:
        advice = (
            "end what uses it, or go on with an interrupted run by --resume; else make sure that nothing falls, then "
            "`sinew stop --port PORT --state release`"
        )
        yield Finding("fault", motor.name, "torque on", "off", advice)
    if errors := name_hardware_errors(counts["hardware_error_status"]):
        fix = None if torque else Fix(motor.name, "reboot", counts["hardware_error_status"], 0)
        advice = "find the cause (load, heat, supply), then reboot it (`sinew doctor --fix`)"
        found = f"hardware error: {', '.join(errors)}{_limits_of(motor, counts, errors)}"
        yield Finding("fault", motor.name, found, "none", advice, fix)
    if counts["bus_watchdog"] == WATCHDOG_TRIPPED:
        fix = None if torque else Fix(motor.name, "bus_watchdog", WATCHDOG_TRIPPED, 0)
        yield Finding("warning", motor.name, "stopped by its bus watchdog", "watchdog off", "a run clears it", fix)
    elif counts["bus_watchdog"] and not torque:
        fix = Fix(motor.name, "bus_watchdog", counts["bus_watchdog"], 0)
        yield Finding("note", motor.name, "bus watchdog armed", "off between runs", "a run sets it", fix)
    if offset := counts["homing_offset"]:
        advice = "set it to 0 (`sinew doctor --fix`): with an offset the motor moves when its bus watchdog stops it"
        fix = Fix(motor.name, "homing_offset", offset, 0)
        yield Finding("fault", motor.name, f"homing offset of {offset} counts", "0", advice, fix)

    degrees, most = counts["present_temperature"], limits.temperature_c
    if degrees > most - _WARM:
        severity: Severity = "fault" if degrees > most else "warning"
        yield Finding(severity, motor.name, f"{degrees} °C", f"up to {most:g} °C", "let it cool")
    volt = counts["present_input_voltage"] * motor.table["present_input_voltage"].scale
    low, high = limits.voltage_v
    if not low <= volt <= high:
        advice = "set the supply, or the rig's voltage_v; if only this motor sees less, check its cable"
        yield Finding("fault", motor.name, f"{volt:.1f} V", f"{low:g} to {high:g} V", advice)


def _limits_of(motor: Motor, counts: Mapping[str, int], errors: Sequence[str]) -> str:
    """Return the motor's own limits that belong to its errors; one that is set too narrow raises them for ever."""
    names = ["temperature_limit"] if "overheating" in errors else []
    names += ["min_voltage_limit", "max_voltage_limit"] if "input voltage" in errors else []
    rows = [motor.table[name] for name in names]
    return "".join(f", {row.name} {counts[row.name] * row.scale:g} {row.unit.replace('degC', '°C')}" for row in rows)


def _setting_finding(motor: Motor, setting: Setting, counts: Mapping[str, int]) -> Finding:
    row = motor.table[setting.register]
    is_ours = not setting.is_refused or may_be_widened(motor, setting.register, counts)

    def text(count: int) -> str:
        unit = row.unit.replace("degC", "°C")
        return f"{count}" if row.unit == "1" else f"{count} ({count * row.scale:.4g} {unit})"

    return Finding(
        "fault" if setting.is_refused else "note",
        motor.name,
        f"{setting.register} {text(setting.found)}",
        text(setting.expected),
        setting.advice or "a run sets it, or --fix does now",
        Fix(motor.name, setting.register, setting.found, setting.expected) if is_ours else None,
    )


def model_name(number: int) -> str:
    """Return what a model is called that answers with a number to a ping."""
    table = MOTORS.get(number) or IMUS.get(number)
    return table.model if table else f"model {number}"


# The doctor puts right what he found: only safe settings, only with the torque off, and read back.

_REBOOT_S = 1.0
# What makes a motor answer, then what makes it listen, then the rest.
_FIRST = ("status_return_level", "reboot", "bus_watchdog")


def list_fixes(findings: Iterable[Finding]) -> list[Fix]:
    """Return what the doctor could write, in the order in which it has to be."""
    fixes = [finding.fix for finding in findings if finding.fix is not None]
    return sorted(fixes, key=lambda fix: _FIRST.index(fix.register) if fix.register in _FIRST else len(_FIRST))


def apply_fixes(rig: Rig, clock: Clock, fixes: Sequence[Fix], timer: LatencyTimer | None = None) -> list[Finding]:
    """Write settings and read them back; return a finding for each: ok, or a warning that says why not.

    A motor whose torque is on is left as it is. timer: of the port's adapter. Raises PortError if the port is gone.
    """
    motors = {motor.name: motor for motor in rig.motors}
    return [_apply(rig, clock, fix, motors.get(fix.device), timer) for fix in fixes]


def _apply(rig: Rig, clock: Clock, fix: Fix, motor: Motor | None, timer: LatencyTimer | None) -> Finding:
    try:
        if motor is not None:
            _apply_to_motor(rig, clock, fix, motor)
        elif timer is not None:
            _set_timer(timer, fix.wanted)
    except PortError as trouble:
        if motor is not None:
            raise
        return Finding("warning", fix.device, str(trouble), str(fix.wanted))
    except HardwareError as trouble:
        return Finding("warning", fix.device, str(trouble), f"{fix.register} {fix.wanted}")
    return Finding("ok", fix.device, f"{fix.register} is {fix.wanted} now" if fix.register != "reboot" else "rebooted")


def _apply_to_motor(rig: Rig, clock: Clock, fix: Fix, motor: Motor) -> None:
    if fix.register == "status_return_level":
        answer_everything(motor)
        return
    motor.require_torque_off(f"to write {fix.register}" if fix.register != "reboot" else "to be rebooted")
    if fix.register == "reboot":
        _reboot(rig, clock, motor)
    elif fix.register == "bus_watchdog":
        motor.disarm_watchdog()
    else:
        motor.ensure_count(fix.register, fix.wanted)


def _reboot(rig: Rig, clock: Clock, motor: Motor) -> None:
    reply = rig.bus.reboot(motor.id)
    if not reply.ok:
        raise DeviceError(f"{motor.name} did not reboot: {reply}; switch its supply off and on")
    clock.wait_until(clock.now() + _REBOOT_S)
    rig.forget()
    if errors := motor.hardware_errors():
        raise DeviceError(
            f"{motor.name} still reports {', '.join(errors)} after a reboot, expected nothing; replace it"
        )


def _set_timer(timer: LatencyTimer, wanted: int) -> None:
    timer.write(wanted)
    if (found := timer.read()) != wanted:
        raise PortError(f"{timer.path} is {found} after {wanted} was written; expected {wanted} ms")


# What a glance does not show is measured: the sensor at rest, and how fast the loop can go.

_PERIOD = 2.5e-3  # twice as often as there are samples, so that none is missed
_GRAVITY_TOLERANCE = 0.1
_LEANS = math.radians(15)
_LOWEST_RATE = 150.0
_ALL_NEW = 0.9  # of the answers; where more bring a new sample, some samples may have been missed
_LARGEST_BIAS = math.radians(1.0)
_STILL = math.radians(1.0)
_GOAL_BYTES = 9  # of each motor in the packet of goals
_FOR_PYTHON = 0.2  # of a cycle, for all that is not the bus


@dataclass(frozen=True, slots=True)
class LoopTimes:
    """How long readings of all devices took [s]: half of them, 99 of 100, and the longest; `cycles` were made.

    goals: what the packet with the goals needs on the wire besides [s]. incomplete: cycles with a missing answer.
    """

    cycles: int
    median: float
    most: float
    longest: float
    goals: float
    incomplete: int

    @property
    def rate(self) -> float:
        """Cycles that 99 of 100 times are finished in time [1/s], with a share left for all that is not the bus."""
        return (1 - _FOR_PYTHON) / (self.most + self.goals)


def listen_to_imu(rig: Rig, clock: Clock, seconds: float = 2.0) -> tuple[list[ImuReading], int]:
    """Return the different samples of the sensor over a time, and how many answers brought them.

    It is asked at 400 Hz, or as fast as the bus can; what it does not answer is left out. Raises PortError.
    """
    samples: dict[int, ImuReading] = {}
    answers = 0
    start = clock.now()
    for cycle in range(round(seconds / _PERIOD)):
        clock.wait_until(start + cycle * _PERIOD)
        if clock.now() > start + seconds:
            break
        try:
            reading = rig.imu.read()
        except TROUBLES:
            continue
        samples.setdefault(reading.counter, reading)
        answers += 1
    return list(samples.values()), answers


def examine_imu(rig: Rig, clock: Clock, seconds: float = 2.0) -> list[Finding]:
    """Return what is to be said about the sensor: rate, bias and noise at rest, whether x is up. Raises PortError."""
    samples, answers = listen_to_imu(rig, clock, seconds)
    return judge_imu(samples, rig.spec.wiring.imu_axes, is_whole=len(samples) < _ALL_NEW * answers)


def judge_imu(samples: Sequence[ImuReading], axes: tuple[str, ...], *, is_whole: bool = True) -> list[Finding]:
    """Return what is to be said about samples of the sensor at rest.

    axes: of the chip, as the wiring has them. is_whole: False where the sensor may have had samples that nobody asked
    for, because the bus is slow; its rate is then not judged.
    """
    if len(samples) < 3:
        found = f"{len(samples)} different samples"
        return [Finding("fault", "IMU", found, "200 each second", "it is frozen or silent: restart its board")]
    rate = _sample_rate([sample.counter for sample in samples])
    gyro = np.degrees([sample.gyro for sample in samples])
    force = np.mean([sample.acceleration for sample in samples], axis=0)
    bias, noise = gyro.mean(axis=0), gyro.std(axis=0)
    texts = ", ".join(f"{value:+.2f}" for value in bias)
    found = f"{'' if is_whole else 'at least '}{rate:.0f} samples/s, bias {texts} °/s, noise {noise.max():.2f} °/s"
    findings = [Finding("ok", "IMU", f"{found}, {_texts(force)} m/s²")]
    if is_whole and rate < _LOWEST_RATE:
        advice = "flash the node's firmware that samples at 200 Hz; the sweep's phases need it"
        findings.append(Finding("warning", "IMU", f"{rate:.0f} samples/s", f"at least {_LOWEST_RATE:.0f}", advice))
    if noise.max() > math.degrees(_STILL):
        advice = "examine it at rest; bias and gravity are not to be trusted now"
        findings.append(Finding("warning", "IMU", f"rates vary by {noise.max():.1f} °/s", "rest", advice))
    elif np.abs(bias).max() > math.degrees(_LARGEST_BIAS):
        found = f"bias of {np.abs(bias).max():.1f} °/s"
        advice = "restart its board while the head is still: it takes its zero then"
        findings.append(Finding("warning", "IMU", found, f"within {math.degrees(_LARGEST_BIAS):g} °/s", advice))
    return findings + examine_gravity(force, axes)


def examine_chip(rig: Rig) -> list[Finding]:
    """Return what is to be said about the sensor's chip and its filter, as its node tells them. Raises PortError."""
    return [judge_chip(rig.imu.node_report(), rig.spec.imu)]


def judge_chip(report: NodeReport | None, imu: Imu) -> Finding:
    """Return what is to be said about a chip; a delay that was measured at the bench is believed more than its chip's.

    report: None of a node that tells nothing. imu: what the rig assumes.
    """
    if report is None:
        found = "its firmware tells neither chip nor lost samples"
        advice = "nothing needs to be done: runs count no lost samples; Sinew's own firmware tells both"
        return Finding("note", "IMU", found, "chip and filter delay", advice)
    assumed, std = imu.filter_delay, imu.delay_std.value
    expected = f"{1e3 * assumed:.2f} ± {1e3 * std:.2g} ms, as the rig has it"
    chip = CHIPS.get(report.chip, "an unknown chip")
    found = f"{chip} (0x{report.chip:02X}), late by {1e3 * report.filter_delay:.2f} ms"
    if report.chip not in CHIPS:
        advice = "measure its delay with `sinew doctor --guide FILE --step lever`, by lever steps"
        return Finding("warning", "IMU", found, " or ".join(CHIPS.values()), advice)
    if abs(report.filter_delay - assumed) <= std:
        return Finding("ok", "IMU", found)
    if imu.residual_delay.origin == "measured":
        return Finding("note", "IMU", found, expected, "nothing needs to be done: the rig's was measured at the bench")
    advice = "set imu.low_pass and imu.residual_delay of the rig to this chip's, or phases are wrong by the difference"
    return Finding("warning", "IMU", found, expected, advice)


def _sample_rate(counters: Sequence[int]) -> float:
    """Return the rate [1/s] at which counters [µs] were taken, of which some may be missing."""
    steps = np.array([(after - before) % 2**32 for before, after in pairwise(counters)], dtype=float)
    period = np.quantile(steps, 0.25)
    return float(1e6 * np.round(steps / period).sum() / steps.sum())


def axis_up(force: Sequence[float] | np.ndarray, axes: tuple[str, ...]) -> str | None:
    """Return the signed axis of the chip that points up at rest, within 15°; None where it is none of them.

    force: along the head's axes [m/s²]. axes: of the chip, as the wiring has them.
    """
    largest = int(np.abs(force).argmax())
    if abs(force[largest]) <= math.cos(_LEANS) * float(np.linalg.norm(force)):
        return None
    return axes[largest] if force[largest] > 0 else opposite(axes[largest])


def examine_gravity(
    force: Sequence[float] | np.ndarray, axes: tuple[str, ...], most_lean: float = _LEANS
) -> list[Finding]:
    """Return what is to be said about the force on a sensor at rest, along the head's axes [m/s²].

    axes: of the chip, as the wiring has them. most_lean: of the head's x from up [rad].
    """
    size = float(np.linalg.norm(force))
    if abs(size / STANDARD_GRAVITY - 1) > _GRAVITY_TOLERANCE:
        advice = "is it at rest? is it the sensor that the wiring names?"
        return [Finding("fault", "IMU", f"{size:.2f} m/s² at rest", "9.81 m/s²", advice)]
    if force[0] > math.cos(most_lean) * size:
        return []
    if (up := axis_up(force, axes)) is not None:
        fitting = ", ".join(f'"{axis}"' for axis in frame_from(up))
        advice = f"set the rig's wiring.imu_axes, for instance to [{fitting}]; which way round about x, a tilt shows"
    else:
        advice = "level the rig, or mount the board along its axes"
    return [Finding("fault", "IMU", f"x of the head is not up: {_texts(force)} m/s²", "+9.81, 0, 0", advice)]


def time_loop(rig: Rig, clock: Clock, seconds: float = 1.0) -> LoopTimes:
    """Return how long readings take that follow one another; no goal is written. Raises PortError."""
    times: list[float] = []
    incomplete = 0
    stop = clock.now() + seconds
    while (begun := clock.now()) < stop or len(times) < 2:
        reading = rig.read()
        times.append(clock.now() - begun)
        incomplete += bool(reading.faults or reading.stale)
    median, most = np.quantile(times, (0.5, 0.99))
    goals = (10 + _GOAL_BYTES * len(rig.motors)) * 10 / rig.bus.timing.baud
    return LoopTimes(len(times), float(median), float(most), max(times), goals, incomplete)


def examine_loop(times: LoopTimes, wanted_hz: float) -> list[Finding]:
    """Return what is to be said about the speed of the loop. wanted_hz: cycles a plan asks for [1/s]."""
    found = (
        f"readings take {1e3 * times.median:.2f} ms (median), {1e3 * times.most:.2f} ms (99 of 100), "
        f"{1e3 * times.longest:.2f} ms (longest of {times.cycles}); with goals good for {times.rate:.0f} Hz"
    )
    if times.rate >= wanted_hz:
        return [Finding("ok", "loop", found)]
    advice = "return delay 0, latency timer 1 ms, a higher baud, fewer programs on the computer; or a lower sample_hz"
    return [Finding("warning", "loop", found, f"{wanted_hz:g} Hz", advice)]


def examine_bus(rig: Rig, times: LoopTimes | None) -> list[Finding]:
    """Return what is to be said about errors on the bus since it was opened."""
    counts = rig.bus.statistics
    errors = {
        "silent": counts.silent,
        "damaged": counts.damaged,
        "of a wrong length": counts.wrong_length,
        "with a wrong CRC": counts.crc_errors,
        "to an instruction that came damaged": counts.heard_damaged,
        "nobody asked for": counts.strays,
        "of an earlier time": rig.stale.total(),
        "that cannot be true": rig.impossible.total(),
        "twice and not the same": counts.rivals,
    }
    counted = ", ".join(f"{count} {what}" for what, count in errors.items() if count)
    shown = f"{counts.answers} answers to {counts.transactions} instructions"
    if times is not None and times.incomplete:
        shown += f"; {times.incomplete} of {times.cycles} readings incomplete"
    findings = []
    if counts.echoes:
        found = f"the adapter returned {counts.echoes} of {counts.transactions} packets that it sent; they are dropped"
        advice = "nothing needs to be done; to be rid of it, switch its receiver off while it sends"
        findings.append(Finding("note", "port", found, "no echo", advice))
    if not counted:
        return [*findings, Finding("ok", "bus", f"{shown}, none lost or damaged")]
    advice = "check plugs, ground and length of the cables; a silent device explains silence"
    if counts.damaged + counts.crc_errors + counts.heard_damaged > counts.silent + counts.rivals:
        advice = "noise: check ground, shield and termination (120 Ω at both ends of RS-485), and length of the cables"
    elif counts.rivals:
        advice = "two devices answer to one id: unplug one and give it another id"
    if times is not None and times.incomplete > MISSED_MOST * times.cycles:
        expected = f"at most {100 * MISSED_MOST:.0f} % of readings incomplete; a run ends with more"
        return [*findings, Finding("fault", "bus", f"{shown}: {counted}", expected, advice)]
    return [*findings, Finding("warning", "bus", f"{shown}: {counted}", "no errors", advice)]


def examine_present(
    rig: Rig, clock: Clock, roll: Roll, wanted_hz: float = 200.0, listen_s: float = 2.0
) -> list[Finding]:
    """Return all that is to be said about who is there: motors, sensors, loop and bus. Raises PortError.

    wanted_hz: cycles a plan asks for [1/s]. listen_s: to the sensor at rest.
    """
    findings, times = examine_motors(rig, roll), None
    if rig.imu.name in roll.present:
        findings += examine_chip(rig) + examine_imu(rig, clock, listen_s)
    if roll.is_complete:
        times = time_loop(rig, clock)
        findings += examine_loop(times, wanted_hz)
    return findings + examine_bus(rig, times)


def _texts(vector: Sequence[float] | np.ndarray) -> str:
    return ", ".join(f"{value:+.2f}" for value in vector)
