"""A load cell in one tendon: in the rig's file, on the emulated bus, in the recording of twin and bench."""

import json
from pathlib import Path

import numpy as np
import pytest
from campaigns.same_numbers import TINY
from tests.contracts.emulated_bench import joint, virtual_port
from tests.contracts.virtual_run import spoken
from tests.unit.bench_virtual import virtual_bench
from tests.unit.emulator_stand_in import StandIn

from sinew.apps.dashboard.work.samples import LiveChannels
from sinew.bench.guard import Guard, Watch
from sinew.measure.errors import LostError, SpecError
from sinew.measure.files.netcdf import load_recording
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig, parse_plan, parse_rig
from sinew.twin.simulate import simulate

SECTION = """
[load_cell]
id = 30
tendon = 2
noise = { value = 0.02, unit = "N", origin = "assumed", bounds = [0, 1], note = "amplifier at 80 samples a second" }
"""


def celled(section: str = SECTION) -> RigSpec:
    return parse_rig(dump_rig(load_rig("paper")).replace("\n[wiring]", f"{section}\n[wiring]"))


def test_a_rig_with_a_load_cell_survives_the_way_through_its_file() -> None:
    assert parse_rig(dump_rig(celled())) == celled()


@pytest.mark.parametrize(
    ("found", "wrong", "word"),
    [("id = 30", "id = 5", "two devices"), ("tendon = 2", "tendon = 5", "4 tendons")],
    ids=["the drive's id", "no such tendon"],
)
def test_a_load_cell_that_does_not_fit_the_rig_is_refused(found: str, wrong: str, word: str) -> None:
    with pytest.raises(SpecError, match=word):
        celled(SECTION.replace(found, wrong))


def test_a_load_cell_tells_the_tension_of_its_own_tendon_up_to_what_two_bytes_hold() -> None:
    (cell,) = celled().sensors
    tensions, rng = np.array([[10.0, 20.0, 30.0, 40.0], [0.0, 400.0, 0.0, 0.0]]), np.random.default_rng(0)
    assert cell.reading(tensions, None).tolist() == [20.0, 400.0]
    assert cell.reading(tensions, rng) == pytest.approx([20.0, 327.67], abs=0.12)


def test_the_twin_records_the_tension_that_the_motor_of_that_tendon_pulls_with() -> None:
    rig, plan = celled(), parse_plan(TINY)
    recording = simulate(plan, rig)
    force = rig.tendons.torque_constant.value / rig.tendons.pulley_radius.value
    pulled = recording["tendon_current_a"].values[:, 1] * force
    told = recording["load_cell_n"].values
    assert (
        np.abs(told - pulled).max() < 0.5 * rig.tendons.current_lsb.value * force + 0.12
    )  # a count, 6 times the noise
    assert told * 100 == pytest.approx((told * 100).round(), abs=1e-2)  # whole counts of 10 mN


def test_the_doctor_says_what_the_load_cell_tells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(dump_rig(celled()))
    virtual_port(monkeypatch, celled())
    status, out, _ = spoken("doctor", "--port", "b", "--rig", str(path), "--json")
    told = [row["found"] for row in json.loads(out)["findings"] if row["subject"] == "load cell"]
    assert (status, [line.startswith("id 30, load_cell_n ") for line in told]) == (0, [True])


@pytest.mark.slow
def test_a_run_on_the_emulated_bench_records_what_the_load_cell_tells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, plan = tmp_path / "rig.toml", tmp_path / "tiny.toml"
    rig.write_text(dump_rig(celled()))
    plan.write_text(TINY)
    virtual_port(monkeypatch, celled(), joint(celled()))
    arguments = ("run", str(plan), "--rig", str(rig), "--port", "b", "--out", str(tmp_path / "out"), "--json")
    status, out, err = spoken(*arguments)
    assert status == 0, err
    recording = load_recording(json.loads(out)["recording"])
    told = float(recording["load_cell_n"].values.mean())
    pulled = float(recording["tendon_current_a"].values[:, 1].mean())
    tendons = celled().tendons
    assert told == pytest.approx(pulled * tendons.torque_constant.value / tendons.pulley_radius.value, rel=0.02)


def test_a_load_cell_that_falls_silent_ends_the_run_by_name() -> None:
    bench, guard = virtual_bench(celled(), plant=StandIn()), Guard(celled())
    bench.emulated.sensors[0].is_powered = False
    watch = Watch(tuple(motor.angle() for motor in bench.rig.tendons), (0.0,) * 4)

    def listen() -> None:
        for _ in range(20):
            guard.check(bench.rig.read(), (np.nan, np.nan), bench.port.now(), watch)
            bench.port.wait_until(bench.port.now() + 5e-3)

    with pytest.raises(LostError, match="load cell has not answered"):
        listen()


def test_the_live_page_has_a_trace_of_the_load_cell() -> None:
    channels = LiveChannels(celled())
    currents = [f"tendon_{i}_current_a" for i in (1, 2, 3, 4)]
    others = ["time_s", "drive_command_rad", "drive_rad", "drive_current_a", "gyro_x_rad_s", "tilt_rad", *currents]
    traces = channels.take({"load_cell_n": np.array([9.81]), **{name: np.zeros(1) for name in others}})
    assert dict(zip([one.key for one in channels.channels], traces[:, 0], strict=True))["load_cell_n"] == 9.81
