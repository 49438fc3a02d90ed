"""Who is on the bus: looked for at every baud, told apart by model, and given an id and a baud of its own."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

from sinew.bench.doctor import model_name
from sinew.hardware.bus import Bus, Clock, Outcome
from sinew.hardware.configuration import answer_everything
from sinew.hardware.motor import RETRIES, Motor
from sinew.hardware.registers import BAUD_RATES, IMUS, MOTORS, encode_raw
from sinew.hardware.rig import Rig
from sinew.measure.errors import DeviceError, PortError
from sinew.plan.rig import RigSpec
from sinew.plan.servo import SERVOS

OpenRig = Callable[[RigSpec], AbstractContextManager[tuple[Rig, Clock]]]
"""Opens the port at a rig's baud, and gives it back."""

NEW_BAUD = 57_600
"""Of a motor from the factory."""

SLOWEST = 9_600

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
    asked = list(bauds) or list(dict.fromkeys([*first, *sorted(BAUD_RATES, reverse=True)]))
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
    if found.id != number:
        with open_rig(at_baud(spec, found.baud)) as (rig, _):
            motor = Motor(rig.bus, name, found.id, MOTORS[found.number])
            answer_everything(motor)
            motor.require_torque_off("to get another id")
            _write_blind(motor, "id", number)
            _expect(rig.bus, name, number, found, found.baud)
    if found.baud != baud:
        with open_rig(at_baud(spec, found.baud)) as (rig, _):
            motor = Motor(rig.bus, name, number, MOTORS[found.number])
            answer_everything(motor)
            motor.require_torque_off("to get another baud")
            _write_blind(motor, "baud_rate", BAUD_RATES.index(baud))
    with open_rig(at_baud(spec, baud)) as (rig, _):
        _expect(rig.bus, name, number, found, baud)


def _write_blind(motor: Motor, register: str, count: int) -> None:
    """Write once and take no answer: it may come from the old id, or at a baud that is no longer heard."""
    row = motor.table[register]
    motor.bus.write(motor.id, row.address, encode_raw(row, count), retries=0)


def _expect(bus: Bus, name: str, number: int, found: Seen, baud: int) -> None:
    for _ in range(1 + RETRIES):
        reply = bus.ping(number)
        if reply.ok and int.from_bytes(reply.data[:2], "little") == found.number:
            return
    raise DeviceError(
        f"{name}, found as {found}, does not answer as id {number} at {baud} baud after that was written ({reply}); "
        "switch the supply off and on, and repeat this step"
    )
