"""The emulated wire: times by the byte count, who answers when, and what is spoiled."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.unit.emulator_stand_in import Bench, paper_rig

from sinew.hardware import codec as ask
from sinew.hardware.bus import Outcome
from sinew.hardware.codec import Decoder, Read, Status, encode

BYTE = 10e-6  # s at 1 Mbps
TENDONS = [1, 2, 3, 4]


def answers(bench: Bench, data: bytes, seconds: float = 0.1) -> list[tuple[float, bytes]]:
    """Send bytes at the present time and return what came, and when since then."""
    rig, start = bench.rig, bench.rig.time
    rig.receive(data, start)
    came = []
    while (event := rig.next_event()) <= start + seconds:
        if got := rig.transmit(event):
            came.append((event - start, got))
    rig.advance(start + seconds)
    return came


def statuses(came: list[tuple[float, bytes]]) -> list[Status]:
    return [packet for packet in Decoder().feed(b"".join(data for _, data in came)) if isinstance(packet, Status)]


# The packets of the manual's examples.
@pytest.mark.parametrize(
    ("instruction", "status"),
    [
        ("FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89", "FF FF FD 00 01 04 00 55 00 A1 0C"),
        ("FF FF FD 00 01 09 00 04 68 00 C8 00 00 00 AE 8E", "FF FF FD 00 01 04 00 55 00 A1 0C"),
        ("FF FF FD 00 01 03 00 08 2F 4E", "FF FF FD 00 01 04 00 55 00 A1 0C"),
        ("FF FF FD 00 01 04 00 06 01 A1 E6", "FF FF FD 00 01 04 00 55 00 A1 0C"),
        ("FF FF FD 00 01 08 00 10 01 44 58 4C 22 B1 DC", "FF FF FD 00 01 04 00 55 00 A1 0C"),
        ("FF FF FD 00 01 08 00 20 01 43 54 52 4C 16 F5", "FF FF FD 00 01 04 00 55 00 A1 0C"),
    ],
    ids=["write", "reg write", "reboot", "factory reset", "clear", "control table backup"],
)
def test_the_manuals_packets_get_the_manuals_answers(instruction: str, status: str) -> None:
    came = answers(Bench(paper_rig(tendon_model="XM430-W350")), bytes.fromhex(instruction))
    assert b"".join(data for _, data in came) == bytes.fromhex(status)


@pytest.mark.parametrize("code", [0, 1, 100, 254])
def test_an_answer_takes_instruction_return_delay_and_answer_on_the_wire(code: int) -> None:
    bench = Bench(return_delay=code)
    [(came, _)] = answers(bench, encode(ask.read(1, 132, 4)))
    assert came == pytest.approx(14 * BYTE + code * 2e-6 + 15 * BYTE, abs=1e-9)


@pytest.mark.parametrize(("baud", "code"), [(9_600, 0), (57_600, 1), (115_200, 2), (4_500_000, 7)])
def test_wire_time_goes_by_the_baud(baud: int, code: int) -> None:
    bench = Bench(paper_rig(baud=baud), return_delay=0)
    [(came, _)] = answers(bench, encode(ask.ping(1)), 1.0)
    assert bench.rig.motors[1].registers["baud_rate"] == code
    assert came == pytest.approx((10 + 14) * 10 / baud, abs=1e-9)


def test_a_sync_read_takes_the_sum_of_its_parts() -> None:
    bench = Bench(return_delay=250)
    came = answers(bench, encode(ask.sync_read(126, 10, TENDONS)))
    assert came[-1][0] == pytest.approx((14 + 4 + 4 * 21) * BYTE + 4 * 500e-6, abs=1e-9)


@pytest.mark.parametrize("fast", [False, True])
def test_a_silent_device_silences_the_motors_behind_it(fast: bool) -> None:
    came = answers(Bench(), encode(ask.sync_read(132, 4, [1, 77, 2, 3], fast=fast)))
    heard = [status.id for status in statuses(came)]
    assert (heard, sum(len(data) for _, data in came)) == (([], 8 + 8) if fast else ([1], 15))


def test_the_node_goes_on_behind_a_silent_device_after_its_time_and_the_motors_behind_the_node_answer() -> None:
    bench = Bench(return_delay=0)
    came = answers(bench, encode(ask.bulk_read([Read(1, 132, 4), Read(77, 132, 4), Read(200, 0, 2), Read(2, 132, 4)])))
    assert [status.id for status in statuses(came)] == [1, 200, 2]
    assert came[1][0] - came[0][0] == pytest.approx((15 + 13) * BYTE, abs=1e-9)


def test_a_fast_sync_read_is_one_packet_without_gaps() -> None:
    bench = Bench(return_delay=100)
    came = answers(bench, encode(ask.sync_read(132, 4, TENDONS, fast=True)))
    wire = b"".join(data for _, data in came)
    assert len(wire) == 8 + 4 * 8
    assert came[-1][0] == pytest.approx((18 + 40) * BYTE + 200e-6, abs=1e-9)


def test_a_fast_read_ends_at_a_device_that_does_not_know_it() -> None:
    bench = Bench()
    bench.rig.motors[3].firmware = 44
    came = answers(bench, encode(ask.sync_read(0, 2, [1, 3, 2], fast=True)))
    assert [part.id for part in ask.fast_blocks(b"".join(data for _, data in came), [2, 2, 2])] == [1]


def test_two_motors_with_one_id_spoil_each_other() -> None:
    bench = Bench()
    bench.rig.motors[2].registers["id"] = 1
    bench.plant.angles[0] = 0.7
    reply = bench.bus.read(1, 132, 4)
    assert reply.outcome is Outcome.DAMAGED


def test_a_master_that_talks_into_an_answer_spoils_both() -> None:
    bench = Bench(return_delay=0)
    rig, start = bench.rig, bench.rig.time
    rig.receive(encode(ask.read(1, 0, 60)), start)
    rig.receive(encode(ask.write(2, 65, b"\x01")), start + 20 * BYTE)
    rig.advance(start + 0.1)
    assert not statuses([(0.0, rig.transmit(start + 0.1))])
    assert bench.get(2, "led") == 0


@pytest.mark.parametrize(("gap", "heard"), [(1.4e-3, [1]), (1.6e-3, []), (50e-3, [])])
def test_a_pause_of_more_than_1_5_ms_ends_an_instruction(gap: float, heard: list[int]) -> None:
    bench, packet = Bench(), encode(ask.ping(1))
    bench.rig.receive(packet[:7], 0.0)
    bench.rig.receive(packet[7:], 7 * BYTE + gap)
    bench.rig.advance(1.0)
    assert [status.id for status in statuses([(0.0, bench.rig.transmit(1.0))])] == heard


def damaged(packet: bytes, at: int = -1) -> bytes:
    return packet[:at] + bytes((packet[at] ^ 0x10,)) + packet[at:][1:]


def test_an_instruction_with_a_wrong_crc_is_answered_with_error_3_and_not_carried_out() -> None:
    bench = Bench()
    came = answers(bench, damaged(encode(ask.write(1, 65, b"\x01"))))
    assert (statuses(came), bench.get(1, "led")) == ([Status(1, 3)], 0)


@pytest.mark.parametrize(
    ("level", "answered"), [(0, [True, False, False]), (1, [True, True, False]), (2, [True, True, True])]
)
def test_a_wrong_crc_is_answered_by_the_status_return_level(level: int, answered: list[bool]) -> None:
    bench = Bench()
    bench.put(1, "status_return_level", level)
    packets = [encode(part) for part in (ask.ping(1), ask.read(1, 132, 4), ask.write(1, 65, b"\x01"))]
    assert [statuses(answers(bench, damaged(packet))) == [Status(1, 3)] for packet in packets] == answered


@pytest.mark.parametrize("packet", [ask.ping(), ask.sync_read(132, 4, TENDONS), ask.ping(77)])
def test_nobody_answers_a_wrong_crc_that_is_for_all_or_for_nobody_there(packet: ask.Instruction) -> None:
    assert not answers(Bench(), damaged(encode(packet)))


@settings(max_examples=200, deadline=None)
@given(
    chunks=st.lists(
        st.one_of(
            st.binary(max_size=30),
            st.builds(
                lambda device, code, params: encode(ask.Instruction(device, code, params)),
                st.sampled_from([1, 2, 5, 200, 254]),
                st.sampled_from([1, 2, 3, 4, 5, 6, 8, 0x10, 0x20, 0x82, 0x83, 0x8A, 0x92, 0x93, 0x9A, 0xAA]),
                st.one_of(
                    st.binary(max_size=20),
                    st.builds(
                        lambda at, data: at.to_bytes(2, "little") + data, st.integers(0, 700), st.binary(max_size=8)
                    ),
                    st.sampled_from(
                        [b"\x40\x00\x01", b"\x40\x00\x00", b"\x0b\x00\x00", b"\x0b\x00\x10", b"\x62\x00\x01"]
                    ),
                    st.builds(
                        lambda at, size, devices: at.to_bytes(2, "little") + size.to_bytes(2, "little") + devices,
                        st.integers(0, 700),
                        st.one_of(st.integers(0, 40), st.just(65_535)),
                        st.lists(st.sampled_from([1, 2, 3, 5, 9, 200]), unique=True).map(bytes),
                    ),
                ),
            ),
        ),
        max_size=6,
    )
)
def test_no_bytes_make_the_bench_raise(chunks: list[bytes]) -> None:
    bench = Bench()
    for chunk in chunks:
        bench.port.write(chunk)
        bench.port.read(bench.port.now() + 2e-3)
    bench.wait(0.1)
    assert bench.rig.time >= 0.1
