"""This is where a stream of bytes becomes packets again, whatever has happened to it on the way.

The decoder believes a packet only if header, length, stuffing and CRC agree. It looks for the next header in every
byte that no packet has used up, also in those of a packet that turned out broken: garbage costs no packet after it.
"""

from dataclasses import dataclass

from sinew.hardware.codec import (
    BROADCAST,
    HEADER,
    HIGHEST_ID,
    LONGEST,
    STATUS,
    FastStatus,
    Instruction,
    Packet,
    Status,
    crc16,
    is_stuffed,
    remove_stuffing,
)

__all__ = ["Decoder"]

_BEFORE_BODY = 7  # header, id and length
_BROKEN, _INCOMPLETE = "broken", "incomplete"


@dataclass(slots=True)
class _Found:
    """A packet and where in the buffer it ends."""

    packet: Packet
    stop: int


class Decoder:
    """Turns chunks of bytes into packets; no input makes it raise, and it never holds more than one packet's bytes.

    A header that appears inside a stuffed packet proves that packet broken, and the decoder goes over to the new one at
    once. Inside a fast status, which is not stuffed, it may be data: then both are followed, and the one that is whole
    and has the right CRC first wins.

    crc_errors: packets of full length whose CRC was wrong.
    discarded: bytes that belonged to no packet.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.crc_errors = 0
        self.discarded = 0

    @property
    def rest(self) -> bytes:
        """The bytes kept because they may be the beginning of a packet."""
        return bytes(self._buffer)

    def reset(self) -> None:
        """Forget the bytes kept: what comes now has nothing to do with them."""
        self._drop(len(self._buffer))

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that these bytes complete, in the order of the stream."""
        self._buffer += data
        packets: list[Packet] = []
        while (found := self._next()) is not None:
            packets.append(found)
        return packets

    def _next(self) -> Packet | None:
        """Return the next whole packet and drop the bytes up to its end; drop what cannot become one."""
        buffer = self._buffer
        if not buffer:
            return None
        pending: int | None = None
        at = buffer.find(HEADER)
        while at >= 0:
            found = self._look(at, counting=pending is None)
            if isinstance(found, _Found):
                self._drop(at)
                del buffer[: found.stop - at]
                return found.packet
            if found is _INCOMPLETE and pending is None:
                pending = at
            at = buffer.find(HEADER, at + 1)
        self._drop(self._beginning() if pending is None else pending)
        return None

    def _beginning(self) -> int:
        """Return where a header begins that the end of the buffer cuts off; the end where there is none."""
        size = len(self._buffer)
        for kept in range(min(3, size), 0, -1):
            if self._buffer.endswith(HEADER[:kept]):
                return size - kept
        return size

    def _look(self, at: int, *, counting: bool) -> _Found | str:
        """Return the packet whose header is at `at`, or why there is none (yet).

        counting: whether a wrong CRC is news; inside a pending packet the same bytes are looked at again and again.
        """
        buffer = self._buffer
        body = at + _BEFORE_BODY
        if len(buffer) <= body:
            return _INCOMPLETE
        device, length, code = buffer[at + 4], buffer[at + 5] | buffer[at + 6] << 8, buffer[body]
        known = device <= HIGHEST_ID or device == BROADCAST
        fast = device == BROADCAST and code == STATUS
        shortest = 5 if fast else 4 if code == STATUS else 3
        if not known or not shortest <= length <= LONGEST:
            return _BROKEN
        stop = body + length
        whole = len(buffer) >= stop
        if not fast and not is_stuffed(buffer[body : min(stop - 2, len(buffer))], whole=whole):
            return _BROKEN
        if not whole:
            return _INCOMPLETE
        if crc16(buffer[at : stop - 2]) != buffer[stop - 2] | buffer[stop - 1] << 8:
            self.crc_errors += counting
            return _BROKEN
        if fast:
            return _Found(FastStatus(bytes(buffer[body + 1 : stop])), stop)
        params = remove_stuffing(bytes(buffer[body : stop - 2]))
        if code == STATUS:
            return _Found(Status(device, params[1], params[2:]), stop)
        return _Found(Instruction(device, code, params[1:]), stop)

    def _drop(self, size: int) -> None:
        self.discarded += size
        del self._buffer[:size]
