"""The sweep of a linear joint in closed form, through a sensor chain in closed form."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy import signal

from sinew.measure.files.netcdf import provenance
from sinew.measure.recording import Segment, build_recording
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig

SAMPLE_HZ = 200.0


@dataclass(frozen=True)
class Joint:
    """I φ̈ + d φ̇ + k φ = -I_l θ̈ with D = d/(2√(kI)) and the share I_l/I."""

    natural_hz: float = 3.2
    damping: float = 0.08
    share: float = 0.65

    def transfer(self, frequency_hz):
        ratio = np.asarray(frequency_hz) / self.natural_hz
        return self.share * ratio**2 / (1 - ratio**2 + 2j * self.damping * ratio)

    @property
    def resonance_hz(self) -> float:
        return self.natural_hz / np.sqrt(1 - 2 * self.damping**2)


@dataclass(frozen=True)
class Sensing:
    """Delays, noise and jitter of the recorded signals, in SI; the defaults are those of the paper's bench."""

    low_pass_hz: float = 41.0
    residual_delay_s: float = 0.4e-3
    average_samples: int = 3
    drive_delay_s: float = 0.4e-3
    noise_rad_s: float = np.deg2rad(0.08)
    bias_rad_s: float = np.deg2rad(0.05)
    jitter_s: float = 0.1e-3
    lsb_rad: float = 2 * np.pi / 4096


QUIET = replace(Sensing(), noise_rad_s=0.0, jitter_s=0.0, lsb_rad=0.0)


def rig_with(sensing: Sensing, delay_std_s: float = 0.0) -> RigSpec:
    """Return the paper's rig with this sensing in its delay budget."""
    values = {
        "imu.low_pass": sensing.low_pass_hz,
        "imu.residual_delay": sensing.residual_delay_s,
        "imu.delay_std": delay_std_s,
        "bus.drive_delay": sensing.drive_delay_s,
    }
    return load_rig("paper").with_values(values)


def gyro_chain(sensing: Sensing, frequency_hz: float) -> complex:
    """What the gyroscope's filter, delay and average make of exp(jωt), written out term by term."""
    s = 2j * np.pi * frequency_hz
    corner = 2 * np.pi * sensing.low_pass_hz
    chain = corner**2 / (s**2 + np.sqrt(2) * corner * s + corner**2) * np.exp(-s * sensing.residual_delay_s)
    return chain * np.mean([np.exp(-s * i / SAMPLE_HZ) for i in range(sensing.average_samples)])


def sweep(
    joints,
    frequency_hz,
    *,
    repeats: int = 1,
    periods: int = 5,
    drive_amplitude=None,
    nominal_deg: float = 20.0,
    sensing: Sensing = QUIET,
    late_s=None,
    seed: int = 0,
    transient: float = 0.0,
) -> xr.Dataset:
    """Return the recorded steady groups of joints, one pretension each (0, 1, 2 ... mm).

    drive_amplitude: of the lever against frequency [rad]; nominal if None. late_s: extra delay of each joint's torsion.
    transient: initial amplitude of a free decay in each group [rad].
    """
    random = np.random.default_rng(seed)
    columns = {name: [] for name in ("time_s", "drive_command_rad", "drive_rad", "gyro_rad_s")}
    segments, sizes, clock = [], [], 0.0
    noise_filter = signal.butter(2, sensing.low_pass_hz, fs=SAMPLE_HZ)
    for p, joint in enumerate(joints):
        for r in range(repeats):
            for f in frequency_hz:
                omega = 2 * np.pi * f
                count = round(periods / f * SAMPLE_HZ)
                true = clock + np.arange(count) / SAMPLE_HZ
                clock = true[-1] + random.uniform(1, 2) / SAMPLE_HZ
                size = np.deg2rad(nominal_deg) if drive_amplitude is None else drive_amplitude(f)
                torsion = size * joint.transfer(f) * gyro_chain(sensing, f)
                if late_s is not None:
                    torsion = torsion * np.exp(-1j * omega * late_s[p])
                turn = np.exp(1j * omega * true)
                rate = (1j * omega * torsion * turn).imag
                if transient:
                    free = 2j * np.pi * joint.natural_hz - joint.damping * 2 * np.pi * joint.natural_hz
                    rate = rate + (transient * free * np.exp(free * (true - true[0]))).real
                columns["time_s"].append(true)
                columns["drive_command_rad"].append((np.deg2rad(nominal_deg) * turn).imag)
                columns["drive_rad"].append((size * np.exp(-1j * omega * sensing.drive_delay_s) * turn).imag)
                columns["gyro_rad_s"].append(rate)
                segments.append(Segment("steady", float(p), float(f), nominal_deg, r))
                sizes.append(count)
    samples = {name: np.concatenate(values) for name, values in columns.items()}
    total = samples["time_s"].size
    coloured = signal.lfilter(*noise_filter, random.normal(size=total + 50))
    coloured = np.convolve(coloured, np.ones(sensing.average_samples) / sensing.average_samples, "same")[50:]
    rate = samples["gyro_rad_s"] + sensing.bias_rad_s + sensing.noise_rad_s * coloured
    samples["gyro_rad_s"] = np.stack([rate, 0 * rate, 0 * rate], axis=1)
    samples["time_s"] = samples["time_s"] + sensing.jitter_s * random.normal(size=total).clip(-3, 3)
    if sensing.lsb_rad:
        samples["drive_rad"] = np.round(samples["drive_rad"] / sensing.lsb_rad) * sensing.lsb_rad
    return build_recording(samples, segments, sizes, provenance("twin", seed=seed))
