"""Coverage of intervals over many draws of the noise: `python -m campaigns.coverage`.

Three experiments, each with 0.3° of noise at 100 Hz: ring-downs of 3 s at four dampings, with the paper's method on the
same samples; stepped sines at the same dampings (28 frequencies, five periods each, a lever's angle of 5° as input),
for frequency and gain of the peak; and the 60 s sweep through a hardening joint. Printed: bias over standard deviation,
share of 90 % intervals that hold the truth, stated over true standard deviation, and how many times larger the
standard deviation by the paper's method is. Seeded.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from benchmarks.sweep_fit import CUBIC, sweep_record
from scipy.optimize import least_squares
from scipy.signal import find_peaks

from campaigns.options import campaign_parser, conclude
from sinew.analysis.decay.ring_down import analyse_ring_down
from sinew.analysis.signal.harmonics import fit_harmonics, refine_frequency, relative_noise
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.record import Record, make_record
from sinew.identify.points import ResponsePoints, make_points, turned
from sinew.identify.steady_fit import fit_response, peak_of_response
from sinew.measure.arrays import Array, Complexes
from sinew.measure.estimate import Estimate

# Points of a stepped sine from its steady stretches in time, one stretch a point.

_PADDING = 8
_PLAIN, _PER_PAIR = 24.0, 4.0  # degrees of freedom of a scatter read off twelve lines; of each pair of sidebands


def response_points(records: Sequence[Record]) -> tuple[ResponsePoints, ...]:
    """Return the points that steady stretches hold, one stretch a point, those of one group together.

    records: each driven by one frequency, its transient gone. Fundamental and harmonics 2 to 5 of input and output are
    fitted by least squares to the samples; the scatter is what the residual holds near the fundamental
    (`sinew.analysis.signal.harmonics`), so slow drift, colour and a rest of the transient are in it. The records'
    `output_delay_s` is undone.
    """
    known = np.array([_dominant(record) for record in records])
    sizes = np.array([record.size for record in records])
    h, scatter = np.empty(sizes.size, dtype=complex), np.empty((sizes.size, 2, 2))
    amplitude, freedom = np.empty(sizes.size), np.empty(sizes.size)
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size).tolist()
        batch = _batch([records[i] for i in rows], known[rows])
        h[rows], scatter[rows], amplitude[rows], freedom[rows] = batch
    found = []
    for group in dict.fromkeys(record.group for record in records):
        mine = [i for i, record in enumerate(records) if record.group == group]
        first = records[mine[0]]
        made = make_points(
            known[mine],
            h[mine],
            scatter[mine],
            amplitude[mine],
            excitation=first.excitation,
            output_unit=first.output_unit,
            input_unit=first.input_unit,
            group=group,
            scatter_freedom=float(freedom[mine].min()),
        )
        found.append(made)
    return tuple(found)


def _batch(records: Sequence[Record], frequency: Array) -> tuple[Complexes, Array, Array, Array]:
    """Return response, its covariance (s, 2, 2), input amplitude and degrees of freedom of records of one length."""
    time = np.stack([record.time_s for record in records])
    fitted = fit_harmonics(time, np.stack([np.stack([one.output, _driven(one)]) for one in records]), frequency)
    late = np.exp(2j * np.pi * frequency * np.array([record.output_delay_s for record in records]))
    response = fitted.coefficient[:, 0, 0] / fitted.coefficient[:, 1, 0] * late
    relative = np.stack(relative_noise(fitted, 0, 1), axis=1)
    pairs = np.isfinite(fitted.sidebands[:, 0, :, 0]).sum(axis=1)
    freedom = np.where(pairs < 3, _PLAIN, _PER_PAIR * pairs)
    return response, turned(response, relative), np.abs(fitted.coefficient[:, 1, 0]), freedom


def _driven(record: Record) -> Array:
    assert record.input is not None
    return np.asarray(record.input - record.input.mean())


def _dominant(record: Record) -> float:
    """Return the frequency of the input [Hz]."""
    driven, span = _driven(record), float(record.time_s[-1] - record.time_s[0])
    even = np.linspace(record.time_s[0], record.time_s[-1], driven.size)
    windowed = np.interp(even, record.time_s, driven) * np.hanning(driven.size)
    size = _PADDING * driven.size
    first = float(np.fft.rfftfreq(size, span / (driven.size - 1))[np.argmax(np.abs(np.fft.rfft(windowed, size)))])
    return refine_frequency(record.time_s, driven, first)


# The experiments.

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


def paper_damping(t: Array, angle: Array) -> float:
    """Return D = λ/⟨ω⟩ (Eq. 7): least squares of A exp(-λt) through the sizes of positive and negative peaks.

    Peaks are largest samples of the angle as measured, for the paper names no filter. A careful author keeps out the
    false ones, which noise makes around each crest, by asking for most of a period (known from the drive) between two
    of a sign, and stops where a peak no longer stands out: 2° of 40°, seven times the noise.
    """
    y = angle - angle[t > t[-1] - 1.0].mean()
    distance = max(1, round(0.8 / NATURAL_HZ / float(t[1] - t[0])))
    floor = 0.05 * float(np.abs(y).max())
    index = np.sort(np.concatenate([find_peaks(s * y, height=floor, distance=distance)[0] for s in (1.0, -1.0)]))
    size = np.abs(y[index])

    def off(p: Array) -> Array:
        return np.asarray(p[0] * np.exp(-p[1] * t[index]) - size)

    rate = least_squares(off, np.array([float(size.max()), 2.0]), method="lm").x[1]
    return float(rate) / float(np.pi / np.diff(t[index]).mean())


def ring_down_trials(damping: float, trials: int = TRIALS, seed: int = 0) -> tuple[dict[str, Coverage], Array]:
    """Return D and f of the ring-downs by the direct fit and by identification, and D by the paper's method."""
    direct, identified, paper = [], [], []
    for k in range(seed, seed + trials):
        t, angle = decay(damping, k)
        direct.append(analyse_ring_down(t, angle))
        identified.append(fit(make_record(t, angle, output_unit="rad"), "linear"))
        paper.append(paper_damping(t, angle))
    found = {
        "damping ratio, direct fit": Coverage.of(damping, [one.damping_ratio for one in direct]),
        "natural frequency, direct fit": Coverage.of(NATURAL_HZ, [one.natural_frequency_hz for one in direct]),
        "damping ratio, identified": Coverage.of(damping, [one.damping_ratio for one in identified]),
        "natural frequency, identified": Coverage.of(NATURAL_HZ, [one.natural_frequency_hz for one in identified]),
    }
    return found, np.array(paper)


def stepped_sines(damping: float, trials: int = TRIALS, seed: int = 0) -> tuple[ResponsePoints, ...]:
    """Return one stepped sine a trial: a linear joint, torsion over lever, steady stretches of five periods."""
    records = []
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
    return response_points(records)


def peak_trials(damping: float, trials: int = TRIALS, seed: int = 0) -> dict[str, Coverage]:
    """Return frequency and gain of the peak by the fitted mechanics."""
    peaks = [peak_of_response(fit_response(one, "linear")) for one in stepped_sines(damping, trials, seed)]
    frequency = NATURAL_HZ / np.sqrt(1 - 2 * damping**2)
    gain = SHARE / (2 * damping * np.sqrt(1 - damping**2))
    return {
        "peak frequency": Coverage.of(frequency, [one.frequency_hz for one in peaks]),
        "peak gain": Coverage.of(gain, [one.gain for one in peaks]),
    }


def cubic_trials(trials: int = TRIALS, seed: int = 0, duration_s: float = 60.0) -> Coverage:
    """Return the cubic stiffness of a sweep."""
    records = (sweep_record(k, duration_s=duration_s) for k in range(seed, seed + trials))
    return Coverage.of(CUBIC, [fit(record, "cubic").parameters["cubic_n_m_per_rad3"] for record in records])


def ring_down_lines(trials: int, seed: int) -> Iterator[str]:
    """Yield the rows of the ring-downs."""
    for damping in DAMPINGS:
        found, paper = ring_down_trials(damping, trials, seed)
        yield f" ring-down, D = {damping:g}"
        yield from (row.line(name) for name, row in found.items())
        own, spread = found["damping ratio, direct fit"].value.std(ddof=1), paper.std(ddof=1)
        yield (
            f"  {'damping ratio, the paper as read here':44} {paper.mean():9.5f} {spread:9.2e}"
            f" {(paper.mean() - damping) / spread:+7.2f}    std {spread / own:.1f} times the direct fit's"
        )


def peak_lines(trials: int, seed: int) -> Iterator[str]:
    """Yield the rows of the stepped sines."""
    for damping in DAMPINGS:
        yield f" stepped sine, D = {damping:g}"
        yield from (row.line(name) for name, row in peak_trials(damping, trials, seed).items())


def cubic_lines(trials: int, seed: int) -> Iterator[str]:
    """Yield the row of the sweep through a hardening joint."""
    found = cubic_trials(trials, seed)
    yield found.line("cubic stiffness of a sweep [N m/rad³]")
    error = np.abs(found.value / found.truth - 1)
    rms, near = np.sqrt(np.mean(error**2)), np.mean(error <= 0.003)
    yield f"  error: rms {100 * rms:.3f} %, at most 0.3 % in {100 * near:.1f} %"


PARTS = {"ring-down": ring_down_lines, "peak": peak_lines, "cubic": cubic_lines}


def main() -> None:
    """Print the whole table, or one part of it."""
    parser = campaign_parser("coverage", __doc__, count=TRIALS, of="trials")
    parser.add_argument("--part", choices=[*PARTS], help="one experiment; all without it")
    asked = parser.parse_args()
    lines = [f"{asked.trials} trials each; wanted: bias below 0.25, 86 to 94 % inside"]
    lines.append(f"  {'number':44} {'truth':>9} {'std':>9} {'bias':>7} {'inside':>10} {'stated':>7}")
    for name in [asked.part] if asked.part else PARTS:
        lines += PARTS[name](asked.trials, asked.seed)
    conclude(asked.out, "\n".join(lines), lines)


if __name__ == "__main__":
    main()
