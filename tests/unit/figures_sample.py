"""A campaign for the figures whose every number is a closed form: a linear joint at each pretension."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from sinew.analysis.decay.ring_down import DECAY_WINDOWS
from sinew.measure.recording import (
    RESULT_VARIABLES,
    RESULTS_SCHEMA,
    Segment,
    build_recording,
    companions,
    validate_results,
)

AMPLITUDE_DEG = 20.0
SETTLE_S, PERIODS, RECORD_S = 3.0, 5, 3.0


def drive_share(frequency_hz: np.ndarray) -> np.ndarray:
    """Return the share of the nominal drive amplitude that is reached, falling with frequency."""
    return np.interp(frequency_hz, [1.0, 2.2, 3.0, 4.3, 6.0], [0.97, 0.90, 0.70, 0.44, 0.30])


@dataclass(frozen=True)
class Joint:
    """A linear joint: undamped frequency [Hz], damping ratio, and the lever's share of the inertia."""

    natural_hz: float
    damping: float
    share: float

    @classmethod
    def at(cls, pretension_mm: float) -> "Joint":
        """Return the joint whose gain by nominal drive peaks near 3.0-4.3 Hz at 2.8-1.4 for 0-12 mm."""
        x = pretension_mm / 12.0
        natural = 3.0 + 1.3 * x**0.9
        damping = 0.075 + 0.01 * x
        unit = cls(natural, damping, 1.0)
        grid = np.linspace(1.5, 6.0, 2000)
        return cls(natural, damping, (2.8 - 1.4 * x) / float((abs(unit.response(grid)) * drive_share(grid)).max()))

    def response(self, frequency_hz: np.ndarray) -> np.ndarray:
        """Return torsion over drive, complex; a negative argument is a lag."""
        f = np.asarray(frequency_hz, dtype=float)
        return self.share * f**2 / (self.natural_hz**2 - f**2 + 2j * self.damping * self.natural_hz * f)

    @property
    def decay_rate(self) -> float:
        """Return λ [1/s]."""
        return self.damping * 2 * np.pi * self.natural_hz

    @property
    def omega(self) -> float:
        """Return the damped angular frequency [rad/s]."""
        return 2 * np.pi * self.natural_hz * float(np.sqrt(1 - self.damping**2))


def sample_recording(
    pretensions: tuple[float, ...], frequencies: np.ndarray, repeats: int = 3, sample_hz: float = 200.0
) -> xr.Dataset:
    """Return a recording with gyroscope and encoder, in the order in which a bench would run it."""
    rng = np.random.default_rng(7)
    parts: list[dict[str, np.ndarray]] = []
    segments: list[Segment] = []
    now = 0.0

    def add(segment: Segment, t: np.ndarray, drive: np.ndarray, rate: np.ndarray, command: np.ndarray) -> None:
        gyro = 0.02 * rng.standard_normal((t.size, 3))
        gyro[:, 0] += rate + 0.004
        segments.append(segment)
        parts.append({"time_s": now + t, "drive_rad": drive, "drive_command_rad": command, "gyro_rad_s": gyro})

    nominal = np.deg2rad(AMPLITUDE_DEG)
    for pretension in pretensions:
        joint = Joint.at(pretension)
        t = np.arange(int(sample_hz)) / sample_hz
        add(Segment("idle", pretension, np.nan, np.nan, 0), t, 0 * t, 0 * t, 0 * t)
        now += 1.0
        for repeat in range(repeats):
            for f in frequencies:
                counts = int(np.ceil(SETTLE_S * sample_hz)), round(PERIODS / f * sample_hz)
                t = np.arange(sum(counts)) / sample_hz
                drive, rate = _steady(joint, float(f), t)
                command = nominal * np.sin(2 * np.pi * f * t)
                for kind, s in (("settle", slice(0, counts[0])), ("steady", slice(counts[0], None))):
                    segment = Segment(kind, pretension, float(f), AMPLITUDE_DEG, repeat)
                    add(segment, t[s], drive[s], rate[s], command[s])
                now += t.size / sample_hz
        for repeat in range(repeats):
            f = round(joint.natural_hz, 2)
            stop = np.ceil(SETTLE_S * f) / f
            t = np.arange(int(np.ceil((stop + RECORD_S) * sample_hz))) / sample_hz
            drive, rate = _steady(joint, f, t)
            free = t >= stop
            drive, rate = np.where(free, 0.0, drive), np.where(free, _decay_rate(joint, f, stop, t), rate)
            command = np.where(free, 0.0, nominal * np.sin(2 * np.pi * f * t))
            for kind, s in (("settle", ~free), ("ring-down", free)):
                segment = Segment(kind, pretension, f, AMPLITUDE_DEG, repeat)
                add(segment, t[s], drive[s], rate[s], command[s])
            now += t.size / sample_hz
    samples = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    sizes = [part["time_s"].size for part in parts]
    return build_recording(samples, segments, sizes, {"source": "twin", "rig": "", "plan": ""})


def _steady(joint: Joint, f: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return drive angle [rad] and torsion rate [rad/s] of the steady oscillation; the gyroscope swings in softly."""
    amplitude = np.deg2rad(AMPLITUDE_DEG) * float(drive_share(f))
    response = complex(joint.response(f)) * amplitude
    omega = 2 * np.pi * f
    rise = 1 - np.exp(-joint.decay_rate * t)
    return amplitude * np.sin(omega * t), rise * omega * abs(response) * np.cos(omega * t + np.angle(response))


def _decay_rate(joint: Joint, f: float, stop: float, t: np.ndarray) -> np.ndarray:
    """Return the torsion rate [rad/s] of the free decay that continues the steady oscillation after `stop`."""
    response = complex(joint.response(f)) * np.deg2rad(AMPLITUDE_DEG) * float(drive_share(f))
    start = abs(response) * np.sin(np.angle(response))
    speed = 2 * np.pi * f * abs(response) * np.cos(np.angle(response))
    pole = -joint.decay_rate + 1j * joint.omega
    weight = start - 1j * (speed + joint.decay_rate * start) / joint.omega
    return np.real(weight * pole * np.exp(pole * np.maximum(t - stop, 0.0)))


def sample_results(pretensions: tuple[float, ...], frequencies: np.ndarray, repeats: int = 3) -> xr.Dataset:
    """Return results of the same campaign from the closed forms, with a spread of repeats of about one per cent."""
    rng = np.random.default_rng(11)
    f = np.asarray(frequencies, dtype=float)
    shape = (len(pretensions), f.size, repeats)
    nominal = np.deg2rad(AMPLITUDE_DEG)
    upright = {name: row for name, row in RESULT_VARIABLES.items() if "channel" not in row.dims}
    values = {name: np.full(_shape(row.dims, shape), np.nan) for name, row in upright.items()}
    values["pretension_mm"], values["frequency_hz"] = np.asarray(pretensions, dtype=float), f
    values["repeat"] = np.arange(1, repeats + 1)
    values["window_start_periods"] = np.array(DECAY_WINDOWS)
    for p, pretension in enumerate(pretensions):
        joint = Joint.at(pretension)
        for r in range(repeats):
            copy = Joint(joint.natural_hz * (1 + 0.006 * rng.standard_normal()), joint.damping, joint.share)
            response = copy.response(f) * (1 + 0.01 * rng.standard_normal())
            drive = nominal * drive_share(f)
            lag = -np.angle(response)
            for name, value in {
                "amplitude_rad": abs(response) * drive,
                "amplitude_peaks_rad": abs(response) * drive,
                "drive_amplitude_rad": drive * (1 + 0.003 * rng.standard_normal()),
                "gain": abs(response) * drive / nominal,
                "gain_harmonic": abs(response) * drive / nominal,
                "gain_measured_drive": abs(response),
                "phase_lag_rad": lag,
                "lissajous_phase_rad": lag,
                "settled": np.ones_like(f),
            }.items():
                values[name][p, :, r] = value
            _power(values, p, r, f)
            _ring_down(values, p, r, copy)
        _resonance(values, p, joint)
        _energy(values, p)
    data = {
        name: (row.dims, values[name], {"units": "rad" if row.unit == "*" else row.unit})
        for name, row in upright.items()
    }
    results = xr.Dataset(data)
    results.attrs = {"schema": RESULTS_SCHEMA, "source": "twin", "rig": "", "versions": "sinew 0.1.0", "seed": 7}
    return validate_results(results)


def _power(values: dict[str, np.ndarray], p: int, r: int, f: np.ndarray) -> None:
    """Fill in powers [W] that are simple, not those of a joint: 2 W of copper, 1 W of work, 1 W of gear."""
    share = {"drive_power_w": 4.0, "drive_drawn_w": 4.1, "drive_copper_w": 2.0, "drive_mechanical_w": 1.0}
    for name, watts in share.items():
        values[name][p, :, r] = watts * (1 + 0.01 * r) + 0 * f
    values["drive_power_std_w"][p, :, r] = 0.01
    values["holding_power_w"][p, :, r] = 0.5 * p


def _energy(values: dict[str, np.ndarray], p: int) -> None:
    """Fill in the energy that goes with `_power`, with a reduction of 80 %."""
    at = {
        "drive_power_at_resonance_w": 4.0,
        "copper_at_resonance_w": 2.0,
        "gear_at_resonance_w": 1.0,
        "mechanical_at_resonance_w": 1.0,
        "holding_at_resonance_w": 0.5 * p,
        "swing_cost_at_resonance_j_rad2": 2.0,
        "trend_cost_at_resonance_j_rad2": 10.0,
        "energy_reduction": 0.8,
        "cheapest_hz": 3.5,
        "swing_cost_at_cheapest_j_rad2": 1.5,
    }
    for name, value in at.items():
        values[name][p] = value
        values[companions(name)[0]][p] = 0.01


def foreign_ring_down(decay_rate: float = 0.7, omega: float = 15.0) -> tuple[xr.Dataset, xr.Dataset]:
    """Return somebody else's ring-down, in millimetres, with neither drive nor rig, and its results."""
    t = np.arange(0.0, 6.0, 0.01)
    response = 4.0 + 12.0 * np.exp(-decay_rate * t) * np.cos(omega * t)
    segment = Segment("ring-down", 0.0, np.nan, np.nan, 0)
    samples = {"time_s": t, "response": response}
    recording = build_recording(samples, [segment], [t.size], {"source": "import"}, {"response": "mm"})
    results = sample_results((0.0,), SMALL[1], repeats=1)
    results = results[[name for name in results.variables if results[name].dims == ("pretension_mm", "repeat")]]
    unknown = {"paper_damping_n_m_s_rad": np.nan, "paper_stiffness_n_m_rad": np.nan}
    for name, value in {"paper_decay_rate_per_s": decay_rate, "paper_omega_rad_s": omega, **unknown}.items():
        results[name].values[:] = value
    return recording, validate_results(results.assign_attrs(source="import"))


def _shape(dims: tuple[str, ...], shape: tuple[int, int, int]) -> tuple[int, ...]:
    axes = ("pretension_mm", "frequency_hz", "repeat")
    sizes = {**dict(zip(axes, shape, strict=True)), "window_start_periods": len(DECAY_WINDOWS)}
    return tuple(sizes[dim] for dim in dims)


def _resonance(values: dict[str, np.ndarray], p: int, joint: Joint) -> None:
    grid = np.linspace(1.5, 6.0, 4501)
    response = joint.response(grid)
    nominal = abs(response) * drive_share(grid)
    peak, true_peak = int(nominal.argmax()), int(abs(response).argmax())
    for stem, suffix, value, std in (
        ("paper_resonance", "_hz", grid[peak], 0.015),
        ("paper_gain_peak", "", nominal[peak], 0.03),
        ("resonance", "_hz", grid[peak], 0.015),
        ("gain_peak", "", nominal[peak], 0.03),
        ("gain_peak_measured_drive", "", abs(response)[true_peak], 0.05),
        ("resonance_measured_drive", "_hz", grid[true_peak], 0.015),
        ("phase_90", "_hz", joint.natural_hz, 0.01),
        ("half_power_width", "_hz", 2 * joint.damping * joint.natural_hz, 0.02),
        ("drive_amplitude_at_resonance", "_rad", np.deg2rad(AMPLITUDE_DEG) * float(drive_share(grid[peak])), 0.002),
    ):
        values[f"{stem}{suffix}"][p] = value
        values[f"{stem}_std{suffix}"][p] = std
        values[f"{stem}_low{suffix}"][p] = value - 1.7 * std
        values[f"{stem}_high{suffix}"][p] = value + 1.7 * std


def _ring_down(values: dict[str, np.ndarray], p: int, r: int, joint: Joint) -> None:
    inertia = 12.74e-3
    ratio = joint.decay_rate / joint.omega
    for name, value in {
        "paper_decay_rate_per_s": joint.decay_rate,
        "decay_start_s": 0.0,
        "paper_omega_rad_s": joint.omega,
        "paper_lehr_damping": ratio,
        "paper_quality": 0.5 / ratio,
        "paper_damping_n_m_s_rad": 2 * joint.decay_rate * inertia,
        "paper_stiffness_n_m_rad": joint.omega**2 * inertia,
        "decay_rate_per_s": joint.decay_rate,
        "decay_rate_std_per_s": 0.01,
        "decay_frequency_hz": joint.omega / (2 * np.pi),
        "decay_frequency_std_hz": 0.002,
        "damping_ratio": joint.damping,
        "damping_ratio_std": 0.001,
        "rest_drift": 0.0,
        "exponential": 1.0,
    }.items():
        values[name][p, r] = value
    for name in ("decay_rate_per_s", "omega_rad_s", "lehr_damping"):  # an exponential: the same from every start on
        values[f"window_{name}"][p, r] = values[f"paper_{name}"][p, r]


FULL = (
    tuple(float(p) for p in range(13)),
    np.concatenate([np.linspace(1.5, 2.5, 5), np.arange(2.6, 5.01, 0.1), [5.5, 6.0]]),
)
"""Pretensions [mm] and frequencies [Hz] of a campaign as large as the paper's."""

SMALL = (0.0, 4.0, 8.0, 12.0), np.array([1.5, 2.0, 2.5, 2.8, 3.0, 3.3, 3.6, 4.0, 4.3, 4.6, 5.2, 6.0])
"""The same of one that is drawn quickly."""
