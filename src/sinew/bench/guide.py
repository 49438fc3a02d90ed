"""The guide's steps, one after the other: what each asks of a person, finds out, and writes into the rig.

Every step begins and ends with motors without torque, may be repeated, and does not mind what an attempt before it has
left half done. What a step finds is told as the doctor tells it; what it knows then stands in the rig.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Protocol, cast

import numpy as np

from sinew.bench.doctor import (
    Finding,
    apply_fixes,
    axis_up,
    call_roll,
    examine_gravity,
    examine_imu,
    examine_motors,
    examine_present,
    judge_imu,
    list_fixes,
    listen_to_imu,
    model_name,
)
from sinew.bench.guide_moves import (
    STEP,
    Pull,
    UnconfirmedError,
    answer_to,
    bring_lever_home,
    moving,
    pull_current,
    pull_tendon,
    swing_lever,
    widen_window,
)
from sinew.bench.tilt import frame_from, turned_frame
from sinew.hardware.bus import Bus, Clock, Outcome
from sinew.hardware.configuration import answer_everything
from sinew.hardware.motor import RETRIES, Motor
from sinew.hardware.ports import PLUG_ALL, PLUG_DRIVE, TURN_LEVER, LatencyTimer
from sinew.hardware.registers import BAUD_RATES, IMUS, MOTORS, encode_raw
from sinew.hardware.rig import Rig
from sinew.measure.errors import TROUBLES, DeviceError, LimitError, LostError, PortError, StartError
from sinew.plan.parameter import Parameter
from sinew.plan.rig import RigSpec, Wiring
from sinew.plan.servo import COUNTS_PER_TURN, PULSE, SERVOS

# ---- who is on the bus: looked for at every baud, told apart by model, and given an id and a baud of its own


READS = {
    "baud": "{} baud",
    "imu_id": "id {}",
    "imu_model": "{}",
    "imu_axes": "the chip's axes along x, y and z are {0[0]}, {0[1]} and {0[2]}",
    "drive_id": "motor {} is the drive",
    "drive_sign": "more counts turn the lever by the sign {:+d}",
    "drive_zero_counts": "its middle is at {} counts",
    "tendon_ids": "motor {} pulls it",
    "tendon_pull": "its motor pulls by counts of the sign {:+d}",
}
"""How the keys of the wiring that are looked at read, where they are named."""

OpenRig = Callable[[RigSpec], AbstractContextManager[tuple[Rig, Clock]]]
"""Opens the port at a rig's baud, and gives it back."""

NEW_BAUD = 57_600
"""Of a motor from the factory."""

_STARTS_S = 0.6  # until a motor that was plugged in listens
_WINDOW = ("min_position_limit", "max_position_limit")  # about a middle that is not known yet
_CHIP = ("+x", "+y", "+z")
_RESTS, _RESTS_MOST_S = math.radians(1.0), 12.0  # rad/s of a head that rests; how long it is waited for
_FOLLOWS, _MISFIT, _SHARES = 0.6, 0.5, (0.1, 0.95)  # of the lever's way, and of how the head answers it
_SKEWED = 20.0  # degrees
_ROUNDS, _VOLT_STD = 3, 0.03  # the voltage comes in steps of 0.1 V
_TWINS = 4  # questions about the present, of which two devices with one id spoil the half


@dataclass(frozen=True, slots=True)
class Seen:
    """A device that answered. baud: at which. number: of its model, 0 where the answer was no good. is_double: whether
    two answer to the id."""

    id: int
    baud: int
    number: int
    is_double: bool = False

    def __str__(self) -> str:
        twice = ", twice" if self.is_double else ""
        return f"id {self.id} at {self.baud} baud ({model_name(self.number)}{twice})"


def rewired(spec: RigSpec, **wiring: object) -> RigSpec:
    """Return a rig with other keys of its wiring, as they are not yet known to be."""
    return spec.model_copy(update={"wiring": spec.wiring.model_copy(update=wiring)})


def look_around(open_rig: OpenRig, spec: RigSpec, bauds: Iterable[int] = ()) -> list[Seen]:
    """Return who answers, at bauds in this order; by default at all, the rig's and a new motor's first.

    What has just been plugged in is waited for. A port need not know every baud. Raises PortError where it knows none.
    """
    first = (spec.wiring.baud, NEW_BAUD)
    tried = list(dict.fromkeys(bauds)) or list(dict.fromkeys([*first, *sorted(BAUD_RATES, reverse=True)]))
    found: list[Seen] = []
    refused: list[PortError] = []
    for number, baud in enumerate(tried):
        try:
            with open_rig(rewired(spec, baud=baud)) as (rig, clock):
                clock.wait_until(clock.now() + (_STARTS_S if number == 0 else 0.0))
                for device, reply in sorted(rig.bus.scan().items()):
                    model = int.from_bytes(reply.data[:2], "little") if reply.ok else 0
                    found.append(Seen(device, baud, model, _is_double(rig.bus, device, model)))
        except PortError as trouble:
            refused.append(trouble)
    if len(refused) == len(tried):
        raise refused[0]
    return found


def _is_double(bus: Bus, device: int, number: int) -> bool:
    """Return whether two motors answer to an id: they agree on a ping, and hardly ever on the present."""
    if number not in MOTORS:
        return False
    address, length = MOTORS[number].block(("realtime_tick", "present_temperature"))
    replies = [bus.read(device, address, length, retries=0) for _ in range(_TWINS)]
    return sum(reply.outcome is Outcome.DAMAGED for reply in replies) >= _TWINS // 2


def refuse_incomplete(seen: Sequence[Seen], spec: RigSpec) -> str:
    """Return why these are not the rig's motors, each with an id of its own; an empty text where they are."""
    if doubles := [str(device) for device in seen if device.is_double]:
        return f"two motors share {'; '.join(doubles)}"
    motors = [device for device in seen if device.number in MOTORS]
    if shared := [number for number, times in Counter(device.id for device in motors).items() if times > 1]:
        return f"id {shared[0]} answers at several bauds, so from several motors"
    tendon, drive = wanted_models(spec)
    if sorted(device.number for device in motors) != sorted([tendon] * len(spec.wiring.tendon_ids) + [drive]):
        return f"found {', '.join(map(str, motors)) or 'no motor'}"
    return "" if tendon != drive else "tendon motors and drive are of one model, which does not tell them apart"


def wanted_models(spec: RigSpec) -> tuple[int, int]:
    """Return the model numbers of a rig's tendon motors and of its drive."""
    return SERVOS[spec.wiring.tendon_model].number, SERVOS[spec.wiring.drive_model].number


def find_sensor(seen: Sequence[Seen], spec: RigSpec) -> Seen:
    """Return the sensor on the head among who answered: the one with the rig's id, else any."""
    nodes = sorted((device for device in seen if device.number in IMUS), key=lambda node: node.id != spec.wiring.imu_id)
    found = "; ".join(map(str, seen)) or "nobody answers at any baud"
    advice = "check supply, cable and plug; flash the node's firmware, and leave its board on the bus"
    require(bool(nodes), "bus", found, "the IMU's node", advice)
    return nodes[0]


def give_id(open_rig: OpenRig, spec: RigSpec, found: Seen, name: str, number: int, baud: int) -> None:
    """Give the motor found, the only one on the bus or the only one of its id, another id and baud.

    name: what to call it. Repeating it does no harm: what was written before stays. Raises DeviceError where the motor
    has torque, or does not take it.
    """
    here = found.id, found.baud
    for register, count, there in (
        ("id", number, (number, found.baud)),
        ("baud_rate", BAUD_RATES.index(baud), (number, baud)),
    ):
        if there != here:
            with open_rig(rewired(spec, baud=found.baud)) as (rig, _):
                motor = Motor(rig.bus, name, here[0], MOTORS[found.number])
                answer_everything(motor)
                motor.require_torque_off(f"to get another {register}")
                # once, and without its answer: that may come from the old id, or at a baud that is no longer heard
                row = motor.table[register]
                rig.bus.write(motor.id, row.address, encode_raw(row, count), retries=0)
        here = there
        with open_rig(rewired(spec, baud=here[1])) as (rig, _):
            replies = (rig.bus.ping(number) for _ in range(1 + RETRIES))
            if not any(reply.ok and int.from_bytes(reply.data[:2], "little") == found.number for reply in replies):
                raise DeviceError(
                    f"{name}, found as {found}, does not answer as id {number} at {here[1]} baud after that was "
                    "written; switch the supply off and on, and repeat this step"
                )


# ---- the steps


class FaultyError(Exception):
    """A check of a step failed; its finding says what is wrong, and what to do."""


def require(holds: bool, subject: str, found: str, expected: str, advice: str) -> None:
    """Raise FaultyError where something does not hold, with what was found, what was expected and what to do."""
    if not holds:
        raise FaultyError(Finding("fault", subject, found, expected, advice))


class Person(Protocol):
    """Who stands at the bench."""

    def begin(self, step: "Step") -> None:
        """Say what comes."""

    def tell(self, finding: Finding) -> None:
        """Say what was found."""

    def do(self, words: str, act: int) -> None:
        """Ask for something to be done, and return when it is. act: its number for an emulated bench, which does it."""

    def agrees(self, question: str) -> bool:
        """Return whether it may be done."""

    def repeats(self, what: str, failed: bool) -> bool:
        """Return whether what has just ended, well or not, is to be done again; raise StoppedError to end it all."""


@dataclass(slots=True)
class Guide:
    """What the steps share.

    open_rig: gives the bench. person: who is asked. spec: the rig, as far as it is known. save: keeps it after every
    step. check: raises where the guide is to end, before every cycle of a move. timer: of the port's adapter.
    notes: what was not as the rig had it, and is put right. is_labelled: whether a motor's id says of which tendon
    people hold it to be. is_turned: whether the board is not mounted as the rig had it. unconfirmed: how a
    bench was left whose motors did not confirm that they have no torque; empty where they did.
    """

    open_rig: OpenRig
    person: Person
    spec: RigSpec
    save: Callable[[RigSpec], None]
    check: Callable[[], None] = lambda: None
    timer: LatencyTimer | None = None
    notes: list[Finding] = field(default_factory=list)
    is_labelled: bool = True
    is_turned: bool = False
    unconfirmed: str = ""

    def learn(self, subject: str, **wiring: object) -> list[Finding]:
        """Put keys into the wiring as measured, and return a note on each that is not as the rig had it.

        subject: of the notes, but of keys by tendon: those are about the tendon.
        """
        old, notes = self.spec.wiring, list[Finding]()
        for key, new in wiring.items():
            pairs = [(subject, new, getattr(old, key))]
            if key in ("tendon_ids", "tendon_pull"):
                each = zip(cast(tuple[int, ...], new), getattr(old, key), strict=True)
                pairs = [(f"tendon {number}", *pair) for number, pair in enumerate(each, start=1)]
            for about, found, before in pairs:
                if found != before:
                    expected = ", ".join(before) if isinstance(before, tuple) else str(before)
                    notes.append(Finding("note", about, READS[key].format(found), expected, f"{key} is right now"))
        there = {*old.measured, *wiring}
        measured = tuple(name for name in Wiring.model_fields if name in there)
        new = Wiring.model_validate(old.model_dump() | wiring | {"measured": measured})
        self.spec = self.spec.model_copy(update={"wiring": new})
        return notes

    def measure(self, dotted: str, value: float, std: float, note: str) -> Finding:
        """Put a measured number into the rig, if it is thinkable, and say so."""
        part_name, name = dotted.split(".")
        part = getattr(self.spec, part_name)
        old: Parameter = getattr(part, name)
        low, high = old.bounds
        value, std = float(f"{value:.4g}"), float(f"{std:.2g}")
        found = f"{name} {value:.4g} ± {std:.1g} {old.unit}, before {old.value:.4g} ({old.origin})"
        if not low <= value <= high or not math.isfinite(value + std):
            advice = f"{dotted} stays {old.value:.4g} ({old.origin}); is it another motor or sensor than the rig says?"
            return Finding("warning", part_name, found, f"{low:.4g} to {high:.4g} {old.unit}", advice)
        ends = (float(f"{value - 1.645 * std:.4g}"), float(f"{value + 1.645 * std:.4g}"))
        new = Parameter(value=value, unit=old.unit, origin="measured", bounds=old.bounds, interval90=ends, note=note)
        updates: dict[str, object] = {part_name: part.model_copy(update={name: new})}
        if (known := self.spec.calibration) is not None:
            updates["calibration"] = known.only([other for other in known.parameters if other != dotted])
        self.spec = self.spec.model_copy(update=updates)
        return Finding("ok", part_name, found)


@dataclass(frozen=True, slots=True)
class Step:
    """name: as the command line has it. title: what it is about. run: does it, and returns what was found."""

    name: str
    title: str
    run: Callable[[Guide], list[Finding]]


def lead(guide: Guide, steps: Sequence[Step]) -> bool:
    """Go through steps with a person; return whether all ended without a fault.

    What a device does not do is a fault of its step, which the person may repeat. Raises StoppedError where the person
    ends it; no motor has torque then.
    """
    for step in steps:
        while True:
            guide.check()
            guide.person.begin(step)
            findings = _attempted(guide, step)
            for finding in findings:
                guide.person.tell(finding)
            failed = any(finding.severity == "fault" for finding in findings)
            if not failed:
                guide.notes += [finding for finding in findings if finding.severity == "note"]
                guide.save(guide.spec)
            if not guide.person.repeats(step.name, failed):
                break
        if failed:
            return False
    return True


def _attempted(guide: Guide, step: Step) -> list[Finding]:
    before = guide.spec
    try:
        return step.run(guide)
    except FaultyError as fault:
        return list(fault.args)
    except (*TROUBLES, PortError, StartError, LimitError, LostError) as trouble:
        guide.spec = before
        if isinstance(trouble, UnconfirmedError):
            guide.unconfirmed = str(trouble)
        return [Finding("fault", step.name, str(trouble))]


# Who is there, with which id, at which baud.


def _find_devices(guide: Guide) -> list[Finding]:
    spec = guide.spec
    seen = look_around(guide.open_rig, spec)
    sensor = find_sensor(seen, spec)
    findings = guide.learn("IMU", baud=sensor.baud, imu_id=sensor.id, imu_model=IMUS[sensor.number].model)
    findings.append(Finding("ok", "IMU", str(sensor)))
    if why := refuse_incomplete(seen, guide.spec):
        findings.append(Finding("note", "bus", why, "each motor with an id of its own", "they go one by one"))
        for finding in findings:
            guide.person.tell(finding)
        return _one_by_one(guide)
    # They are told apart by their ids, which are kept; all come to one baud.
    wiring, (_, drive) = guide.spec.wiring, wanted_models(guide.spec)
    motors = {device.id: device for device in seen if device.number in MOTORS}
    swings = next(number for number, device in motors.items() if device.number == drive)
    ids = tuple(sorted(motors.keys() - {swings}))
    known = (set(ids), swings) == (set(wiring.tendon_ids), wiring.drive_id)
    guide.is_labelled &= known  # ids that an earlier try took as they were are no labels the second time either
    findings += guide.learn("bus", tendon_ids=wiring.tendon_ids if known else ids, drive_id=swings)
    for device in motors.values():
        if device.baud != wiring.baud:
            give_id(guide.open_rig, guide.spec, device, f"motor {device.id}", device.id, wiring.baud)
            what = f"{device.baud} baud"
            findings.append(Finding("note", f"motor {device.id}", what, f"{wiring.baud} baud", "set"))
    return findings + [Finding("ok", f"motor {one}", model_name(motors[one].number)) for one in (*ids, swings)]


def _one_by_one(guide: Guide) -> list[Finding]:
    """Have each motor plugged in alone, and give it the id that the rig has for it."""
    wiring, person = guide.spec.wiring, guide.person
    tendon, drive = wanted_models(guide.spec)
    wanted = [(f"tendon {n}", f"the motor of tendon {n}", i, tendon, n) for n, i in enumerate(wiring.tendon_ids, 1)]
    wanted.append(("drive", "the lever's motor (the drive)", wiring.drive_id, drive, PLUG_DRIVE))
    for label, what, number, model, act in wanted:
        person.do(f"plug in {what}, alone of all motors; the board stays", act)
        person.tell(_name_one(guide, label, number, model))
    person.do("plug in all motors", PLUG_ALL)
    there = look_around(guide.open_rig, guide.spec, (wiring.baud,))
    why = refuse_incomplete(there, guide.spec)
    require(not why, "bus", why, "all motors", "check that all are plugged in, and repeat this step")
    guide.learn("bus", tendon_ids=wiring.tendon_ids, drive_id=wiring.drive_id)
    guide.is_labelled = True
    return []


def _name_one(guide: Guide, label: str, number: int, model: int) -> Finding:
    """Give the one motor that is plugged in its id and baud. Raises DeviceError where there is another, or more."""
    baud = guide.spec.wiring.baud
    seen: list[Seen] = []
    for bauds in ((baud, NEW_BAUD), ()):  # where it is expected, and everywhere else after that
        seen = seen or [device for device in look_around(guide.open_rig, guide.spec, bauds) if device.number in MOTORS]
    texts = f"found {', '.join(map(str, seen)) or 'no motor at any baud'}, expected"
    if len(seen) != 1 or seen[0].is_double:
        raise DeviceError(
            f"{texts} one motor, that of {label}; check plug and supply, and that no other motor is on the bus"
        )
    found = seen[0]
    if found.number != model:
        advice = "plug in the right one, or correct the models in the rig's [wiring]"
        raise DeviceError(f"{texts} a {model_name(model)} as {label}; {advice}")
    give_id(guide.open_rig, guide.spec, found, label, number, baud)
    return Finding("ok", label, f"{found} is id {number} at {baud} baud now")


# What the motors must hold, and what the board says at rest.


def _set_up(guide: Guide) -> list[Finding]:
    with guide.open_rig(guide.spec) as (rig, clock):
        roll = call_roll(rig)
        if not roll.is_complete:
            return roll.findings
        if not rig.drive.torque_is_on():
            widen_window(rig)  # an attempt that was broken off left one about its middle
        findings = examine_motors(rig, roll)
        fixes = [fix for fix in list_fixes(findings) if fix.register not in _WINDOW]
        if not fixes:
            return [finding for finding in findings if finding.severity != "note"]
        registers = ", ".join(sorted({fix.register for fix in fixes}))
        if not guide.person.agrees(f"write {len(fixes)} settings ({registers}) to motors whose torque is off"):
            return [*findings, Finding("fault", "motors", "settings are as they were", "written", "repeat this step")]
        written = apply_fixes(rig, clock, fixes, guide.timer)
        if refused := [finding for finding in written if finding.severity != "ok"]:
            return refused
        left = [finding for finding in examine_motors(rig, roll) if finding.severity in ("ok", "warning", "fault")]
    return [*left, Finding("ok", "motors", f"{len(fixes)} settings written: {registers}")]


def _find_up(guide: Guide) -> list[Finding]:
    with guide.open_rig(rewired(guide.spec, imu_axes=_CHIP)) as (rig, clock):
        _await_rest(rig, clock)
        samples, _ = listen_to_imu(rig, clock, 0.5)
    if len(samples) < 3:
        return judge_imu(samples, _CHIP)
    force = np.mean([sample.acceleration for sample in samples], axis=0)
    if (up := axis_up(force, _CHIP)) is None:
        return examine_gravity(force, _CHIP)
    findings = []
    if guide.spec.wiring.imu_axes[0] != up:
        old = guide.spec.wiring.imu_axes
        findings.append(Finding("note", "IMU", f"the chip's {up} points up", old[0], "the tendons will tell the rest"))
        guide.spec, guide.is_turned = rewired(guide.spec, imu_axes=frame_from(up)), True
    with guide.open_rig(guide.spec) as (rig, clock):
        return findings + examine_imu(rig, clock, 1.0)


def _await_rest(rig: Rig, clock: Clock) -> None:
    """Wait until the head rests; after 12 s whoever looks at it says that it does not."""
    stop = clock.now() + _RESTS_MOST_S
    while clock.now() < stop:
        samples, _ = listen_to_imu(rig, clock, 0.5)
        if len(samples) > 2 and np.std([sample.gyro for sample in samples], axis=0).max() < _RESTS:
            return


# The lever: its middle by hand, its sense by what the head does.


def _find_lever(guide: Guide) -> list[Finding]:
    guide.person.do(
        "turn the lever by hand to its middle: along tendons 1 and 3, the cable of its motor free either way",
        TURN_LEVER,
    )
    with guide.open_rig(rewired(guide.spec, drive_sign=1)) as (rig, _):
        widen_window(rig)
        rig.configure()
        middle = rig.drive.get_count("present_position")
    reach = math.radians(guide.spec.limits.drive_window_deg) / PULSE
    require(
        reach <= middle <= COUNTS_PER_TURN - 1 - reach,
        "drive",
        f"the middle at {middle} counts",
        f"{reach:.0f} to {COUNTS_PER_TURN - 1 - reach:.0f}, for a window of ±{reach * PULSE * 57.3:.0f}°",
        "take the horn off, turn it by a quarter, put it back on; or make limits.drive_window_deg smaller",
    )
    with (
        guide.open_rig(rewired(guide.spec, drive_sign=1, drive_zero_counts=middle)) as (rig, clock),
        moving(rig, clock, [rig.drive], guide.check) as loop,
    ):
        bring_lever_home(loop, rig)
        supply = float(np.mean([motor.get("present_input_voltage") for motor in rig.motors]))
        loop.restart()
        move = swing_lever(loop, _ROUNDS)
    went = math.degrees(np.ptp(move.angle))
    advice = "is it free, are its screws tight, is the supply on? then repeat this step"
    whole = math.degrees(2 * STEP)
    require(went >= _FOLLOWS * whole, "drive", f"the lever went {went:.1f}°", f"{whole:.0f}°", advice)
    answer = answer_to(move, guide.spec)
    found = f"the head turns by {answer.share:+.2f} of the lever, {100 * answer.misfit:.0f} % of it unexplained"
    advice = "is the board on the head plate, the joint free, and x up? then repeat this step"
    is_answer = answer.misfit < _MISFIT and _SHARES[0] < abs(answer.share) < _SHARES[1]
    require(is_answer, "IMU", found, "an answer to the lever's steps", advice)
    sign = 1 if answer.share > 0 else -1
    found = f"middle at {middle} counts, sense {sign:+d}; the head answers with {abs(answer.share):.2f} of its turn"
    volts, delay = "register present_input_voltage of all motors", "lever steps against the gyroscope"
    return [
        *guide.learn("drive", drive_sign=sign, drive_zero_counts=middle),
        Finding("ok", "drive", found),
        guide.measure("drive.supply_voltage", supply, _VOLT_STD, f"sinew doctor: {volts}"),
        guide.measure("imu.residual_delay", answer.delay, answer.delay_std, f"sinew doctor: {delay}"),
    ]


# The tendons: which stands where, and which way round its pulley winds.


@dataclass(frozen=True, slots=True)
class Arrangement:
    """How motors stand about the head.

    order: by tendon, from 0, the place in the list of motors. turns: of the frame about x in quarters. off: the most
    that the board and one tendon together lean away from where they belong [deg].
    """

    order: tuple[int, ...]
    turns: int
    off: float


def arrange(directions: Sequence[float], *, is_labelled: bool = True) -> Arrangement | None:
    """Return how motors, listed as they are believed to stand, do stand; None where two stand in one place.

    directions: in which each pulls the head, from y towards z of the frame about x that the board is held to be mounted
    in [rad]; it may be mounted in quarter turns of it. is_labelled: whether the list means anything. That is taken for
    true which leaves the fewest motors misplaced; of two like that, the fewest turns, and these first where the list
    means nothing.
    """
    count = len(directions)
    pitch = math.tau / count
    found = []
    for turns in range(4):
        turned = np.asarray(directions) - turns * math.pi / 2
        mean = float(np.angle(np.exp(1j * count * turned).sum())) / count
        slots = np.rint((turned - mean) / pitch).astype(int) % count
        if len(set(slots)) == count:
            off = float(np.abs(np.angle(np.exp(1j * (turned - slots * pitch)))).max())
            misplaced = int((slots != np.arange(count)).sum())
            key = (misplaced, turns) if is_labelled else (turns, misplaced)
            order = tuple(np.argsort(slots).tolist())
            found.append((abs(mean) > math.pi / 5, *key, Arrangement(order, turns, math.degrees(off))))
    return min(found, key=lambda each: each[:3])[-1] if found else None


def _find_tendons(guide: Guide) -> list[Finding]:
    wiring = guide.spec.wiring
    count = len(wiring.tendon_ids)
    pulls: list[Pull] = []
    for index in range(count):
        with (
            guide.open_rig(rewired(guide.spec, tendon_pull=(1,) * count)) as (rig, clock),
            moving(rig, clock, [rig.tendons[index]], guide.check) as loop,
        ):
            pulls.append(pull_tendon(loop, rig, index))
    if faults := [_no_pull(rig, index, pull) for index, pull in enumerate(pulls) if not pull.sense]:
        return faults
    directions = [math.atan2(-pull.lean[0], pull.lean[1]) for pull in pulls]
    # A frame that was only chosen for the chip's axis up says nothing of the turn; then the order of the ids does.
    is_chosen = guide.is_turned and "imu_axes" not in wiring.measured
    there = arrange(directions, is_labelled=guide.is_labelled or is_chosen)
    found = f"the head leans towards {', '.join(f'{math.degrees(value):.0f}°' for value in directions)}"
    advice = "two pull in one direction: is every cable through its own guide? then repeat this step"
    require(there is not None, "tendons", found, f"{360 // count}° apart", advice)
    assert there is not None
    findings = guide.learn(
        "IMU",
        imu_axes=turned_frame(wiring.imu_axes, there.turns),
        tendon_ids=tuple(wiring.tendon_ids[motor] for motor in there.order),
        tendon_pull=tuple(pulls[motor].sense for motor in there.order),
    )
    if there.off > _SKEWED:
        found = f"a tendon stands {there.off:.0f}° off its place along the board's axes"
        advice = "mount the board along its axes; levelling takes longer else"
        findings.append(Finding("warning", "IMU", found, f"within {_SKEWED:.0f}°", advice))
    for tendon, motor in enumerate(there.order, start=1):
        pull = pulls[motor]
        found = f"id {wiring.tendon_ids[motor]}, sense {pull.sense:+d}, contact after {1e3 * pull.turned:.1f} mm"
        findings.append(Finding("ok", f"tendon {tendon}", found))
    return findings


def _no_pull(rig: Rig, index: int, pull: Pull) -> Finding:
    name, milliampere = f"motor {rig.tendons[index].id}", 1e3 * pull_current(rig)
    if pull.turned < 1e-3:
        found = f"its horn went {1e3 * pull.turned:.1f} mm of cable at {milliampere:.0f} mA"
        return Finding("fault", name, found, "a horn that turns", "is the pulley blocked? free it")
    found = f"no cable pulls within {1e3 * pull.turned:.0f} mm either way at {milliampere:.0f} mA"
    advice = "is its cable on the pulley and through the guide? take up its slack by hand, or let it off where a move "
    advice += "that was cut short left it taut, then repeat this step"
    return Finding("fault", name, found, "a head that leans", advice)


def _examine_all(guide: Guide) -> list[Finding]:
    with guide.open_rig(guide.spec) as (rig, clock):
        roll = call_roll(rig)
        if not roll.is_complete:
            return roll.findings
        _await_rest(rig, clock)
        findings = examine_present(rig, clock, roll, listen_s=1.0)
    return [finding for finding in findings if finding.severity != "note"]


STEPS = (
    Step("devices", "who is on the bus, with which id and baud", _find_devices),
    Step("settings", "what the motors must hold", _set_up),
    Step("board", "which way up the sensor is", _find_up),
    Step("lever", "its middle and sense, the supply's voltage, the sensor's delay; it moves by ±6°", _find_lever),
    Step("tendons", "which motor pulls which tendon; one at a time pulls lightly", _find_tendons),
    Step("check", "the whole bench as a run will find it; nothing moves", _examine_all),
)
"""What the guide does, in this order. Each needs what those before it found."""
