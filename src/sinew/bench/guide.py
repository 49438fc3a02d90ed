"""The guide's steps, one after the other: what each asks of a person, finds out, and writes into the rig.

Every step begins and ends with motors without torque, may be repeated, and does not mind what an attempt before it has
left half done. What a step finds is told as the doctor tells it; what it knows then stands in the rig.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Protocol

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
    Answer,
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


OpenRig = Callable[[RigSpec], AbstractContextManager[tuple[Rig, Clock]]]
"""Opens the port at a rig's baud, and gives it back."""

NEW_BAUD = 57_600
"""Of a motor from the factory."""

_TWINS = 4  # questions about the present, of which two devices with one id spoil the half


@dataclass(frozen=True, slots=True)
class Seen:
    """A device that answered. baud: at which. number: of its model, 0 where the answer was no good. is_double: whether
    two answer to the id."""

    id: int
    baud: int
    number: int
    is_double: bool = False

    @property
    def is_motor(self) -> bool:
        """Whether it is a motor that Sinew knows; of two with one id it is not known."""
        return self.number in MOTORS

    def __str__(self) -> str:
        twice = ", twice" if self.is_double else ""
        return f"id {self.id} at {self.baud} baud ({model_name(self.number)}{twice})"


def at_baud(spec: RigSpec, baud: int) -> RigSpec:
    """Return a rig whose bus has another baud."""
    return spec.model_copy(update={"wiring": spec.wiring.model_copy(update={"baud": baud})})


def look_around(open_rig: OpenRig, spec: RigSpec, bauds: Iterable[int] = ()) -> list[Seen]:
    """Return who answers, at bauds in this order; by default at all, the rig's and a new motor's first.

    A port need not know every baud. Raises PortError where it knows none.
    """
    first = (spec.wiring.baud, NEW_BAUD)
    asked = list(dict.fromkeys(bauds)) or list(dict.fromkeys([*first, *sorted(BAUD_RATES, reverse=True)]))
    found: list[Seen] = []
    refused: list[PortError] = []
    for baud in asked:
        try:
            with open_rig(at_baud(spec, baud)) as (rig, _):
                found += _scanned(rig.bus, baud)
        except PortError as trouble:
            refused.append(trouble)
    if len(refused) == len(asked):
        raise refused[0]
    return found


def _scanned(bus: Bus, baud: int) -> list[Seen]:
    seen = []
    for device, reply in sorted(bus.scan().items()):
        number = int.from_bytes(reply.data[:2], "little") if reply.ok else 0
        seen.append(Seen(device, baud, number, _is_double(bus, device, number)))
    return seen


def _is_double(bus: Bus, device: int, number: int) -> bool:
    """Return whether two motors answer to an id: they agree on a ping, and hardly ever on the present."""
    if number not in MOTORS:
        return False
    address, length = MOTORS[number].block(("realtime_tick", "present_temperature"))
    replies = [bus.read(device, address, length, retries=0) for _ in range(_TWINS)]
    return sum(reply.outcome is Outcome.DAMAGED for reply in replies) >= _TWINS // 2


def refuse_incomplete(seen: Sequence[Seen], spec: RigSpec) -> str:
    """Return why these are not the rig's motors, each with an id of its own; an empty text where they are."""
    doubles = [str(device) for device in seen if device.is_double]
    if doubles:
        return f"two motors share {'; '.join(doubles)}"
    motors = [device for device in seen if device.is_motor]
    shared = [number for number, times in Counter(device.id for device in motors).items() if times > 1]
    if shared:
        return f"id {shared[0]} answers at several bauds, so from several motors"
    tendon, drive = wanted_models(spec)
    wanted = Counter({tendon: len(spec.wiring.tendon_ids)}) + Counter({drive: 1})
    if Counter(device.number for device in motors) == wanted:
        return "" if tendon != drive else "tendon motors and drive are of one model, which does not tell them apart"
    texts = ", ".join(map(str, motors)) or "no motor"
    return f"found {texts}"


def wanted_models(spec: RigSpec) -> tuple[int, int]:
    """Return the model numbers of a rig's tendon motors and of its drive."""
    return SERVOS[spec.wiring.tendon_model].number, SERVOS[spec.wiring.drive_model].number


def find_sensor(seen: Sequence[Seen], spec: RigSpec) -> Seen | None:
    """Return the sensor on the head among who answered: the one with the rig's id, else any; None without one."""
    nodes = [device for device in seen if device.number in IMUS]
    return next((node for node in nodes if node.id == spec.wiring.imu_id), nodes[0] if nodes else None)


def give_id(open_rig: OpenRig, spec: RigSpec, found: Seen, name: str, number: int, baud: int) -> None:
    """Give the motor found, the only one on the bus or the only one of its id, another id and baud.

    name: what to call it. Repeating it does no harm: what was written before stays. Raises DeviceError where the motor
    has torque, or does not take it.
    """
    writes = [("id", number, number, found.baud), ("baud_rate", BAUD_RATES.index(baud), number, baud)]
    here = found.id, found.baud
    for register, count, *there in writes:
        if tuple(there) != here:
            with open_rig(at_baud(spec, found.baud)) as (rig, _):
                motor = Motor(rig.bus, name, here[0], MOTORS[found.number])
                answer_everything(motor)
                motor.require_torque_off(f"to get another {register}")
                # once, and without its answer: that may come from the old id, or at a baud that is no longer heard
                row = motor.table[register]
                rig.bus.write(motor.id, row.address, encode_raw(row, count), retries=0)
            here = there[0], there[1]
        with open_rig(at_baud(spec, here[1])) as (rig, _):
            _expect(rig.bus, name, number, found, here[1])


def _expect(bus: Bus, name: str, number: int, found: Seen, baud: int) -> None:
    for _ in range(1 + RETRIES):
        reply = bus.ping(number)
        if reply.ok and int.from_bytes(reply.data[:2], "little") == found.number:
            return
    raise DeviceError(
        f"{name}, found as {found}, does not answer as id {number} at {baud} baud after that was written ({reply}); "
        "switch the supply off and on, and repeat this step"
    )


# ---- the steps


class Person(Protocol):
    """Who stands at the bench."""

    def begin(self, step: "Step") -> None:
        """Say what comes."""
        ...

    def tell(self, finding: Finding) -> None:
        """Say what was found."""
        ...

    def do(self, words: str, act: int) -> None:
        """Ask for something to be done, and return when it is. act: its number for an emulated bench, which does it."""
        ...

    def agrees(self, question: str) -> bool:
        """Return whether it may be done."""
        ...

    def repeats(self, what: str, failed: bool) -> bool:
        """Return whether what has just ended, well or not, is to be done again; raise StoppedError to end it all."""
        ...


@dataclass(slots=True)
class Guide:
    """What the steps share.

    open_rig: gives the bench. person: who is asked. spec: the rig, as far as it is known. save: keeps it after every
    step. check: raises where the guide is to end, before every cycle of a move. timer: of the port's adapter.
    notes: what was not as the rig had it, and is put right. is_labelled: whether a motor's id says of which tendon
    people hold it to be. is_turned: whether the board is not mounted as the rig had it. unconfirmed: how a bench was
    left whose motors did not confirm that they have no torque; empty where they did.
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

    def know(self, *keys: str, **wiring: object) -> None:
        """Put keys into the wiring, and those named, too, among the measured."""
        old = self.spec.wiring
        there = {*old.measured, *wiring, *keys}
        told = tuple(name for name in Wiring.model_fields if name in there)
        new = Wiring.model_validate(old.model_dump() | wiring | {"measured": told})
        self.spec = self.spec.model_copy(update={"wiring": new})

    def suppose(self, **wiring: object) -> RigSpec:
        """Return the rig with keys of its wiring as they are not yet known to be."""
        return self.spec.model_copy(update={"wiring": self.spec.wiring.model_copy(update=wiring)})

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
    well = True
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
        well = well and not failed
        if failed:
            break
    return well


def _attempted(guide: Guide, step: Step) -> list[Finding]:
    before = guide.spec
    try:
        return step.run(guide)
    except (*TROUBLES, PortError, StartError, LimitError, LostError) as trouble:
        guide.spec = before
        if isinstance(trouble, UnconfirmedError):
            guide.unconfirmed = str(trouble)
        return [Finding("fault", step.name, str(trouble))]


# Who is there, with which id, at which baud.

_STARTS_S = 0.6


def _find_devices(guide: Guide) -> list[Finding]:
    spec = guide.spec
    seen = look_around(guide.open_rig, spec)
    sensor = find_sensor(seen, spec)
    if sensor is None:
        found = "; ".join(map(str, seen)) or "nobody answers at any baud"
        advice = "check supply, cable and plug; flash the node's firmware, and leave its board on the bus"
        return [Finding("fault", "bus", found, "the IMU's node", advice)]
    findings = []
    baud = spec.wiring.baud
    if sensor.baud != baud:
        findings.append(Finding("note", "IMU", f"{sensor.baud} baud", f"{baud} baud", "the whole bus goes there"))
    guide.know(baud=sensor.baud, imu_id=sensor.id, imu_model=IMUS[sensor.number].model)
    findings.append(Finding("ok", "IMU", str(sensor)))
    if why := refuse_incomplete(seen, guide.spec):
        findings.append(Finding("note", "bus", why, "each motor with an id of its own", "they go one by one"))
        for finding in findings:
            guide.person.tell(finding)
        return _one_by_one(guide)
    return findings + _take_as_they_are(guide, seen)


def _take_as_they_are(guide: Guide, seen: Sequence[Seen]) -> list[Finding]:
    """Keep the ids of motors that are told apart by them, and bring all to one baud."""
    wiring = guide.spec.wiring
    tendon, drive = wanted_models(guide.spec)
    motors = {device.id: device for device in seen if device.is_motor}
    ids = tuple(sorted(number for number, device in motors.items() if device.number == tendon))
    swings = next(number for number, device in motors.items() if device.number == drive)
    findings = []
    if set(ids) == set(wiring.tendon_ids) and swings == wiring.drive_id:
        ids = wiring.tendon_ids
    else:
        told = f"tendon motors {', '.join(map(str, ids))}, drive {swings}"
        expected = f"{', '.join(map(str, wiring.tendon_ids))} and {wiring.drive_id}"
        findings.append(Finding("note", "bus", told, expected, "the rig takes them as they are"))
        guide.is_labelled = False
    for device in motors.values():
        if device.baud != wiring.baud:
            give_id(guide.open_rig, guide.spec, device, f"motor {device.id}", device.id, wiring.baud)
            what = f"{device.baud} baud"
            findings.append(Finding("note", f"motor {device.id}", what, f"{wiring.baud} baud", "set"))
    guide.know(tendon_ids=ids, drive_id=swings)
    findings += [Finding("ok", f"motor {number}", model_name(motors[number].number)) for number in (*ids, swings)]
    return findings


def _one_by_one(guide: Guide) -> list[Finding]:
    """Have each motor plugged in alone, and give it the id that the rig has for it."""
    wiring, person = guide.spec.wiring, guide.person
    tendon, drive = wanted_models(guide.spec)
    labels = [f"tendon {i}" for i in range(1, len(wiring.tendon_ids) + 1)]
    wanted = [*zip(labels, wiring.tendon_ids, strict=True), ("drive", wiring.drive_id)]
    for label, number in wanted:
        what = f"the motor of {label}" if label != "drive" else "the lever's motor (the drive)"
        act = PLUG_DRIVE if label == "drive" else wanted.index((label, number)) + 1
        person.do(f"plug in {what}, alone of all motors; the board stays", act)
        person.tell(_name_one(guide, label, number, drive if label == "drive" else tendon))
    person.do("plug in all motors", PLUG_ALL)
    _await_start(guide)
    there = look_around(guide.open_rig, guide.spec, (wiring.baud,))
    if why := refuse_incomplete(there, guide.spec):
        return [Finding("fault", "bus", why, "all motors", "check that all are plugged in, and repeat this step")]
    guide.know("tendon_ids", "drive_id")
    guide.is_labelled = True
    return []


def _name_one(guide: Guide, label: str, number: int, model: int) -> Finding:
    """Give the one motor that is plugged in its id and baud. Raises DeviceError where there is another, or more."""
    _await_start(guide)
    baud = guide.spec.wiring.baud
    seen: list[Seen] = []
    for bauds in ((baud, NEW_BAUD), ()):  # where it is expected, and everywhere else after that
        seen = seen or [device for device in look_around(guide.open_rig, guide.spec, bauds) if device.is_motor]
    if len(seen) != 1 or seen[0].is_double:
        raise DeviceError(
            f"found {', '.join(map(str, seen)) or 'no motor at any baud'}, expected one motor, that of {label}; "
            "check plug and supply, and that no other motor is on the bus"
        )
    found = seen[0]
    if found.number != model:
        raise DeviceError(
            f"found {found}, expected a {model_name(model)} as {label}; plug in the right one, or correct the models "
            "in the rig's [wiring]"
        )
    give_id(guide.open_rig, guide.spec, found, label, number, baud)
    return Finding("ok", label, f"{found} is id {number} at {baud} baud now")


def _await_start(guide: Guide) -> None:
    """Wait until what was plugged in listens."""
    with guide.open_rig(guide.spec) as (_, clock):
        clock.wait_until(clock.now() + _STARTS_S)


# What the motors must hold, and what the board says at rest.

_WINDOW = ("min_position_limit", "max_position_limit")  # about a middle that is not known yet


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
        told = ", ".join(sorted({fix.register for fix in fixes}))
        if not guide.person.agrees(f"write {len(fixes)} settings ({told}) to motors whose torque is off"):
            return [*findings, Finding("fault", "motors", "settings are as they were", "written", "repeat this step")]
        written = apply_fixes(rig, clock, fixes, guide.timer)
        if refused := [finding for finding in written if finding.severity != "ok"]:
            return refused
        left = [finding for finding in examine_motors(rig, roll) if finding.severity in ("ok", "warning", "fault")]
    return [*left, Finding("ok", "motors", f"{len(fixes)} settings written: {told}")]


_CHIP = ("+x", "+y", "+z")


def _find_up(guide: Guide) -> list[Finding]:
    with guide.open_rig(guide.suppose(imu_axes=_CHIP)) as (rig, clock):
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
        guide.spec, guide.is_turned = guide.suppose(imu_axes=frame_from(up)), True
    with guide.open_rig(guide.spec) as (rig, clock):
        return findings + examine_imu(rig, clock, 1.0)


_RESTS = math.radians(1.0)
_RESTS_MOST_S = 12.0


def _await_rest(rig: Rig, clock: Clock) -> None:
    """Wait until the head rests; after 12 s whoever looks at it says that it does not."""
    stop = clock.now() + _RESTS_MOST_S
    while clock.now() < stop:
        samples, _ = listen_to_imu(rig, clock, 0.5)
        if len(samples) > 2 and np.std([sample.gyro for sample in samples], axis=0).max() < _RESTS:
            return


# The lever: its middle by hand, its sense by what the head does.

_FOLLOWS = 0.6
_MISFIT = 0.5
_SHARES = (0.1, 0.95)


def _find_lever(guide: Guide) -> list[Finding]:
    guide.person.do(
        "turn the lever by hand to its middle: along tendons 1 and 3, the cable of its motor free either way",
        TURN_LEVER,
    )
    with guide.open_rig(guide.suppose(drive_sign=1)) as (rig, _):
        widen_window(rig)
        rig.configure()
        middle = rig.drive.get_count("present_position")
    reach = math.radians(guide.spec.limits.drive_window_deg) / PULSE
    if not reach <= middle <= COUNTS_PER_TURN - 1 - reach:
        advice = "take the horn off, turn it by a quarter, put it back on; or make limits.drive_window_deg smaller"
        expected = f"{reach:.0f} to {COUNTS_PER_TURN - 1 - reach:.0f}, for a window of ±{reach * PULSE * 57.3:.0f}°"
        return [Finding("fault", "drive", f"the middle at {middle} counts", expected, advice)]
    with (
        guide.open_rig(guide.suppose(drive_sign=1, drive_zero_counts=middle)) as (rig, clock),
        moving(rig, clock, [rig.drive], guide.check) as loop,
    ):
        bring_lever_home(loop, rig)
        move = swing_lever(loop)
    went = float(np.ptp(move.angle))
    if went < _FOLLOWS * 2 * STEP:
        found = f"the lever went {math.degrees(went):.1f}°"
        advice = "is it free, are its screws tight, is the supply on? then repeat this step"
        return [Finding("fault", "drive", found, f"{math.degrees(2 * STEP):.0f}°", advice)]
    answer = answer_to(move, guide.spec)
    if fault := _unanswered(answer):
        return [fault]
    sign = 1 if answer.share > 0 else -1
    findings = []
    if sign != guide.spec.wiring.drive_sign:
        found = f"more counts turn the lever {'positively' if sign > 0 else 'negatively'}"
        findings.append(Finding("note", "drive", found, "the other way", f"drive_sign is {sign} now"))
    guide.know(drive_sign=sign, drive_zero_counts=middle)
    told = f"middle at {middle} counts, sense {sign:+d}; the head answers with {abs(answer.share):.2f} of its turn"
    return [*findings, Finding("ok", "drive", told)]


def _unanswered(answer: Answer) -> Finding | None:
    if answer.misfit < _MISFIT and _SHARES[0] < abs(answer.share) < _SHARES[1]:
        return None
    found = f"the head turns by {answer.share:+.2f} of the lever, {100 * answer.misfit:.0f} % of it unexplained"
    advice = "is the board on the head plate, the joint free, and x up? then repeat this step"
    return Finding("fault", "IMU", found, "an answer to the lever's steps", advice)


# The tendons: which stands where, and which way round its pulley winds.

_SKEWED = 20.0


@dataclass(frozen=True, slots=True)
class Arrangement:
    """How motors stand about the head.

    order: by tendon, from 0, the place in the list of motors. turns: of the frame about x in quarters. off: the most
    that the board and one tendon together lean away from where they belong [deg].
    """

    order: tuple[int, ...]
    turns: int
    off: float


def arrange(directions: Sequence[float], *, is_usual: bool = True, is_labelled: bool = True) -> Arrangement | None:
    """Return how motors, listed as they are believed to stand, do stand; None where two stand in one place.

    directions: in which each pulls the head, from y towards z of a frame about x [rad]. is_usual: whether that frame is
    the one that the board is held to be mounted in. is_labelled: whether the list means anything. The board may be
    mounted in quarter turns. That is taken for true which leaves the fewest motors misplaced; of two like that, the
    usual frame; where the list means nothing, the usual frame first.
    """
    count = len(directions)
    pitch = math.tau / count
    found = []
    for turns in range(4):
        turned = [direction - turns * math.pi / 2 for direction in directions]
        mean = float(np.angle(sum(np.exp(1j * count * value) for value in turned))) / count
        slots = [round((value - mean) / pitch) % count for value in turned]
        if len(set(slots)) == count:
            left = [value - slot * pitch for value, slot in zip(turned, slots, strict=True)]
            off = max(abs(float(np.angle(np.exp(1j * value)))) for value in left)
            misplaced = sum(slot != motor for motor, slot in enumerate(slots))
            key = (misplaced, turns) if is_labelled or not is_usual else (turns, misplaced)
            order = tuple(slots.index(tendon) for tendon in range(count))
            found.append((abs(mean) > math.pi / 5, *key, Arrangement(order, turns, math.degrees(off))))
    return min(found, key=lambda each: each[:3])[-1] if found else None


def _find_tendons(guide: Guide) -> list[Finding]:
    wiring = guide.spec.wiring
    count = len(wiring.tendon_ids)
    pulls: list[Pull] = []
    for index in range(count):
        with (
            guide.open_rig(guide.suppose(tendon_pull=(1,) * count)) as (rig, clock),
            moving(rig, clock, [rig.tendons[index]], guide.check) as loop,
        ):
            pulls.append(pull_tendon(loop, rig, index))
    if faults := [_no_pull(rig, index, pull) for index, pull in enumerate(pulls) if not pull.sense]:
        return faults
    directions = [math.atan2(-pull.lean[0], pull.lean[1]) for pull in pulls]
    is_usual = not guide.is_turned or "imu_axes" in wiring.measured
    there = arrange(directions, is_usual=is_usual, is_labelled=guide.is_labelled)
    if there is None:
        found = ", ".join(f"{math.degrees(value):.0f}°" for value in directions)
        advice = "two pull in one direction: is every cable through its own guide? then repeat this step"
        return [Finding("fault", "tendons", f"the head leans towards {found}", f"{360 // count}° apart", advice)]
    findings = _wiring_notes(guide, pulls, there)
    axes = turned_frame(wiring.imu_axes, there.turns)
    if axes != wiring.imu_axes:
        findings.append(Finding("note", "IMU", ", ".join(axes), ", ".join(wiring.imu_axes), "imu_axes are these now"))
    guide.know(
        tendon_ids=tuple(wiring.tendon_ids[motor] for motor in there.order),
        tendon_pull=tuple(pulls[motor].sense for motor in there.order),
        imu_axes=axes,
    )
    for tendon, motor in enumerate(there.order, start=1):
        pull = pulls[motor]
        told = f"id {wiring.tendon_ids[motor]}, sense {pull.sense:+d}, contact after {1e3 * pull.turned:.1f} mm"
        findings.append(Finding("ok", f"tendon {tendon}", told))
    return findings


def _wiring_notes(guide: Guide, pulls: Sequence[Pull], there: Arrangement) -> list[Finding]:
    wiring, notes = guide.spec.wiring, list[Finding]()
    for tendon, motor in enumerate(there.order):
        if motor != tendon:
            found = f"motor {wiring.tendon_ids[motor]} pulls tendon {tendon + 1}"
            notes.append(Finding("note", f"tendon {tendon + 1}", found, f"tendon {motor + 1}", "swapped in tendon_ids"))
    for motor, pull in enumerate(pulls):
        if pull.sense != wiring.tendon_pull[motor]:
            found = f"motor {wiring.tendon_ids[motor]} pulls with {'more' if pull.sense > 0 else 'fewer'} counts"
            label = f"tendon {there.order.index(motor) + 1}"
            notes.append(Finding("note", label, found, "the other way", f"tendon_pull is {pull.sense} now"))
    if there.off > _SKEWED:
        found = f"a tendon stands {there.off:.0f}° off its place along the board's axes"
        advice = "mount the board along its axes; levelling takes longer else"
        notes.append(Finding("warning", "IMU", found, f"within {_SKEWED:.0f}°", advice))
    return notes


def _no_pull(rig: Rig, index: int, pull: Pull) -> Finding:
    motor = rig.tendons[index]
    milliampere = 1e3 * pull_current(rig)
    if pull.turned < 1e-3:
        found = f"its horn went {1e3 * pull.turned:.1f} mm of cable at {milliampere:.0f} mA"
        return Finding("fault", f"motor {motor.id}", found, "a horn that turns", "is the pulley blocked? free it")
    found = f"no cable pulls within {1e3 * pull.turned:.0f} mm either way at {milliampere:.0f} mA"
    advice = (
        "is its cable on the pulley and through the guide? take up its slack by hand, or let it off where a move that "
        "was cut short left it taut, then repeat this step"
    )
    return Finding("fault", f"motor {motor.id}", found, "a head that leans", advice)


# The supply's voltage and the sensor's delay.

_ROUNDS = 3
_VOLT_STD = 0.03  # of a register in steps of 0.1 V


def _measure_constants(guide: Guide) -> list[Finding]:
    with guide.open_rig(guide.spec) as (rig, clock):
        supply = float(np.mean([motor.get("present_input_voltage") for motor in rig.motors]))
        with moving(rig, clock, [rig.drive], guide.check) as loop:
            bring_lever_home(loop, rig)
            swing = swing_lever(loop, _ROUNDS)
    answer = answer_to(swing, guide.spec)
    if fault := _unanswered(answer):
        return [fault]
    if answer.share < 0:
        found = f"the head turns with the lever ({answer.share:+.2f})"
        return [Finding("fault", "drive", found, "against it", "drive_sign is wrong: repeat the step lever")]
    volts, delay = "register present_input_voltage of all motors", "lever steps against the gyroscope"
    return [
        guide.measure("drive.supply_voltage", supply, _VOLT_STD, f"sinew doctor: {volts}"),
        guide.measure("imu.residual_delay", answer.delay, answer.delay_std, f"sinew doctor: {delay}"),
        Finding("ok", "joint", f"the lever has {answer.share:.2f} of the inertia"),
    ]


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
    Step("lever", "the lever's middle and sense; it moves by ±6°", _find_lever),
    Step("tendons", "which motor pulls which tendon; one at a time pulls lightly", _find_tendons),
    Step("constants", "the supply's voltage, the sensor's delay; the lever moves by ±6°", _measure_constants),
    Step("check", "the whole bench as a run will find it; nothing moves", _examine_all),
)
"""What the guide does, in this order. Each needs what those before it found."""
