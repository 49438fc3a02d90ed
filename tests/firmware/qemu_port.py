"""A pseudo-terminal to the firmware in QEMU, for masters that know no more than a port.

QEMU's line has no baud, and bytes that come one by one at this computer's pace are slower than the node waits. So each
instruction is gathered and announced, and the board plays it to the node at the baud, in its own time
(firmware/qemu/main.cpp); what the node says goes to the master as it comes.
"""

import os
import pty
import select
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.firmware.parties import QemuNode

from sinew.hardware.codec import FACTORY_RESET, HEADER, REBOOT

_INSTRUCTION = 7  # where a packet has it
_BEHIND_LENGTH = 7


@contextmanager
def qemu_port(image: Path, folder: Path) -> Iterator[str]:
    """Give the path of a port to the node while QEMU runs."""
    party = QemuNode(image, folder)
    master, slave = pty.openpty()
    ended, end = os.pipe()
    try:
        tty.setraw(slave)
        relay = threading.Thread(target=_relay, args=(party, master, ended))
        relay.start()
        try:
            yield os.ttyname(slave)
        finally:
            os.write(end, b"x")
            relay.join()
    finally:
        for descriptor in (master, slave, ended, end):
            os.close(descriptor)
        party.close()


def _relay(party: QemuNode, master: int, ended: int) -> None:
    said = b""
    while True:
        ready = select.select([master, party.line, ended], [], [])[0]
        if ended in ready:
            return
        if party.line in ready:
            os.write(master, party.line.recv(4096))
        if master in ready:
            said += os.read(master, 4096)
        while size := _first_packet(said):
            packet, said = said[:size], said[size:]
            party.tell(packet, restarts=packet[_INSTRUCTION] in (REBOOT, FACTORY_RESET))


def _first_packet(data: bytes) -> int:
    """Return how long the packet is that data begin with, 0 where it is not whole."""
    if len(data) < _BEHIND_LENGTH:
        return 0
    assert data.startswith(HEADER), f"a master began an instruction with {data[:4].hex(' ')}"
    size = _BEHIND_LENGTH + int.from_bytes(data[5:7], "little")
    return size if len(data) >= size else 0
