"""What an IMU node answers, whoever it is: Sinew's emulator, the firmware on this computer, the firmware in QEMU."""

import random

import pytest
from tests.firmware.parties import GYRO_COUNTS, NODE, AnyNode, QemuNode, fast, get, statuses

from sinew.hardware import codec as ask
from sinew.hardware.codec import HEADER, Instruction, Read, Status, Write, crc16, encode
from sinew.hardware.registers import FILTER_DELAYS_US, OPENCR_NODE

CONTROL, LEVEL, ID, BAUD_RATE, DELAY = 50, 68, 7, 8, 9
INSTRUCTION, DATA_RANGE, DATA_LENGTH, ACCESS = 2, 4, 5, 7
GYRO = b"".join(count.to_bytes(2, "little", signed=True) for count in GYRO_COUNTS)
PATTERN = b"\xff\xff\xfd"


def ok(data: bytes = b"") -> list[Status]:
    return [Status(NODE, 0, data)]


def refused(number: int) -> list[Status]:
    return [Status(NODE, number)]


def test_a_ping_tells_the_model(node: AnyNode) -> None:
    (answer,) = statuses(node.exchange(ask.ping(NODE)))
    assert (answer.id, answer.error, answer.params[:2], len(answer.params)) == (NODE, 0, b"\x00\x74", 3)


def test_the_firmware_version_of_a_ping_is_that_of_the_register(node: AnyNode) -> None:
    (answer,) = statuses(node.exchange(ask.ping(NODE)))
    assert answer.params[2] == get(node, "firmware_version")


def test_every_register_is_there_and_begins_as_the_page_says(node: AnyNode) -> None:
    told = {row.name: get(node, row.name) for row in OPENCR_NODE if row.initial is not None}
    assert told == {row.name: row.initial for row in OPENCR_NODE if row.initial is not None}


def test_readings_that_look_like_a_header_come_whole(node: AnyNode) -> None:
    assert GYRO.startswith(PATTERN)
    assert node.exchange(ask.read(NODE, 32, 6)) == ok(GYRO)


def test_roll_and_pitch_are_those_of_the_specific_force(node: AnyNode) -> None:
    # atan2(-1000, 2000) and atan2(-16384, hypot(1000, 2000)) in tenths of a degree.
    assert (get(node, "roll"), get(node, "pitch"), get(node, "yaw")) == (-266, -822, 0)


REFUSED = [
    *((ask.read(NODE, *place), ACCESS) for place in ((0, 77), (75, 2), (76, 1), (0xFFFF, 2), (12, 4), (0, 0xFFFF))),
    *((Instruction(NODE, ask.READ, params), DATA_LENGTH) for params in (b"", b"\x32", b"\x32\0\1", b"\x32\0\1\0\0")),
    (ask.write(NODE, 0, b"\1\2"), ACCESS),  # can only be read
    (ask.write(NODE, 12, b"\1"), ACCESS),  # no register
    (ask.write(NODE, 32, b"\1\2"), ACCESS),
    (ask.write(NODE, CONTROL, b"\1\2"), ACCESS),  # runs into no register
    (ask.write(NODE, 76, b"\1"), ACCESS),
    (ask.write(NODE, 0xFFFF, b"\1\2"), ACCESS),
    (ask.write(NODE, LEVEL, b"\3"), DATA_RANGE),
    (ask.write(NODE, ID, b"\xfd"), DATA_RANGE),
    (ask.write(NODE, BAUD_RATE, b"\x08"), DATA_RANGE),
    (ask.write(NODE, ID, b"\1\3\xff"), DATA_RANGE),  # the last of three
    (ask.reg_write(NODE, 32, b"\1\2"), ACCESS),
    (Instruction(NODE, ask.FACTORY_RESET, b"\x03"), DATA_RANGE),
    *((Instruction(NODE, code, b"\1\2"), INSTRUCTION) for code in (0x00, ask.CLEAR, 0x20, 0x7F, 0xEE)),
]


@pytest.mark.parametrize(("wire", "number"), REFUSED)
def test_what_may_not_be_is_refused_and_leaves_nothing_for_action(
    node: AnyNode, wire: Instruction, number: int
) -> None:
    assert node.exchange(wire) == refused(number)
    assert node.exchange(ask.action(NODE)) == refused(INSTRUCTION)
    assert get(node, "id") == NODE


@pytest.mark.parametrize(
    "wire",
    [
        ask.ping(NODE - 1),
        Instruction(ask.BROADCAST, ask.SYNC_READ, b"\x20\0\6\0" + bytes((NODE, NODE))),  # twice
        Instruction(ask.BROADCAST, ask.BULK_READ, bytes((NODE, 32, 0, 6))),  # cut off
        Instruction(ask.BROADCAST, ask.SYNC_READ, b"\x20\0\6\0"),  # nobody
        ask.sync_read(32, 6, [1, 2]),
    ],
)
def test_what_is_not_for_it_or_makes_no_sense_is_not_answered(node: AnyNode, wire: Instruction) -> None:
    assert node.exchange(wire, {1: None, 2: None}, answers=False) == []


def test_what_is_written_is_read_back(node: AnyNode) -> None:
    assert node.exchange(ask.write(NODE, CONTROL, b"\x55")) == ok()
    assert get(node, "imu_control") == 0x55


def test_a_write_to_all_is_obeyed_and_not_answered(node: AnyNode) -> None:
    assert node.exchange(ask.write(ask.BROADCAST, CONTROL, b"\7"), answers=False) == []
    assert get(node, "imu_control") == 7


def test_a_registered_write_waits_for_action(node: AnyNode) -> None:
    assert node.exchange(ask.reg_write(NODE, CONTROL, b"\x09")) == ok()
    before = get(node, "imu_control"), get(node, "registered_instruction")
    assert node.exchange(ask.action(NODE)) == ok()
    assert (before, get(node, "imu_control"), get(node, "registered_instruction")) == ((0, 1), 9, 0)


HEADERS = PATTERN + PATTERN  # of others, and to be waited for


@pytest.mark.parametrize(
    ("wire", "others", "own"),
    [
        (ask.sync_read(32, 6, [1, 2, NODE]), {1: b"abcdef", 2: b"ghijkl"}, Status(NODE, 0, GYRO)),
        (ask.sync_read(32, 6, [1, NODE]), {1: HEADERS}, Status(NODE, 0, GYRO)),
        (
            ask.bulk_read([Read(1, 126, 10), Read(2, 132, 4), Read(NODE, 32, 6)]),
            {1: bytes(10), 2: PATTERN + b"\0"},
            Status(NODE, 0, GYRO),
        ),
        (ask.sync_read(200, 4, [1, NODE]), {1: b"abcd"}, Status(NODE, ACCESS)),
    ],
)
def test_a_group_is_read_in_its_order(node: AnyNode, wire: Instruction, others: dict[int, bytes], own: Status) -> None:
    assert node.exchange(wire, others) == [*(Status(one, 0, data) for one, data in others.items()), own]


@pytest.mark.parametrize("silent", [[1], [2], [1, 2], [1, 2, 3, 4, 5]])
def test_after_silent_predecessors_it_answers_in_the_same_cycle(node: AnyNode, silent: list[int]) -> None:
    ids = range(1, 1 + max(2, len(silent)))
    reads = [*(Read(device, 126, 10) for device in ids), Read(NODE, 32, 6)]
    others = {device: None if device in silent else bytes(10) for device in ids}
    heard = statuses(node.exchange(ask.bulk_read(reads), others))
    assert heard[-1:] == ok(GYRO)
    assert [status.id for status in heard[:-1]] == [device for device in ids if device not in silent]


@pytest.mark.parametrize(
    ("wire", "others", "own"),
    [
        (ask.sync_read(32, 6, [NODE], fast=True), {}, Status(NODE, 0, GYRO)),
        *(
            (ask.sync_read(32, 6, [1, 2, NODE], fast=True), {1: b"123456", 2: data}, Status(NODE, 0, GYRO))
            for data in (b"abcdef", HEADERS, HEADER + b"\xc8\x03", HEADER + b"\1\4")
        ),
        (ask.bulk_read([Read(1, 126, 10), Read(NODE, 32, 6)], fast=True), {1: bytes(10)}, Status(NODE, 0, GYRO)),
        (ask.sync_read(200, 4, [NODE], fast=True), {}, Status(NODE, ACCESS, bytes(4))),  # zeros and the error
    ],
)
def test_in_a_fast_read_it_goes_on_with_the_packet_of_the_others(
    node: AnyNode, wire: Instruction, others: dict[int, bytes], own: Status
) -> None:
    parts = [*(Status(one, 0, data) for one, data in others.items()), own]
    assert fast(node.exchange(wire, others), [len(part.params) for part in parts]) == parts


def test_a_fast_read_ends_where_one_before_it_is_silent(node: AnyNode) -> None:
    assert node.exchange(ask.sync_read(32, 6, [1, NODE], fast=True), {1: None}, answers=False) == []
    assert node.exchange(ask.read(NODE, 32, 6)) == ok(GYRO)


def test_its_part_is_found_behind_others_that_look_like_a_header(node: AnyNode) -> None:
    parts = [Write(1, 116, PATTERN + b"\xfd"), Write(NODE, CONTROL, b"\x42"), Write(2, 116, PATTERN)]
    assert node.exchange(ask.bulk_write(parts), answers=False) == []
    assert get(node, "imu_control") == 0x42


def test_a_group_write_that_makes_no_sense_changes_nothing(node: AnyNode) -> None:
    twice = bytes((CONTROL, 0, 1, 0, NODE, 1, NODE, 2))
    cut_off = bytes((NODE, CONTROL, 0, 2, 0, 7))
    node.exchange(Instruction(ask.BROADCAST, ask.SYNC_WRITE, twice), answers=False)
    node.exchange(Instruction(ask.BROADCAST, ask.BULK_WRITE, cut_off), answers=False)
    assert get(node, "imu_control") == 0


@pytest.mark.parametrize(("level", "reads", "writes"), [(0, False, False), (1, True, False), (2, True, True)])
def test_what_is_answered_goes_by_the_status_return_level(node: AnyNode, level: int, reads: bool, writes: bool) -> None:
    node.exchange(ask.write(NODE, LEVEL, bytes((level,))))
    read = node.exchange(ask.read(NODE, 32, 6), answers=reads)
    group = node.exchange(ask.sync_read(32, 6, [NODE]), answers=reads)
    written = node.exchange(ask.write(NODE, CONTROL, b"\1"), answers=writes)
    assert (read, group, written) == (ok(GYRO) * reads, ok(GYRO) * reads, ok() * writes)
    assert len(node.exchange(ask.ping(NODE))) == 1


def test_the_answer_to_a_new_id_comes_from_the_old_one(node: AnyNode) -> None:
    assert node.exchange(ask.write(NODE, ID, b"\x0c")) == ok()
    assert node.exchange(ask.ping(NODE), answers=False) == []
    assert [status.id for status in statuses(node.exchange(ask.ping(12)))] == [12]


def test_id_and_return_delay_outlive_a_reboot_and_the_rest_does_not(node: AnyNode) -> None:
    node.exchange(ask.write(NODE, ID, b"\x0c"))
    for address, data in ((DELAY, b"\x05"), (CONTROL, b"\x07"), (LEVEL, b"\x02")):
        assert node.exchange(ask.write(12, address, data)) == [Status(12)]
    assert node.exchange(ask.reboot(12)) == [Status(12)]
    node.rest(0.5)
    told = [statuses(node.exchange(ask.read(12, address, 1)))[0].params[0] for address in (ID, DELAY, CONTROL, LEVEL)]
    assert told == [12, 5, 0, 2]


@pytest.mark.parametrize(("keep", "node_id", "delay"), [(b"\xff", NODE, 0), (b"\1", 12, 0), (b"\2", 12, 0)])
def test_a_factory_reset_keeps_what_it_is_told_to(node: AnyNode, keep: bytes, node_id: int, delay: int) -> None:
    node.exchange(ask.write(NODE, DELAY, b"\x05"))
    node.exchange(ask.write(NODE, ID, b"\x0c"))
    assert node.exchange(Instruction(12, ask.FACTORY_RESET, keep)) == [Status(12)]
    node.rest(0.5)
    answers = statuses(node.exchange(ask.read(node_id, DELAY, 1)))
    assert answers == [Status(node_id, 0, bytes((delay,)))]


def test_a_factory_reset_of_all_does_not_give_all_one_id(node: AnyNode) -> None:
    node.exchange(ask.write(NODE, ID, b"\x0c"))
    node.exchange(Instruction(ask.BROADCAST, ask.FACTORY_RESET, b"\xff"), answers=False)
    assert len(node.exchange(ask.ping(12))) == 1


def test_another_baud_counts_after_the_answer_and_outlives_a_reboot(node: AnyNode) -> None:
    assert node.exchange(ask.write(NODE, BAUD_RATE, b"\1")) == ok()
    if node.knows_time:
        assert node.exchange(ask.ping(NODE), answers=False) == []
    node.baud = 57_600
    assert node.exchange(ask.reboot(NODE)) == ok()
    node.rest(0.5)
    assert get(node, "baud_rate") == 1


def test_an_instruction_right_behind_garbage_is_heard(node: AnyNode) -> None:
    wire = encode(ask.read(NODE, 32, 6))
    for garbage in (
        b"\xff",
        b"\xff\xff",
        PATTERN,
        HEADER,
        HEADER + b"\xc8\xff\x07\x02",
        wire[:-1],
        b"\x00\x55",
        HEADER * 3,
    ):
        assert statuses(node.exchange(garbage + wire)) == ok(GYRO), garbage.hex()


def test_what_is_damaged_is_not_answered(node: AnyNode) -> None:
    wire = encode(ask.write(NODE, CONTROL, b"\x33"))
    for at in range(4, len(wire)):
        damaged = wire[:at] + bytes((wire[at] ^ 0x10,)) + wire[at + 1 :]
        if not isinstance(node, QemuNode):  # which would take half a minute
            assert node.exchange(damaged, answers=False) == [], at
    assert get(node, "imu_control") == 0


def test_what_is_not_stuffed_is_not_carried_out(node: AnyNode) -> None:
    body = HEADER + bytes((ask.BROADCAST, 11, 0, ask.SYNC_WRITE, CONTROL, 0, 3, 0)) + bytes((NODE,)) + PATTERN
    node.exchange(body + crc16(body).to_bytes(2, "little"), answers=False)
    assert get(node, "imu_control") == 0


def test_the_clock_is_that_of_the_answer_and_not_of_the_question(node: AnyNode) -> None:
    node.exchange(ask.write(NODE, DELAY, b"\xfa"))  # 500 µs
    clock = get(node, "clock") * 1e-6
    answered, heard = node.latched
    assert abs(answered - clock) <= 20e-6
    assert answered - heard + 2e-6 >= 500e-6
    assert answered - heard < 600e-6


def test_the_clock_is_latched_after_those_who_answer_before(node: AnyNode) -> None:
    ids = [1, 2, 3, NODE]
    row = OPENCR_NODE["clock"]
    heard = statuses(node.exchange(ask.sync_read(row.address, 4, ids), {1: None, 2: None, 3: None}))
    answered, _ = node.latched
    assert abs(answered - int.from_bytes(heard[-1].params, "little") * 1e-6) <= 20e-6


def clock_and_samples(node: AnyNode) -> tuple[int, int]:
    (answer,) = statuses(node.exchange(ask.read(NODE, OPENCR_NODE["clock"].address, 8)))
    return int.from_bytes(answer.params[:4], "little"), int.from_bytes(answer.params[4:], "little")


def test_samples_are_counted_and_none_is_lost(node: AnyNode) -> None:
    started, before = clock_and_samples(node)
    node.rest(0.2)
    ended, after = clock_and_samples(node)
    assert (after - before) * get(node, "sample_period") == pytest.approx(
        ended - started, abs=2 * get(node, "sample_period")
    )
    assert get(node, "lost_samples") == 0


def test_a_sample_is_never_older_than_two_periods(node: AnyNode) -> None:
    place = OPENCR_NODE["sample_time"].address
    period = get(node, "sample_period")
    for _ in range(10):
        (answer,) = statuses(node.exchange(ask.read(NODE, place, 8)))
        taken, clock = (int.from_bytes(answer.params[at : at + 4], "little") for at in (0, 4))
        assert 0 <= clock - taken <= 2 * period


def test_the_chip_and_its_delay_are_told(node: AnyNode) -> None:
    assert get(node, "filter_delay") == FILTER_DELAYS_US[get(node, "who_am_i")]
    assert get(node, "hardware_error_status") == 0


def test_a_hundred_random_streams_leave_it_answering(node: AnyNode) -> None:
    chance = random.Random(5)
    for _ in range(100):
        node.exchange(chance.randbytes(chance.randrange(1, 40)), answers=False) if node.knows_time else None
    assert node.exchange(ask.read(NODE, 32, 6)) == ok(GYRO)
