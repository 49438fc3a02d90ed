"""Coverage of intervals over many draws of the noise: `python -m campaigns.coverage`.

Three experiments, each with 0.3° of noise at 100 Hz: ring-downs of 3 s at four dampings, with the paper's method on the
same samples; stepped sines at the same dampings (28 frequencies, five periods each, a lever's angle of 5° as input),
for frequency and gain of the peak; and the 60 s sweep through a hardening joint. Printed: bias over standard deviation,
share of 90 % intervals that hold the truth, stated over true standard deviation, and how many times larger the
standard deviation by the paper's method is. Seeded.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from benchmarks.sweep_fit import CUBIC, sweep_record
from scipy.optimize import least_squares
from scipy.signal import find_peaks, savgol_filter

from campaigns.stretches import response_points
from sinew.analysis.decay.ring_down import analyse_ring_down
from sinew.analysis.sweep.resonance import find_peak
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.record import make_record
from sinew.identify.stepped.curves import peak_of_response
from sinew.identify.stepped.fit import fit_response
from sinew.identify.stepped.points import ResponsePoints
from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate

DAMPINGS = (0.05, 0.10, 0.17, 0.25)
TRIALS = 500
NATURAL_HZ, SAMPLE_HZ = 3.0, 100.0
NOISE = float(np.deg2rad(0.3))
RING_DOWN_S, START = 3.0, float(np.deg2rad(40.0))
FREQUENCIES_HZ = np.unique(np.round(np.r_[np.linspace(1.53, 5.97, 15), np.linspace(2.61, 3.91, 14)], 6))
PERIODS, SHARE, DRIVE = 5, 0.65, float(np.deg2rad(5.0))


@dataclass(frozen=True)
class Coverage:
    """What many draws gave of one number: value, std, low, high of each, shape (t,), and the truth."""

    truth: float
    value: Array
    std: Array
    low: Array
    high: Array

    @staticmethod
    def of(truth: float, found: Sequence[Estimate]) -> "Coverage":
        """Return the draws of an estimate."""
        columns = [np.array([getattr(one, name) for one in found]) for name in ("value", "std", "low", "high")]
        return Coverage(truth, *columns)

    @property
    def bias(self) -> float:
        """Return the mean error over the standard deviation of the draws."""
        return float((self.value.mean() - self.truth) / self.value.std(ddof=1))

    @property
    def inside(self) -> float:
        """Return the share of intervals that hold the truth."""
        return float(np.mean((self.low <= self.truth) & (self.truth <= self.high)))

    @property
    def stated(self) -> float:
        """Return the mean stated standard deviation over that of the draws."""
        return float(self.std.mean() / self.value.std(ddof=1))

    def line(self, name: str) -> str:
        """Return a row of the table."""
        return (
            f"  {name:44} {self.truth:9.5f} {self.value.std(ddof=1):9.2e} {self.bias:+7.2f} {100 * self.inside:8.1f} %"
            f" {self.stated:7.2f}"
        )


def decay(damping: float, seed: int) -> tuple[Array, Array]:
    """Return stamps and angle of a ring-down of 3 Hz from 40°, at a random phase, as measured [s, rad]."""
    rng = np.random.default_rng([seed, round(1000 * damping)])
    t = np.arange(round(RING_DOWN_S * SAMPLE_HZ)) / SAMPLE_HZ
    omega = 2 * np.pi * NATURAL_HZ
    pole = omega * (-damping + 1j * np.sqrt(1 - damping**2))
    angle = START * np.exp(pole * t + 2j * np.pi * rng.uniform()).real
    return t, angle + NOISE * rng.standard_normal(t.size)


@dataclass(frozen=True)
class PaperReading:
    """One way to read section 4.2: "the positive and negative peaks are detected", an exponential through their sizes.

    apart: least distance of two peaks of one sign, in periods. floor: smallest peak, as a share of the largest.
    smoothed_s: window of a filter over the angle before (cubic Savitzky-Golay), 0 for none.
    mean_of_rates: ⟨ω⟩ as the mean of π over the spacings, else π over their mean.
    """

    apart: float = 0.8
    floor: float = 0.05
    smoothed_s: float = 0.0
    mean_of_rates: bool = False


PAPER_READINGS = {
    "paper, as read here": PaperReading(),
    "  peaks down to 10 % of the largest": PaperReading(floor=0.10),
    "  peaks down to 2 % of the largest": PaperReading(floor=0.02),
    "  half a period apart": PaperReading(apart=0.5),
    "  ⟨ω⟩ as the mean of the rates": PaperReading(mean_of_rates=True),
    "  angle filtered over 0.1 s before": PaperReading(smoothed_s=0.1),
}
"""The first is the one that counts. The paper names no filter but the fusion of the IMU, so peaks are largest samples
of the angle as measured. A careful author keeps out the false ones, which noise makes around each crest, by asking for
most of a period between two of a sign, and stops where a peak no longer stands out: 2° of 40°, seven times the noise.
The others differ from it in one respect each."""


def paper_damping(t: Array, angle: Array, reading: PaperReading = PAPER_READINGS["paper, as read here"]) -> float:
    """Return D = λ/⟨ω⟩ (Eq. 7): least squares of A exp(-λt) through the sizes of positive and negative peaks.

    The period, for the distance of peaks, is known from the drive, which excited at resonance.
    """
    step = float(t[1] - t[0])
    y = angle - angle[t > t[-1] - 1.0].mean()
    if reading.smoothed_s:
        y = savgol_filter(y, 2 * round(0.5 * reading.smoothed_s / step) + 1, 3)
    distance = max(1, round(reading.apart / NATURAL_HZ / step))
    floor = reading.floor * float(np.abs(y).max())
    index = np.sort(np.concatenate([find_peaks(s * y, height=floor, distance=distance)[0] for s in (1.0, -1.0)]))
    size = np.abs(y[index])
    first = np.array([float(size.max()), 2.0])

    def off(p: Array) -> Array:
        return np.asarray(p[0] * np.exp(-p[1] * t[index]) - size)

    rate = least_squares(off, first, method="lm").x[1]
    spacing = np.diff(t[index])
    omega = float(np.mean(np.pi / spacing)) if reading.mean_of_rates else float(np.pi / spacing.mean())
    return float(rate) / omega


def ring_down_trials(
    damping: float, trials: int = TRIALS, seed: int = 0, readings: Sequence[str] = tuple(PAPER_READINGS)
) -> tuple[dict[str, Coverage], dict[str, Array]]:
    """Return D and f of the ring-downs by the direct fit and by identification, and D by the paper's method."""
    direct, identified = [], []
    paper: dict[str, list[float]] = {name: [] for name in readings}
    for k in range(seed, seed + trials):
        t, angle = decay(damping, k)
        direct.append(analyse_ring_down(t, angle))
        identified.append(fit(make_record(t, angle, output_unit="rad"), "linear"))
        for name in readings:
            paper[name].append(paper_damping(t, angle, PAPER_READINGS[name]))
    found = {
        "damping ratio, direct fit": Coverage.of(damping, [one.damping_ratio for one in direct]),
        "natural frequency, direct fit": Coverage.of(NATURAL_HZ, [one.natural_frequency_hz for one in direct]),
        "damping ratio, identified": Coverage.of(damping, [one.damping_ratio for one in identified]),
        "natural frequency, identified": Coverage.of(NATURAL_HZ, [one.natural_frequency_hz for one in identified]),
    }
    return found, {name: np.array(values) for name, values in paper.items()}


def stepped_sines(damping: float, trials: int = TRIALS, seed: int = 0) -> tuple[ResponsePoints, ...]:
    """Return one stepped sine a trial: a linear joint, torsion over lever, steady stretches of five periods."""
    records, frequencies = [], []
    for k in range(seed, seed + trials):
        rng = np.random.default_rng([k, round(1000 * damping), 1])
        for f in FREQUENCIES_HZ:
            t = np.arange(round(PERIODS / f * SAMPLE_HZ)) / SAMPLE_HZ
            u = f / NATURAL_HZ
            transfer = SHARE * u**2 / (1 - u**2 + 2j * damping * u)
            turn = np.exp(2j * np.pi * (f * t + rng.uniform()))
            angle = DRIVE * (transfer * turn).real + NOISE * rng.standard_normal(t.size)
            lever = DRIVE * turn.real
            records.append(
                make_record(t, angle, lever, excitation="lever", output_unit="rad", input_unit="rad", group=str(k))
            )
            frequencies.append(float(f))
    return response_points(records, frequencies)


def peaks_of(damping: float, found: Sequence[tuple[Estimate, Estimate]], name: str) -> dict[str, Coverage]:
    """Return the coverage of frequency and gain of the peak."""
    frequency = NATURAL_HZ / np.sqrt(1 - 2 * damping**2)
    gain = SHARE / (2 * damping * np.sqrt(1 - damping**2))
    return {
        f"peak frequency, {name}": Coverage.of(frequency, [one for one, _ in found]),
        f"peak gain, {name}": Coverage.of(gain, [one for _, one in found]),
    }


def peak_trials(damping: float, trials: int = TRIALS, seed: int = 0, *, free: bool = True) -> dict[str, Coverage]:
    """Return frequency and gain of the peak by the fitted mechanics; free: and by the curve that knows none."""
    sweeps = stepped_sines(damping, trials, seed)
    peaks = [peak_of_response(fit_response(one, "linear")) for one in sweeps]
    found = peaks_of(damping, [(one.frequency_hz, one.gain) for one in peaks], "fitted mechanics")
    return found | (peaks_of(damping, [_free_peak(one) for one in sweeps], "rational curve") if free else {})


def _free_peak(points: ResponsePoints) -> tuple[Estimate, Estimate]:
    h = points.response
    along = np.stack([h.real, h.imag], axis=1) / np.abs(h)[:, None]
    across = np.stack([-h.imag, h.real], axis=1) / np.abs(h)[:, None]
    size, angle = (
        np.sqrt(np.einsum("ij,ijk,ik->i", way, points.covariance, way)) / np.abs(h) for way in (along, across)
    )
    peak = find_peak(points.frequency_hz, h, size, angle)
    return Estimate.student(*peak.frequency_hz), Estimate.student(*peak.gain)


def cubic_trials(trials: int = TRIALS, seed: int = 0, duration_s: float = 60.0) -> Coverage:
    """Return the cubic stiffness of a sweep."""
    records = (sweep_record(k, duration_s=duration_s) for k in range(seed, seed + trials))
    return Coverage.of(CUBIC, [fit(record, "cubic").parameters["cubic_n_m_per_rad3"] for record in records])


def _print_ring_downs(trials: int, seed: int, dampings: Sequence[float]) -> None:
    for damping in dampings:
        found, paper = ring_down_trials(damping, trials, seed)
        print(f" ring-down, D = {damping:g}")
        for name, row in found.items():
            print(row.line(name))
        own = found["damping ratio, direct fit"].value.std(ddof=1)
        for name, values in paper.items():
            spread = values.std(ddof=1)
            print(
                f"  {name:44} {values.mean():9.5f} {spread:9.2e} {(values.mean() - damping) / spread:+7.2f}"
                f"    std {spread / own:.1f} times the direct fit's"
            )


def _print_peaks(trials: int, seed: int, dampings: Sequence[float]) -> None:
    for damping in dampings:
        print(f" stepped sine, D = {damping:g}")
        for name, row in peak_trials(damping, trials, seed).items():
            print(row.line(name))


def _print_cubic(trials: int, seed: int, _: Sequence[float]) -> None:
    found = cubic_trials(trials, seed)
    print(" sweep through a hardening joint")
    print(found.line("cubic stiffness [N m/rad³]"))
    error = np.abs(found.value / found.truth - 1)
    print(
        f"  error: rms {100 * np.sqrt(np.mean(error**2)):.3f} %, at most 0.3 % in {100 * np.mean(error <= 0.003):.1f} %"
    )


PARTS: dict[str, Callable[[int, int, Sequence[float]], None]] = {
    "ring-down": _print_ring_downs,
    "peak": _print_peaks,
    "cubic": _print_cubic,
}


def main() -> None:
    """Print the whole table, or one part of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", choices=[*PARTS], help="one experiment; all without it")
    parser.add_argument("--damping", type=float, choices=DAMPINGS, help="one damping ratio; all without it")
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    print(f"{asked.trials} trials each; wanted: bias below 0.25, 86 to 94 % inside")
    print(f"  {'number':44} {'truth':>9} {'std':>9} {'bias':>7} {'inside':>10} {'stated':>7}")
    for name in [asked.part] if asked.part else PARTS:
        PARTS[name](asked.trials, asked.seed, [asked.damping] if asked.damping else DAMPINGS)


if __name__ == "__main__":
    main()
