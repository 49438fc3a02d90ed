"""The doctor and the inertial sensor: its rate, its bias, gravity at rest, and how it is mounted."""

import math

import pytest
from tests.unit.bench_ward import Ward
from tests.unit.emulator_stand_in import paper_rig

from sinew.bench.doctor import Finding, examine_chip, examine_imu, judge_chip, judge_imu, listen_to_imu
from sinew.hardware.bus import BusTiming
from sinew.hardware.imu import ImuReading, NodeReport

AXES = ("+x", "+y", "+z")


@pytest.fixture
def ward() -> Ward:
    return Ward()


def test_rate_bias_and_gravity_of_a_sensor_at_rest_are_told(ward: Ward) -> None:
    findings = examine_imu(ward.rigged, ward.port)
    assert [f.severity for f in findings] == ["ok"]
    assert findings[0].found.startswith("200 samples/s, bias ")


def test_the_sensor_is_listened_to_for_two_seconds_and_no_sample_is_missed(ward: Ward) -> None:
    begun = ward.port.now()
    samples, answers = listen_to_imu(ward.rigged, ward.port)
    assert ward.port.now() - begun == pytest.approx(2.0, abs=0.02)
    assert len(samples) == pytest.approx(400, abs=2)
    assert answers == pytest.approx(800, abs=2)


def samples(
    force: tuple[float, float, float] = (9.81, 0, 0), gyro: float = 0.0, swing: float = 0.0, period: int = 5000
) -> list[ImuReading]:
    return [
        ImuReading((gyro + swing * math.sin(i), 0.0, 0.0), force, (2**32 - 300_000 + period * i) % 2**32, 0.0)
        for i in range(400)
    ]


def test_missed_samples_do_not_lower_the_rate() -> None:
    holes = [sample for i, sample in enumerate(samples()) if i % 3 and i % 7]
    assert judge_imu(holes, AXES)[0].found.startswith("200 samples/s")


@pytest.mark.parametrize(
    ("told", "found"),
    [
        (samples(period=20_000), "50 samples/s"),
        (samples(gyro=math.radians(2.5)), "bias of 2.5 °/s"),
        (samples(gyro=math.radians(2.5), swing=math.radians(5)), "rates vary by 3.5 °/s"),  # its bias is not judged
        (samples((4.9, 0, 0)), "4.90 m/s² at rest"),
    ],
)
def test_what_is_wrong_about_samples_is_named(told: list[ImuReading], found: str) -> None:
    assert [finding.found for finding in judge_imu(told, AXES)[1:]] == [found]


def test_a_bus_too_slow_for_the_sensor_is_no_fault_of_the_sensor() -> None:
    ward = Ward(baud=57_600)
    ward.rig.line.host_baud = 57_600
    ward.bus.timing = BusTiming(57_600)
    findings = examine_imu(ward.rigged, ward.port)
    assert [f.severity for f in findings] == ["ok"]
    assert findings[0].found.startswith("at least ")


@pytest.mark.parametrize(
    ("force", "axes", "advised"),
    [
        ((0, 0, 9.81), AXES, '["+z", "+x", "+y"]'),
        ((-9.81, 0, 0), AXES, '["-x", "+y", "-z"]'),
        ((0, -9.81, 0), AXES, '["-y", "+z", "-x"]'),
        ((0, 9.81, 0), ("+z", "+x", "+y"), '["+x", "+y", "+z"]'),
    ],
)
def test_a_sensor_that_is_mounted_otherwise_is_a_fault_with_axes_that_put_x_up(
    force: tuple[float, float, float], axes: tuple[str, ...], advised: str
) -> None:
    findings = judge_imu(samples(force), axes)
    assert findings[-1].severity == "fault"
    assert advised in findings[-1].advice


def chip_found(chip: int, delay_ms: float, origin: str = "data sheet") -> Finding:
    """Return what is said of a chip where the rig assumes 5.9 ms, within 0.5 ms."""
    imu = paper_rig().imu
    residual = imu.residual_delay.model_copy(update={"origin": origin})
    return judge_chip(NodeReport(0, chip, 1e-3 * delay_ms), imu.model_copy(update={"residual_delay": residual}))


def test_the_chip_is_named_with_its_delay(ward: Ward) -> None:
    (finding,) = examine_chip(ward.rigged)
    assert (finding.severity, finding.found) == ("ok", "MPU-9250 (0x71), late by 5.90 ms")


@pytest.mark.parametrize(
    ("chip", "delay_ms", "origin", "severity"),
    [
        *((0xE0, delay, "data sheet", severity) for delay, severity in ((6.39, "ok"), (5.41, "ok"))),
        *((0xE0, delay, "data sheet", "warning") for delay in (6.41, 3.109)),
        (0xE0, 3.109, "measured", "note"),  # is believed more than the chip's
        (0x12, 5.9, "data sheet", "warning"),  # an unknown chip
    ],
)
def test_a_delay_that_differs_by_more_than_the_rigs_uncertainty_is_a_warning(
    chip: int, delay_ms: float, origin: str, severity: str
) -> None:
    assert chip_found(chip, delay_ms, origin).severity == severity


@pytest.mark.parametrize("how", ["no such registers", "silence"])
def test_a_board_of_older_firmware_is_a_note(ward: Ward, how: str) -> None:
    ward.rig.imu.registers["who_am_i"] = 0
    if how == "silence":
        ward.rig.line.disturb_up = lambda now, data: []
    assert [finding.severity for finding in examine_chip(ward.rigged)] == ["note"]
