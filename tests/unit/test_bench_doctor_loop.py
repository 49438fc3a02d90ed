"""The doctor and the control loop: how long a reading takes, and what gets lost on the bus."""

import pytest
from tests.unit.bench_ward import Ward

from sinew.bench.doctor import LoopTimes, examine_bus, examine_loop, time_loop


@pytest.fixture
def ward() -> Ward:
    return Ward()


def test_the_time_of_a_reading_is_what_its_bytes_need_on_the_wire() -> None:
    ward = Ward(return_delay=0)
    ward.port.host_cost = 0.0
    times = time_loop(ward.rigged, ward.port, 0.3)
    wire = (ward.rigged.cycle_bytes - 55) * 10 / 1e6  # without the goals
    assert times.median == pytest.approx(wire, abs=0.1e-3)
    assert times.incomplete == 0


@pytest.mark.parametrize(("most", "severity"), [(3.0e-3, "ok"), (4.5e-3, "warning")])
def test_a_loop_too_slow_for_the_plan_is_a_warning(most: float, severity: str) -> None:
    times = LoopTimes(300, 2.5e-3, most, 5e-3, 0.55e-3, 0)
    assert [f.severity for f in examine_loop(times, 200.0)] == [severity]


def test_lost_and_damaged_answers_are_counted_and_told(ward: Ward) -> None:
    number = iter(range(10**6))
    ward.rig.line.disturb_up = lambda now, data: (
        [(now, data[:-1] + bytes((data[-1] ^ 1,)))] if next(number) % 50 == 0 else [(now, data)]
    )
    times = time_loop(ward.rigged, ward.port, 1.0)
    (finding,) = examine_bus(ward.rigged, times)
    assert finding.severity == "warning"
    assert f"{times.incomplete} of {times.cycles} readings incomplete" in finding.found
    assert "with a wrong CRC" in finding.found


def drop_some(ward: Ward, every: int) -> LoopTimes:
    """Lose every so many-th answer of the drive, which is asked first, and return how the readings went."""
    number = iter(range(10**6))
    ward.rig.line.disturb_up = lambda now, data: [] if data[4] == 5 and next(number) % every == 0 else [(now, data)]
    return time_loop(ward.rigged, ward.port, 1.0)


@pytest.mark.parametrize(("every", "severity"), [(2, "fault"), (3, "fault"), (5, "warning"), (20, "warning")])
def test_more_incomplete_readings_than_a_run_bears_are_a_fault(ward: Ward, every: int, severity: str) -> None:
    times = drop_some(ward, every)
    (finding,) = examine_bus(ward.rigged, times)
    assert times.incomplete / times.cycles == pytest.approx(1 / every, abs=0.02)
    assert finding.severity == severity


def test_an_instruction_that_reaches_a_device_damaged_is_told_as_an_error_of_the_bus(ward: Ward) -> None:
    damaged = iter([True])
    ward.rig.line.disturb_down = lambda now, data: [(now, data[:-1] + b"\0" if next(damaged, False) else data)]
    ward.rigged.drive.identify()
    (finding,) = examine_bus(ward.rigged, None)
    assert (finding.severity, "1 to an instruction that came damaged" in finding.found) == ("warning", True)


def test_an_adapter_that_returns_what_is_sent_is_told_as_a_note(ward: Ward) -> None:
    ward.wait(0.05)
    ward.rig.line.echoes = True
    times = time_loop(ward.rigged, ward.port, 0.2)
    found = {finding.subject: finding for finding in examine_bus(ward.rigged, times)}
    assert {subject: finding.severity for subject, finding in found.items()} == {"port": "note", "bus": "ok"}
    assert f"returned {times.cycles} of {times.cycles} packets" in found["port"].found
