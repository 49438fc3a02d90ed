"""The firmware built once for all its tests."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.firmware.built import built
from tests.firmware.parties import AnyNode, EmulatedNode, HostNode, QemuNode
from tools.build_firmware import build_host, build_qemu


@pytest.fixture(scope="session")
def host_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the firmware for this computer."""
    return built(build_host, tmp_path_factory.mktemp("host"), "g++")


@pytest.fixture(scope="session")
def qemu_image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the firmware for a Cortex-M7."""
    return built(build_qemu, tmp_path_factory.mktemp("qemu"), "arm-none-eabi-g++", "qemu-system-arm")


@pytest.fixture(scope="module")
def qemu_node(qemu_image: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[QemuNode]:
    """Return the firmware in QEMU, started once for a file of tests."""
    party = QemuNode(qemu_image, tmp_path_factory.mktemp("qemu-node"))
    yield party
    party.close()


@pytest.fixture(
    params=["emulator", pytest.param("host", marks=pytest.mark.slow), pytest.param("qemu", marks=pytest.mark.slow)]
)
def node(request: pytest.FixtureRequest) -> Iterator[AnyNode]:
    """Return a node as it comes from the factory, one way after the other."""
    if request.param == "qemu":
        qemu: QemuNode = request.getfixturevalue("qemu_node")
        qemu.renew()
        yield qemu
        return
    party = EmulatedNode() if request.param == "emulator" else HostNode(request.getfixturevalue("host_program"))
    yield party
    party.close()
