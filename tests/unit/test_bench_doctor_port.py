"""The doctor at the port: bauds at which devices answer, and the adapter's latency timer."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.unit.bench_ward import Ward
from tests.unit.emulator_stand_in import Bench, paper_rig

from sinew.bench.doctor import Fix, apply_fixes, examine_port, list_fixes, search_bauds
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.ports import LatencyTimer, find_latency_timer, is_ftdi


@pytest.fixture
def ward() -> Ward:
    return Ward()


def test_devices_at_another_baud_are_found_and_told(ward: Ward) -> None:
    slow = Bench(paper_rig(), baud=57_600)

    @contextmanager
    def open_bus(baud: int) -> Iterator[Bus]:
        slow.rig.line.host_baud = baud
        yield Bus(slow.port, slow.port, BusTiming(baud))

    findings = search_bauds(open_bus, 1_000_000, nobody=True)
    assert [(f.severity, f.found) for f in findings] == [("fault", "id 1, 2, 3, 4, 5, 200 at 57600 baud")]
    assert "--baud 57600" in findings[0].advice


def test_one_motor_at_another_baud_is_to_be_set_like_the_others(ward: Ward) -> None:
    ward.rig.motors[2].registers["baud_rate"] = 1

    @contextmanager
    def open_bus(baud: int) -> Iterator[Bus]:
        ward.rig.line.host_baud = baud
        yield Bus(ward.port, ward.port, BusTiming(baud))

    findings = search_bauds(open_bus, 1_000_000, nobody=False)
    assert [(f.found, f.advice) for f in findings] == [
        ("id 2 at 57600 baud", "set their register baud_rate to 3, as in the other motors")
    ]


def adapter(tmp_path: Path, milliseconds: str) -> tuple[str, Path]:
    folder = tmp_path / "ttyUSB3"
    folder.mkdir()
    (folder / "latency_timer").write_text(milliseconds)
    return "/dev/ttyUSB3", tmp_path


def test_a_latency_timer_of_16_ms_is_told_and_set(ward: Ward, tmp_path: Path) -> None:
    timer = find_latency_timer(*adapter(tmp_path, "16\n"))
    findings = examine_port(timer, 1_000_000, 1_000_000)
    assert [(f.severity, f.fixable) for f in findings] == [("warning", True)]
    written = apply_fixes(ward.rigged, ward.port, list_fixes(findings), timer)
    assert timer is not None
    assert (written[0].severity, timer.read()) == ("ok", 1)


def test_a_timer_that_may_not_be_written_is_told_with_the_command_for_it(ward: Ward, tmp_path: Path) -> None:
    timer = LatencyTimer(tmp_path / "no such folder" / "latency_timer")
    written = apply_fixes(ward.rigged, ward.port, [Fix("port", "latency_timer", 16, 1)], timer)
    assert written[0].severity == "warning"
    assert "as administrator: echo 1 > " in written[0].found


@pytest.mark.parametrize("port", ["/dev/ttyACM0", "/dev/pts/4", "bench"])
def test_a_port_without_such_an_adapter_has_no_timer(tmp_path: Path, port: str) -> None:
    assert find_latency_timer(port, tmp_path) is None


def test_an_ftdi_adapter_whose_timer_is_not_shown_is_named_with_its_default(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on macOS, where nothing lists the timer, and where nothing that a user can change sets it: FTDI's AN232B-04
    gives the 16 ms and, for Windows alone, a setting; the driver of old systems had its own Info.plist (TN_105)."""
    device = "/dev/cu.usbserial-FT4THV1R"
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [SimpleNamespace(device=device, vid=0x0403)])
    (found,) = examine_port(None, 1_000_000, 1_000_000, of_ftdi=is_ftdi(device))
    assert (found.severity, found.fixable, found.expected) == ("warning", False, "1 ms")
    assert "16 ms" in found.found
    assert "settings" not in found.advice
    assert "use Linux, or an adapter without this timer, such as the OpenCR's own USB" in found.advice
    assert not is_ftdi("/dev/cu.usbmodem14101")


def test_a_baud_that_is_not_the_wirings_is_told() -> None:
    assert examine_port(None, 57_600, 1_000_000)[0].found == "57600 baud"
