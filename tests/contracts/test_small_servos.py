"""A bench of small servos, XL330-M288 at 5 V: what the doctor, the check and a whole run say of it."""

import json
from pathlib import Path

import pytest
from tests.contracts.emulated_bench import joint, virtual_port
from tests.contracts.virtual_run import spoken

from sinew.measure.files.netcdf import load_recording
from sinew.plan.rig import RigSpec
from sinew.plan.servo import SERVOS
from sinew.plan.toml import dump_rig, load_rig

SERVO = SERVOS["XL330-M288"]
PLAN = """
name = "light"
[pretension]
pretension_mm = [1]
rest_s = 0.5
[sweep]
frequency_hz = [2]
amplitude_deg = 5
settle_s = 1
periods = 3
repeats = 1
"""
# Of a joint light enough for them; what is no servo's number is invented.
SMALL = {
    "tendons.torque_constant": SERVO.stall_torque / SERVO.stall_current,
    "tendons.current_lsb": SERVO.current_lsb,
    "tendons.servo_stiffness": 8e3,
    "tendons.first_contact_tension": 2.0,
    "drive.nominal_voltage": SERVO.nominal_voltage,
    "drive.supply_voltage": SERVO.nominal_voltage,
    "drive.stall_torque": SERVO.stall_torque,
    "drive.no_load_speed": SERVO.no_load_speed,
    "drive.stall_current": SERVO.stall_current,
    "drive.current_lsb": SERVO.current_lsb,
    "drive.friction": 0.02,
    "drive.armature": 5e-4,
    "inertia.head": 1e-3,
    "inertia.lever": 1e-3,
}


def small_rig() -> RigSpec:
    data = load_rig("paper").model_dump()
    for name, value in SMALL.items():
        part, key = name.split(".")
        data[part][key] |= {"value": value, "bounds": (0.5 * value, 2 * value)}
    data["wiring"] |= {"tendon_model": SERVO.model, "drive_model": SERVO.model}
    data["limits"] |= {"voltage_v": (3.7, 6.0), "tension_n": 40.0, "tendon_current_a": 1.4, "drive_current_a": 1.4}
    return RigSpec.model_validate(data)


@pytest.fixture
def rig(tmp_path: Path) -> str:
    path = tmp_path / "small.toml"
    path.write_text(dump_rig(small_rig()))
    return str(path)


def test_the_doctor_knows_each_small_servo_by_its_answer_to_a_ping(rig: str, monkeypatch: pytest.MonkeyPatch) -> None:
    virtual_port(monkeypatch, small_rig())
    status, out, _ = spoken("doctor", "--port", "b", "--rig", rig, "--json")
    findings = json.loads(out)["findings"]
    seen = {row["subject"] for row in findings if "XL330-M288" in row["found"] and "5.0 V" in row["found"]}
    assert (status, seen) == (0, {"tendon 1", "tendon 2", "tendon 3", "tendon 4", "drive"})
    assert [row for row in findings if row["severity"] == "fault"] == []


@pytest.mark.slow
def test_a_short_plan_passes_the_check_and_runs_whole_on_small_servos(
    rig: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = tmp_path / "light.toml"
    plan.write_text(PLAN)
    spec = small_rig()
    port = virtual_port(monkeypatch, spec, joint(spec))
    assert spoken("check", str(plan), "--rig", rig)[0] == 0
    status, out, _ = spoken("run", str(plan), "--rig", rig, "--port", "b", "--out", str(tmp_path / "out"), "--json")
    told = json.loads(out)
    assert (status, told["complete"], told["is_safe"], told["doubts"]) == (0, True, True, [])
    assert port.rig.in_safe_state()
    current = load_recording(told["recording"])["tendon_current_a"].values
    assert current * 1000 == pytest.approx((current * 1000).round(), abs=1e-3)  # whole counts of 1 mA
