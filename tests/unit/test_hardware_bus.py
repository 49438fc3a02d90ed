"""The bus on a line in memory: answers, silence, damage, lateness, refusal, and what is counted."""

from collections.abc import Callable

import pytest
from tests.unit.hardware_line import Arrivals, Line, ManualClock, Slave

from sinew.hardware.bus import Bus, BusTiming, Outcome, Reply
from sinew.hardware.codec import REBOOT, Status, encode

TIMING = BusTiming(baud=1_000_000, return_delay=500e-6, latency=0.005)


def bench(*slaves: Slave, retries: int = 1) -> tuple[Bus, Line, ManualClock]:
    clock = ManualClock()
    line = Line(clock, *(slaves or (Slave(1), Slave(2), Slave(3))))
    return Bus(line, clock, TIMING, retries), line, clock


def flipped(wire: bytes) -> bytes:
    return wire[:-3] + bytes([wire[-3] ^ 0x10]) + wire[-2:]


def only_first(change: bytes) -> Arrivals:
    return [(0.0, change)]


def test_a_sync_read_gives_every_device_in_the_order_asked() -> None:
    bus, _, _ = bench()
    replies = bus.sync_read(126, 10, [3, 1, 2])
    assert [(device, reply.data) for device, reply in replies.items()] == [
        (d, bytes(range(126, 136))) for d in (3, 1, 2)
    ]


def test_an_absent_device_is_silent_after_all_retries() -> None:
    bus, line, _ = bench(Slave(1, absent=True), retries=2)
    reply = bus.read(1, 132, 4)
    assert (reply.outcome, reply.attempts, len(line.sent)) == (Outcome.SILENT, 3, 3)


@pytest.mark.parametrize("absent", [1, 2, 3])
def test_one_absent_device_does_not_cost_the_data_of_the_others(absent: int) -> None:
    bus, _, _ = bench(*(Slave(device, absent=device == absent) for device in (1, 2, 3)))
    replies = bus.sync_read(126, 10, [1, 2, 3])
    assert {device for device, reply in replies.items() if reply.ok} == {1, 2, 3} - {absent}
    assert replies[absent].outcome in (Outcome.SILENT, Outcome.DAMAGED)


def test_without_retries_a_group_is_asked_once_and_who_answered_is_kept() -> None:
    bus, line, _ = bench(Slave(1), Slave(2, absent=True), Slave(3), retries=0)
    replies = bus.sync_read(126, 10, [1, 2, 3])
    assert ([device for device, reply in replies.items() if reply.ok], len(line.sent)) == ([1, 3], 1)


def test_a_silent_device_costs_no_more_than_the_timeout() -> None:
    bus, _, clock = bench(Slave(1, absent=True), retries=0)
    before = clock.time
    bus.read(1, 132, 4)
    # 14 bytes out, 17 back (4 of data, stuffed at worst) at 10 µs each, 0.5 ms return delay, 5 ms latency.
    assert clock.time - before == pytest.approx(31 * 10e-6 + 0.5e-3 + 5e-3)


def test_a_damaged_answer_is_never_data_and_is_asked_for_again() -> None:
    bus, line, _ = bench()
    line.spoil = lambda n, wire: only_first(flipped(wire) if n == 0 else wire)
    reply = bus.read(1, 132, 4)
    assert (reply.data, reply.attempts) == (bytes([132, 133, 134, 135]), 2)


@pytest.mark.parametrize(
    ("came", "outcome"),
    [
        (lambda wire: wire[:-1], Outcome.DAMAGED),  # cut off, and not silence
        (lambda wire: encode(Status(9, 0, b"1234")), Outcome.SILENT),  # a stray of another id
        (lambda wire: encode(Status(1, 0, b"12")), Outcome.WRONG_LENGTH),  # though its CRC is right
    ],
)
def test_what_is_no_answer_is_no_data(came: Callable[[bytes], bytes], outcome: Outcome) -> None:
    bus, line, _ = bench(retries=0)
    line.spoil = lambda n, wire: only_first(came(wire))
    reply = bus.read(1, 132, 4)
    assert (reply.outcome, reply.data, bus.statistics.strays) == (outcome, b"", int(outcome is Outcome.SILENT))


def test_an_answer_that_comes_byte_by_byte_behind_garbage_is_taken() -> None:
    bus, line, _ = bench()
    line.spoil = lambda n, wire: [(i * 1e-5, bytes([b])) for i, b in enumerate(b"\x00\xff\xff\xfd\x00\x01" + wire)]
    assert bus.read(1, 132, 4).attempts == 1


def test_a_late_answer_is_not_taken_for_the_answer_to_the_next_question() -> None:
    bus, line, _ = bench(retries=0)
    # The bus gives up after 5.81 ms (see above); this comes after 6.3 ms, before a prompt answer to the next question.
    line.spoil = lambda n, wire: [(0.0053 if n == 0 else 0.0, wire)]
    assert bus.read(1, 132, 4).outcome is Outcome.SILENT
    assert bus.read(1, 140, 4).data == bytes([140, 141, 142, 143])


def test_the_bus_waits_for_quiet_again_after_each_late_answer() -> None:
    bus, line, _ = bench(retries=0)
    # After 6.3 ms as above, and again 0.5 ms later, before an answer to what would be asked after the first of them.
    line.spoil = lambda n, wire: [(0.0053, wire), (0.0058, wire)] if n == 0 else only_first(wire)
    bus.read(1, 132, 4)
    assert bus.read(1, 140, 4).data == bytes([140, 141, 142, 143])


def test_the_bus_waits_for_quiet_after_an_answer_of_a_wrong_length() -> None:
    bus, line, _ = bench(retries=0)
    short = encode(Status(1, 0, b"\x01"))
    line.spoil = lambda n, wire: [(0.0, short), (0.0005, wire)] if n == 0 else only_first(wire)
    assert bus.read(1, 132, 4).outcome is Outcome.WRONG_LENGTH
    assert bus.read(1, 140, 4).data == bytes([140, 141, 142, 143])


def test_our_own_echo_is_not_taken_for_an_answer() -> None:
    bus, line, _ = bench()
    line.echo = True
    assert bus.read(1, 132, 4).data == bytes([132, 133, 134, 135])


def test_an_alert_is_reported_for_its_device_only_and_the_data_are_good() -> None:
    bus, _, _ = bench(Slave(1), Slave(2, error=0x80), Slave(3))
    replies = bus.sync_read(126, 10, [1, 2, 3])
    assert [(reply.ok, reply.alert) for reply in replies.values()] == [(True, False), (True, True), (True, False)]


def test_a_refusal_says_why_and_is_not_repeated() -> None:
    bus, line, _ = bench(Slave(1, error=0x87), retries=3)
    reply = bus.write(1, 11, b"\x05")
    assert (reply.outcome, reply.number, reply.alert, len(line.sent)) == (Outcome.REFUSED, 7, True, 1)


def test_a_packet_that_reached_the_device_damaged_is_sent_again() -> None:
    bus, line, _ = bench()
    line.spoil = lambda n, wire: only_first(encode(Status(1, 3)) if n == 0 else wire)
    assert bus.write(1, 116, bytes(4)).attempts == 2


def test_a_reboot_is_never_repeated() -> None:
    bus, line, _ = bench(Slave(1, absent=True), retries=5)
    bus.reboot(1)
    assert [packet.code for packet in line.sent] == [REBOOT]


def test_a_line_that_never_falls_silent_does_not_hold_the_bus_for_ever() -> None:
    bus, line, clock = bench(retries=1)
    for i in range(3000):
        line.put(b"\x55", i * 1e-4)
    before = clock.time
    assert not bus.read(9, 132, 4).ok
    assert clock.time - before < 0.1


def test_statistics_add_up() -> None:
    bus, line, _ = bench(Slave(1), Slave(2, absent=True), Slave(3, error=0x80))
    line.spoil = lambda n, wire: only_first(flipped(wire) if n == 0 else wire)
    bus.read(1, 132, 4)
    bus.read(2, 132, 4)
    bus.read(3, 132, 4)
    s = bus.statistics
    assert (s.transactions, s.retries, s.answers, s.damaged, s.silent, s.crc_errors) == (5, 2, 2, 1, 2, 1)
    # A read is 14 bytes; an answer of four data bytes is 15.
    assert (s.sent_bytes, s.received_bytes, s.alerts, s.discarded_bytes) == (5 * 14, 3 * 15, 1, 15)


def test_a_reply_says_in_a_sentence_what_happened() -> None:
    reply = Reply(4, Outcome.REFUSED, number=7, alert=True, attempts=2)
    facts = ("device 4", "error number", "locked while the torque is on", "asked 2 times", "hardware_error_status")
    assert [fact for fact in facts if fact not in str(reply)] == []


def test_a_doubled_answer_is_not_taken_for_the_answer_to_the_next_question() -> None:
    bus, line, _ = bench()
    line.spoil = lambda n, wire: only_first(wire * 2)
    bus.read(1, 132, 4)
    assert bus.read(1, 140, 4).data == bytes([140, 141, 142, 143])
