"""What holds for every packet and every stream of bytes."""

from itertools import pairwise, product

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from sinew.hardware.codec import (
    HEADER,
    LONGEST,
    Decoder,
    FastStatus,
    Instruction,
    Packet,
    Read,
    Status,
    Write,
    add_stuffing,
    bulk_read,
    bulk_write,
    crc16,
    encode,
    fast_blocks,
    is_stuffed,
    reads_of,
    remove_stuffing,
    sync_read,
    sync_write,
    writes_of,
)
from sinew.measure.errors import PacketError

# Bytes as they come near a header, three times as often as any byte.
nasty = st.lists(st.sampled_from([0xFF, 0xFF, 0xFD, 0xFD, 0x00, 0x55]) | st.integers(0, 255), max_size=40).map(bytes)
ids = st.integers(0, 252)
instructions = st.builds(
    Instruction, id=ids | st.just(254), code=st.integers(0, 255).filter(lambda code: code != 0x55), params=nasty
)
statuses = st.builds(Status, id=ids, error=st.integers(0, 255), params=nasty)
packets = instructions | statuses


def fast_status(parts: list[Status]) -> FastStatus:
    """Return what devices answer together: a device's CRC runs over all bytes from the header on."""
    length = 1 + sum(len(part.params) + 4 for part in parts)
    frame = HEADER + bytes([0xFE, length & 0xFF, length >> 8, 0x55])
    for part in parts:
        frame += bytes([part.error, part.id]) + part.params
        frame += crc16(frame).to_bytes(2, "little")
    return FastStatus(frame[8:])


def long_division(data: bytes) -> int:
    """Return the remainder of data·x¹⁶ by x¹⁶ + x¹⁵ + x² + 1 over GF(2): the CRC by its definition."""
    number = int.from_bytes(data, "big") << 16
    for bit in range(number.bit_length() - 1, 15, -1):
        if number >> bit & 1:
            number ^= 0x18005 << (bit - 16)
    return number


@given(nasty)
def test_the_crc_is_the_remainder_of_a_long_division(data: bytes) -> None:
    assert crc16(data) == long_division(data)


@given(nasty, nasty)
def test_the_crc_can_be_run_on(first: bytes, second: bytes) -> None:
    assert crc16(second, crc16(first)) == crc16(first + second)


@given(packets)
def test_a_packet_survives_its_way_over_the_wire(packet: Packet) -> None:
    assert Decoder().feed(encode(packet)) == [packet]


@pytest.mark.parametrize("size", range(9))
def test_every_payload_of_ff_fd_00_up_to_8_bytes_survives(size: int) -> None:
    payloads = [bytes(payload) for payload in product((0xFF, 0xFD, 0x00), repeat=size)]
    assert [payload for payload in payloads if remove_stuffing(add_stuffing(payload)) != payload] == []


@pytest.mark.parametrize("size", range(7))
def test_every_status_with_a_payload_of_ff_fd_00_up_to_6_bytes_survives_among_others(size: int) -> None:
    sent = [Status(1, 0, bytes(payload)) for payload in product((0xFF, 0xFD, 0x00), repeat=size)]
    assert Decoder().feed(b"".join(encode(packet) for packet in sent)) == sent


@given(nasty)
def test_stuffed_bytes_hold_no_header(payload: bytes) -> None:
    assert HEADER not in add_stuffing(payload)
    assert is_stuffed(add_stuffing(payload))


@given(st.lists(packets, max_size=6), st.data())
def test_how_the_stream_is_cut_into_chunks_makes_no_difference(sent: list[Packet], data: st.DataObject) -> None:
    stream = b"".join(encode(packet) for packet in sent)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=10)))
    decoder = Decoder()
    edges = [0, *cuts, len(stream)]
    chunks = [stream[start:stop] for start, stop in pairwise(edges)]
    assert [packet for chunk in chunks for packet in decoder.feed(chunk)] == sent


@given(st.lists(packets, min_size=1, max_size=4))
def test_every_packet_comes_out_with_its_last_byte(sent: list[Packet]) -> None:
    decoder = Decoder()
    for packet in sent:
        *but_last, last = encode(packet)
        assert decoder.feed(bytes(but_last)) == []
        assert decoder.feed(bytes([last])) == [packet]


@given(st.binary(max_size=60) | nasty, packets)
def test_the_packet_after_garbage_is_found(garbage: bytes, packet: Packet) -> None:
    found = Decoder().feed(garbage + encode(packet))
    assert found[-1:] == [packet]


@given(packets, packets, st.data())
def test_the_packet_after_one_that_was_cut_off_is_found_at_once(
    cut: Packet, packet: Packet, data: st.DataObject
) -> None:
    wire = encode(cut)
    kept = data.draw(st.integers(0, len(wire) - 1))
    stream = wire[:kept] + encode(packet)
    assume(wire not in stream)  # the FF of the next header can be just the byte that was cut off
    assert Decoder().feed(stream) == [packet]


@given(st.lists(statuses, min_size=2, max_size=5), packets, st.data())
def test_the_packet_after_a_fast_status_that_was_cut_off_is_found_at_once(
    parts: list[Status], packet: Packet, data: st.DataObject
) -> None:
    wire = encode(fast_status(parts))
    kept = data.draw(st.integers(0, len(wire) - 1))
    stream = wire[:kept] + encode(packet)
    assume(wire not in stream)  # the FF of the next header can be just the byte that was cut off
    assert Decoder().feed(stream)[-1:] == [packet]


@given(packets, st.integers(1, 0xFFFF), st.data())
def test_a_packet_with_a_burst_of_up_to_16_wrong_bits_behind_its_length_is_never_believed(
    packet: Packet, error: int, data: st.DataObject
) -> None:
    wire = encode(packet)
    shift = data.draw(st.integers(0, 8 * (len(wire) - 7) - 16))
    wrong = int.from_bytes(wire, "big") ^ error << shift
    assert Decoder().feed(wrong.to_bytes(len(wire), "big")) == []


@given(st.lists(st.binary(max_size=300) | nasty | packets.map(lambda packet: encode(packet)[:-1]), max_size=20))
def test_no_input_makes_the_decoder_raise_or_hold_more_than_one_packet(chunks: list[bytes]) -> None:
    decoder = Decoder()
    for chunk in chunks:
        decoder.feed(chunk)
        assert len(decoder.rest) <= LONGEST + 7


@given(st.lists(st.binary(max_size=40) | nasty | packets.map(encode), max_size=8))
def test_no_packet_comes_out_that_does_not_stand_whole_in_the_stream(parts: list[bytes]) -> None:
    stream = b"".join(parts)
    assert [packet for packet in Decoder().feed(stream) if encode(packet) not in stream] == []


@pytest.mark.parametrize("params", [b"\xff\xff\xfd", b"\xff\xff\xfd\x00", b"\0\xff\xff\xfd\xff\xff"])
def test_a_packet_whose_sender_did_not_stuff_is_not_believed_though_its_crc_is_right(params: bytes) -> None:
    frame = HEADER + bytes([1, len(params) + 4, 0, 0x55, 0]) + params
    assert Decoder().feed(frame + crc16(frame).to_bytes(2, "little")) == []


def test_a_wrong_crc_inside_a_fast_status_that_is_still_coming_is_not_counted_byte_by_byte() -> None:
    decoder = Decoder()
    wrong = encode(Status(1, 0, b"data"))[:-1] + b"\x00"
    for byte in encode(fast_status([Status(1, 0, wrong), Status(2, 0, bytes(20))])):
        decoder.feed(bytes([byte]))
    assert decoder.crc_errors == 0


def test_a_header_that_announces_more_than_the_longest_packet_is_not_waited_for() -> None:
    decoder = Decoder()
    decoder.feed(HEADER + bytes([1, 0xFF, 0xFF, 0x55]))
    assert decoder.rest == b""


@given(st.lists(statuses, min_size=1, max_size=6))
def test_a_fast_status_comes_apart_into_what_each_device_said(parts: list[Status]) -> None:
    (packet,) = Decoder().feed(encode(fast_status(parts)))
    assert fast_blocks(encode(packet), [len(part.params) for part in parts]) == parts


@given(st.dictionaries(ids, st.binary(min_size=4, max_size=4), min_size=1, max_size=8), st.integers(0, 661))
def test_a_device_reads_the_sync_write_that_the_master_wrote(data: dict[int, bytes], address: int) -> None:
    assert writes_of(sync_write(address, data)) == tuple(Write(d, address, part) for d, part in data.items())


@given(st.lists(ids, min_size=1, max_size=8, unique=True), st.integers(0, 661), st.integers(1, 600), st.booleans())
def test_a_device_reads_the_sync_read_that_the_master_wrote(devices: list[int], at: int, n: int, fast: bool) -> None:
    assert reads_of(sync_read(at, n, devices, fast=fast)) == tuple(Read(d, at, n) for d in devices)


@given(st.lists(st.builds(Read, ids, st.integers(0, 661), st.integers(1, 600)), min_size=1, unique_by=lambda r: r.id))
def test_a_device_reads_the_bulk_read_that_the_master_wrote(reads: list[Read]) -> None:
    assert reads_of(bulk_read(reads)) == tuple(reads)


@given(
    st.lists(
        st.builds(Write, ids, st.integers(0, 661), st.binary(min_size=1, max_size=20)),
        min_size=1,
        unique_by=lambda w: w.id,
    )
)
def test_a_device_reads_the_bulk_write_that_the_master_wrote(writes: list[Write]) -> None:
    assert writes_of(bulk_write(writes)) == tuple(writes)


@given(instructions)
def test_no_parameters_make_a_device_raise(instruction: Instruction) -> None:
    assert reads_of(instruction) is None or writes_of(instruction) is None


@pytest.mark.parametrize(
    "packet",
    [
        Instruction(253, 1),
        Instruction(255, 1),
        Instruction(1, 0x55),
        Instruction(1, 256),
        Status(254),
        Status(-1),
        Status(1, 256),
        Status(1, 0, bytes(LONGEST)),
        FastStatus(b"123"),
    ],
)
def test_a_packet_that_the_protocol_does_not_have_is_refused(packet: Packet) -> None:
    with pytest.raises(PacketError, match=r"cannot send .* expected "):
        encode(packet)
