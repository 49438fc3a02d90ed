"""The sweep of linear joints that an ideal motor swings: every power in closed form."""

import numpy as np
import xarray as xr
from tests.unit.analysis_sweep import QUIET, Joint, rig_with, sweep

from sinew.measure.recording import build_recording, iterate_segments
from sinew.plan.toml import dump_rig

RIG = rig_with(QUIET)
VOLTS = 13.3
RESISTANCE = 12.0 / 2.3
CONSTANT = 1.9  # N m/A and V s/rad: the motor is ideal
ARMATURE = 0.009
LEVER = RIG.inertia.lever.value
JOINTS = [Joint(3.0, 0.06), Joint(4.0, 0.05)]
FREQUENCY = np.arange(1.6, 6.01, 0.2)
AMPLITUDE = np.deg2rad(20.0)
TENDON_A = 0.2


def phasors(joint: Joint, frequency_hz: float) -> tuple[complex, complex, complex]:
    """Lever, torsion and current for a lever angle of AMPLITUDE sin: of exp(jωt)/j."""
    torsion = AMPLITUDE * complex(joint.transfer(frequency_hz))
    torque = -((2 * np.pi * frequency_hz) ** 2) * (LEVER * (torsion + AMPLITUDE) + ARMATURE * AMPLITUDE)
    return AMPLITUDE, torsion, torque / CONSTANT


def truth(joint: Joint, frequency_hz: float) -> dict[str, float]:
    lever, torsion, current = phasors(joint, frequency_hz)
    speed = 2j * np.pi * frequency_hz * lever
    copper = 0.5 * RESISTANCE * abs(current) ** 2
    mechanical = 0.5 * (CONSTANT * current * np.conj(speed)).real
    return {
        "drive_power_w": copper + mechanical,
        "drive_copper_w": copper,
        "drive_mechanical_w": mechanical,
        "amplitude_rad": abs(torsion),
    }


def recorded(*, repeats: int = 2, with_volts: bool = True, noise: float = 0.0) -> xr.Dataset:
    bare = sweep(JOINTS, FREQUENCY, repeats=repeats)
    total = bare.sizes["sample"]
    random = np.random.default_rng(1004)
    current, duty = np.zeros(total), np.zeros(total)
    for _, segment, where in iterate_segments(bare):
        lever, _, phasor = phasors(JOINTS[int(segment.pretension_mm)], segment.frequency_hz)
        omega = 2 * np.pi * segment.frequency_hz
        turn = np.exp(1j * omega * bare["time_s"].values[where])
        current[where] = (phasor * turn).imag + noise * random.standard_normal(turn.size)
        duty[where] = ((RESISTANCE * phasor + CONSTANT * 1j * omega * lever) * turn).imag / VOLTS
    samples = {name: bare[name].values for name in ("time_s", "drive_command_rad", "drive_rad", "gyro_rad_s")}
    samples |= {"drive_current_a": current, "drive_pwm": duty, "tendon_current_a": np.full((total, 4), TENDON_A)}
    if with_volts:
        tendon = TENDON_A * 12.0 / 1.3 / VOLTS
        samples |= {"supply_v": np.full(total, VOLTS), "tendon_pwm": np.full((total, 4), tendon)}
    segments = [segment for _, segment, _ in iterate_segments(bare)]
    return build_recording(samples, segments, bare["row_size"].values.tolist(), bare.attrs | {"rig": dump_rig(RIG)})
