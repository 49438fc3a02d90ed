"""All devices at once: one transaction a reading, goals in the rig's sense, and motors set up alike."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest
from tests.unit.emulator_stand_in import Bench, paper_rig

from sinew.emulator.plant import Law
from sinew.hardware.codec import BULK_READ, BULK_WRITE, SYNC_WRITE, WRITE, Decoder, Status, encode
from sinew.hardware.registers import XH430_W350
from sinew.hardware.rig import Reading, Rig
from sinew.measure.errors import DeviceError, RegisterError

COUNT = math.tau / 4096
PERIOD = 5e-3


class Stand(Bench):
    """A bench with a rig on it, whose motors answer at once. lost: ids whose answers do not arrive."""

    def __init__(self, **wiring: object) -> None:
        super().__init__(paper_rig(**wiring), return_delay=0, imu_ppm=0.0, retries=2)
        self.rigged = Rig(self.bus, self.port, self.spec)
        self.lost: set[int] = set()
        self.delayed: dict[int, float] = {}
        self.rig.line.disturb_up = self._disturb

    def _disturb(self, now: float, data: bytes) -> list[tuple[float, bytes]]:
        device = data[4]
        return [] if device in self.lost else [(now + self.delayed.get(device, 0.0), data)]

    def readings(self, cycles: int) -> Iterator[Reading]:
        due = self.port.now()
        for _ in range(cycles):
            self.port.wait_until(due)
            due += PERIOD
            yield self.rigged.read()

    def ready(self, mode: str = "position") -> Rig:
        self.rigged.configure()
        self.rigged.set_tendon_mode(mode)  # type: ignore[arg-type]
        for motor in self.rigged.motors:
            motor.torque_on()
        return self.rigged


@pytest.fixture
def stand() -> Stand:
    return Stand()


@pytest.mark.parametrize("lost", [set(), {3}])
def test_a_reading_is_one_transaction_whoever_is_missing(lost: set[int], stand: Stand) -> None:
    stand.lost = lost
    before = stand.bus.statistics.transactions
    stand.rigged.read()
    assert stand.bus.statistics.transactions - before == 1


def test_the_drive_is_asked_first_and_the_sensor_second(stand: Stand) -> None:
    sent: list[bytes] = []
    stand.rig.line.disturb_down = lambda now, data: (sent.append(data), [(now, data)])[1]
    stand.rigged.read()
    assert sent[0][7] == BULK_READ
    assert list(sent[0][8:-2:5]) == [5, 200, 1, 2, 3, 4]


@pytest.mark.parametrize("sign", [1, -1])
def test_motors_are_read_in_the_rigs_sense(sign: int) -> None:
    stand = Stand(tendon_pull=(sign,) * 4, drive_sign=sign, drive_zero_counts=1000)
    stand.ready("current")
    plant = stand.plant
    start = [motor.angle() for motor in stand.rigged.tendons]
    for motor in range(5):
        plant.angles[motor] += 0.1 * (motor + 1)
        plant.current[motor] = 0.05 * (motor + 1)
        plant.duty[motor] = 0.1
    stand.wait(0.05)
    reading = stand.rigged.read()
    turned = [motor.angle - zero for motor, zero in zip(reading.tendons, start, strict=True) if motor is not None]
    assert turned == pytest.approx([0.1, 0.2, 0.3, 0.4], abs=2 * COUNT)
    assert [motor.current for motor in reading.tendons if motor] == pytest.approx([0.05, 0.1, 0.15, 0.2], abs=2.69e-3)
    assert reading.drive is not None
    assert reading.drive.duty == pytest.approx(0.1, abs=0.00113)


def test_one_motor_in_turn_tells_its_voltage_and_temperature(stand: Stand) -> None:
    climates = [reading.climate for reading in stand.readings(11)]  # every other cycle asks for the orders
    assert [climate.name for climate in climates if climate] == [
        "tendon 1",
        "tendon 2",
        "tendon 3",
        "tendon 4",
        "drive",
        "tendon 1",
    ]
    assert [climate.voltage for climate in climates if climate] == pytest.approx([stand.rig.supply] * 6, abs=0.05)


def test_a_missing_device_costs_only_itself(stand: Stand) -> None:
    stand.wait(0.05)  # until the sensor has a sample
    stand.lost = {3}
    reading = stand.rigged.read()
    assert [motor is None for motor in reading.tendons] == [False, False, True, False]
    assert reading.drive is not None
    assert reading.imu is not None
    assert [fault.id for fault in reading.faults] == [3]


def test_the_time_of_a_sample_is_when_the_node_took_it_also_where_the_drive_is_silent(stand: Stand) -> None:
    stand.rigged.configure()
    node = stand.rig.imu
    wrong = []
    for cycle, reading in enumerate(stand.readings(60)):
        stand.lost = {5} if cycle % 3 == 1 else set()
        assert reading.imu is not None
        taken = reading.imu.counter * 1e-6 - node.clock(0.0)
        wrong.append(abs(reading.imu.time - taken))
    assert max(wrong) < 0.1e-3


def test_steady_cycles_hold_no_stale_answer(stand: Stand) -> None:
    assert [reading.stale for reading in stand.readings(400)] == [()] * 400


def test_an_answer_that_comes_a_cycle_late_is_never_taken_for_a_new_one(stand: Stand) -> None:
    stand.rigged.configure()
    # The horn turns at 1 rad/s, so that its place tells the time.
    plant = stand.plant
    plant.angles[4], plant.laws[4] = -1.5, Law("velocity", 1.0)
    start = plant.time
    wrong = []
    for cycle, reading in enumerate(stand.readings(300)):
        stand.delayed = {5: 5e-3 + 0.1e-3 * (cycle % 90)} if cycle % 4 == 0 else {}
        if reading.drive is not None:
            wrong.append(abs(reading.drive.angle + 1.5 - (reading.time - start)))
    assert len(wrong) > 150
    assert max(wrong) < 3e-3 + 2 * COUNT


def test_at_400_hz_an_answer_that_comes_a_cycle_late_is_stale_too(stand: Stand) -> None:
    stand.rigged.configure()
    stand.rigged.pace(2.5e-3)
    believed, begin, before = [], stand.port.now(), None
    for cycle in range(200):
        stand.port.wait_until(begin + 2.5e-3 * cycle)
        reading = stand.rigged.read()
        if cycle > 100:
            track = stand.rigged._drive_present.track
            assert before is not None
            believed.append(track.could_be(before.tick, reading.time))
        before = reading.drive
    assert not any(believed)


class Liar(Stand):
    """A stand of which one answer is another's, or false: `lies` turns a status into another, once, for a device."""

    def __init__(self) -> None:
        super().__init__()
        self.rigged.configure()
        for _ in self.readings(30):
            pass
        self.lies: dict[int, Callable[[Status], list[Status]]] = {}

    def _disturb(self, now: float, data: bytes) -> list[tuple[float, bytes]]:
        lie = getattr(self, "lies", {}).pop(data[4], None)
        if lie is None:
            return super()._disturb(now, data)
        packet = Decoder().feed(data)[0]
        assert isinstance(packet, Status)
        return [(now, encode(status)) for status in lie(packet)]


def _with(status: Status, at: int, data: bytes) -> Status:
    return replace(status, params=status.params[:at] + data + status.params[at + len(data) :])


POSITION, CURRENT = 12, 6  # bytes behind realtime_tick
FALSE = {
    "a position a turn away": (3, lambda s: [_with(s, POSITION, (4096).to_bytes(4, "little"))], "its position jumps"),
    "a current of 80 A": (3, lambda s: [_with(s, CURRENT, (30_000).to_bytes(2, "little"))], "80.7 A"),
    "zeros": (200, lambda s: [_with(s, 0, bytes(18))], "no acceleration at all"),
    "two answers": (2, lambda s: [s, _with(s, POSITION, (99).to_bytes(4, "little"))], "two answers come under its id"),
    "another sample of the same time": (
        200,
        lambda s: [_with(s, 0, (30_000).to_bytes(2, "little"))],
        "two different samples have one time",
    ),
}


@pytest.mark.parametrize("what", FALSE)
def test_what_cannot_follow_the_last_reading_is_marked_and_counted(what: str) -> None:
    device, lie, words = FALSE[what]
    liar = Liar()
    liar.lies = {device: lie}
    reading, after = liar.readings(2)
    name = "IMU" if device == 200 else f"tendon {device}"
    assert [(lack.name, lack.why, words in lack.words) for lack in reading.lacks] == [(name, "impossible", True)]
    assert (liar.rigged.impossible[name], after.lacks) == (1, ())


def test_a_supply_of_nothing_is_no_climate() -> None:
    liar = Liar()
    asked = {1: lambda s: [_with(s, 24, bytes(2))]}
    for reading in liar.readings(10):
        if reading.climate is not None and reading.climate.name == "drive":
            break
    list(liar.readings(1))  # in which the drive tells its orders; tendon 1 is next
    liar.lies = asked
    (reading,) = liar.readings(1)
    assert (reading.climate, reading.tendons[0] is not None) == (None, True)
    assert reading.lacks[0].words == "it tells a supply of 0.0 V, with which none answers"


def test_an_adapter_that_returns_what_is_sent_costs_no_reading(stand: Stand) -> None:
    stand.wait(0.05)
    stand.rig.line.echoes = True
    assert [reading.lacks for reading in stand.readings(50)] == [()] * 50
    assert stand.bus.statistics.echoes == 50


def test_a_motor_that_has_started_anew_gives_no_reading_until_it_is_forgotten(stand: Stand) -> None:
    for _ in stand.readings(20):
        pass
    assert stand.bus.reboot(2).ok
    stand.wait(1.0)
    after = list(stand.readings(20))
    assert all(reading.tendons[1] is None and "tendon 2" in reading.impossible for reading in after)
    assert stand.rigged.impossible["tendon 2"] == 20
    assert "it started anew, did its supply dip?" in after[0].lacks[0].words
    stand.rigged.forget()
    assert stand.rigged.read().tendons[1] is not None


@pytest.mark.parametrize("sign", [1, -1])
def test_goal_angles_are_reached_in_the_rigs_sense(sign: int) -> None:
    stand = Stand(tendon_pull=(sign,) * 4, drive_sign=sign)
    rig = stand.ready("position-with-current-limit")
    rig.write_goals(0.3, [motor.angle() + 0.1 * i for i, motor in enumerate(rig.tendons)])
    stand.wait(1.0)
    assert stand.plant.angles == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.3], abs=2 * COUNT)


@pytest.mark.parametrize("sign", [1, -1])
def test_goal_currents_are_set_in_the_rigs_sense(sign: int) -> None:
    stand = Stand(tendon_pull=(sign,) * 4)
    rig = stand.ready("current")
    rig.write_goals(0.0, [0.1, 0.2, 0.3, 0.4])
    stand.wait(0.01)
    assert [law.goal for law in stand.plant.laws[:4]] == pytest.approx([0.1, 0.2, 0.3, 0.4], abs=2.69e-3)


def test_goals_mean_nothing_before_there_is_a_mode(stand: Stand) -> None:
    with pytest.raises(DeviceError, match="call set_tendon_mode first"):
        stand.rigged.write_goals(0.0, [0.0] * 4)


def test_a_goal_beyond_the_rigs_limits_is_not_sent(stand: Stand) -> None:
    rig = stand.ready("current")
    before = stand.bus.statistics.transactions
    with pytest.raises(RegisterError, match=r"tendon 3 cannot be told 1\.4 A"):
        rig.write_goals(0.0, [0.1, 0.1, 1.4, 0.1])
    assert stand.bus.statistics.transactions == before


def test_a_mode_that_fails_half_way_leaves_no_meaning_to_goals(stand: Stand) -> None:
    rig = stand.ready("position")
    with pytest.raises(DeviceError):
        rig.set_tendon_mode("current")
    with pytest.raises(DeviceError, match="call set_tendon_mode first"):
        rig.write_goals(0.0, [0.0] * 4)


def test_setting_up_again_writes_nothing_that_wears_the_memory_out(stand: Stand) -> None:
    stand.rigged.configure()
    written: list[int] = []

    def note(now: float, data: bytes) -> list[tuple[float, bytes]]:
        if data[7] == WRITE:
            written.append(int.from_bytes(data[8:10], "little"))
        return [(now, data)]

    stand.rig.line.disturb_down = note
    stand.rigged.configure()
    assert written
    assert min(written) >= XH430_W350.eeprom_stop


def test_nothing_is_set_up_while_a_torque_is_on(stand: Stand) -> None:
    stand.rigged.drive.torque_on()
    with pytest.raises(DeviceError, match=r"drive \(id 5\) has its torque on, expected off to be set up"):
        stand.rigged.configure()
    assert stand.get(1, "temperature_limit") == 80


def test_a_sensor_without_a_register_table_is_refused_with_those_there_are(stand: Stand) -> None:
    with pytest.raises(RegisterError, match=r"wiring\.imu_model: .* 'MX-28'; .*OpenCR node"):
        Rig(stand.bus, stand.port, paper_rig(imu_model="MX-28"))


@pytest.mark.parametrize(("mode", "instruction"), [("position", SYNC_WRITE), ("current", BULK_WRITE)])
def test_goals_are_one_packet_to_all(stand: Stand, mode: str, instruction: int) -> None:
    rig = stand.ready(mode)
    sent: list[bytes] = []
    stand.rig.line.disturb_down = lambda now, data: (sent.append(data), [(now, data)])[1]
    rig.write_goals(0.0, [3.0 if mode == "position" else 0.3] * 4)
    stand.wait(0.01)
    assert [data[7] for data in sent] == [instruction]


def test_the_time_of_a_reading_is_when_the_drives_registers_were_read(stand: Stand) -> None:
    stand.ready()
    stand.wait(0.1)
    read_at: list[float] = []
    drive = stand.rig.motors[5]
    refresh = drive.refresh
    drive.refresh = lambda address, length, now: (read_at.append(now), refresh(address, length, now))  # type: ignore[method-assign]
    stand.rigged.write_goals(0.0, [motor.angle() for motor in stand.rigged.tendons])
    read_at.clear()
    reading = stand.rigged.read()
    assert reading.time == pytest.approx(read_at[0], abs=20e-6)


def test_an_alert_is_told_with_the_reading(stand: Stand) -> None:
    stand.rig.motors[2].fail()
    reading = stand.rigged.read()
    assert [motor.alert for motor in reading.tendons if motor] == [False, True, False, False]
