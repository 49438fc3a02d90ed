"""Forced responses predicted from decays and one measured point: `python -m campaigns.forced --seeds 100`.

Two oscillators with viscous damping and quadratic drag, one whose spring hardens and one whose spring softens, are made
by scipy's integrator. Of each trial three free decays are known, from three amplitudes, with noise, and one forced
motion at the middle of three levels of the drive, on the flank of its resonance, with an error of its amplitude. The
decays are identified, the gain is taken from the point, and the maxima at all three levels are held against those that
a stepped sine by the same integrator has: error of the amplitude, and whether the truth lies in the 90 % interval. What
the drive does to the motion is never told.
"""

from dataclasses import dataclass
from functools import cache
from time import perf_counter

import numpy as np
from scipy import stats
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from campaigns.options import asked_seeds, trial_parser
from sinew.identify.forced import Forced, Through
from sinew.identify.identified import identify
from sinew.identify.oscillator.record import make_record
from sinew.measure.arrays import Array

ERROR = 0.03
_RATE_HZ, _DECAY_S = 100.0, 4.0
_TURNS, _LAST = 100, 4  # periods that a steady state is waited for, and that are looked at
_SAMPLES = 256


@dataclass(frozen=True)
class Oscillator:
    """r'' + d r' + c |r'| r' + k r + k₃ r³ = push sin Ωt, r in rad.

    starts: of the decays [rad]. pushes: the three levels [rad/s²]; their ratio is all that a trial is told.
    at_hz: frequency of the measured point. band_hz: where the maxima lie, in the direction in which a sweep finds them.
    noise: of a decay's samples [rad]; point_noise: of the measured amplitude, as a share of it.
    """

    name: str
    stiffness: float
    damping: float
    drag: float
    cubic: float
    starts: tuple[float, float, float]
    pushes: tuple[float, float, float]
    at_hz: float
    band_hz: tuple[float, float]
    noise: float = 0.004
    point_noise: float = 0.005

    def rate(self, t: float, y: Array, push: float, omega: float) -> list[float]:
        """Return the rates of motion and speed."""
        lost = (self.damping + self.drag * abs(y[1])) * y[1]
        return [y[1], push * np.sin(omega * t) - lost - (self.stiffness + self.cubic * y[0] ** 2) * y[0]]


_K = (2 * np.pi * 3.0) ** 2
HARDENING = Oscillator("hardening", _K, 0.5, 0.08, 0.9 * _K, (0.6, 0.4, 0.2), (3.0, 6.0, 12.0), 2.9, (2.9, 3.9))
SOFTENING = Oscillator("softening", _K, 0.5, 0.08, -0.5 * _K, (0.6, 0.4, 0.2), (3.0, 6.0, 12.0), 3.1, (3.15, 2.5))
OSCILLATORS = {one.name: one for one in (HARDENING, SOFTENING)}


@cache
def clean_decay(one: Oscillator, start: float) -> tuple[Array, Array]:
    """Return time and motion of a free decay, without noise."""
    time = np.arange(0, _DECAY_S, 1 / _RATE_HZ)
    done = solve_ivp(one.rate, (0, time[-1]), [start, 0.0], "DOP853", time, args=(0.0, 1.0), rtol=1e-9, atol=1e-11)
    return time, done.y[0]


def swing(one: Oscillator, push: float, hertz: float, state: Array) -> tuple[float, Array]:
    """Return half of peak to peak of the steady motion that a state leads to, and its state at the end of a period."""
    omega = 2 * np.pi * hertz
    last = np.linspace(_TURNS - _LAST, _TURNS, _LAST * _SAMPLES + 1) / hertz
    end = last[-1]
    done = solve_ivp(one.rate, (0, end), state, "DOP853", last, args=(push, omega), rtol=1e-8, atol=1e-10)
    return 0.5 * float(np.ptp(CubicSpline(last, done.y[0])(np.linspace(last[0], end, 20 * last.size)))), done.y[:, -1]


@cache
def largest(one: Oscillator, push: float) -> float:
    """Return the largest steady amplitude [rad] that a stepped sine meets: coarse steps, then fine ones about it.

    Where a spring hardens the amplitude grows seven times as fast as the frequency up to where it jumps.
    """
    low, high = one.band_hz
    state, step = np.zeros(2), (high - low) / 24
    begin, best = low, 0.0
    for _ in range(4):  # each time from before the largest on, with steps a fifth as long
        hertz, here = begin, state
        trail: list[tuple[float, float, Array]] = []
        while (high - hertz) * step > 0:
            size, after = swing(one, push, hertz, here)
            trail.append((size, hertz, here))
            if len(trail) > 1 and size < 0.97 * max(row[0] for row in trail):
                break
            hertz, here = hertz + step, after
        top = int(np.argmax([row[0] for row in trail]))
        best = max(best, trail[top][0])
        _, begin, state = trail[max(top - 1, 0)]
        step /= 5
    return best


@cache
def measured(one: Oscillator) -> float:
    """Return the true amplitude of the forced motion that is measured [rad], from rest at the middle level."""
    return swing(one, one.pushes[1], one.at_hz, np.zeros(2))[0]


@dataclass(frozen=True)
class Trial:
    """Of the three levels true maximum, predicted one and its interval [rad], shape (3,) each."""

    seed: int
    truth: Array
    value: Array
    low: Array
    high: Array
    seconds: float

    @property
    def error(self) -> Array:
        """Return the relative errors, shape (3,)."""
        return np.asarray(self.value / self.truth - 1)

    @property
    def inside(self) -> Array:
        """Return whether the truth is inside each interval, shape (3,)."""
        return np.asarray((self.low <= self.truth) & (self.truth <= self.high))


def predicted(one: Oscillator, seed: int, draws: int = 100) -> Forced:
    """Return the prediction of a trial. seed: of all noise."""
    rng = np.random.default_rng([seed, list(OSCILLATORS).index(one.name)])
    records = []
    for start in one.starts:
        time, motion = clean_decay(one, start)
        noisy = motion + one.noise * rng.standard_normal(time.size)
        records.append(make_record(time, noisy, output_unit="rad", group="decays"))
    seen = measured(one) * (1 + one.point_noise * float(rng.standard_normal()))
    levels = [push / one.pushes[1] for push in one.pushes]
    point = Through(one.at_hz, seen, one.point_noise * seen, 1.0)
    return identify(records, "drag-cubic").predict(torque=levels, through=point, draws=draws, seed=seed)


def run_trial(one: Oscillator, seed: int, draws: int = 100) -> Trial:
    """Return one trial. seed: of all noise."""
    begin = perf_counter()
    peaks = [level.band.peak for level in predicted(one, seed, draws).levels]
    rows = [(p.amplitude.value, p.amplitude.low, p.amplitude.high) if p else (np.nan,) * 3 for p in peaks]
    value, low, high = np.array(rows).T
    truth = np.array([largest(one, push) for push in one.pushes])
    return Trial(seed, truth, value, low, high, perf_counter() - begin)


def table(one: Oscillator, trials: list[Trial]) -> str:
    """Return a row for each level: true maximum, largest and root mean square error, share inside, median width."""
    columns = ("truth", "value", "low", "high")
    truth, value, low, high = (np.array([getattr(each, name) for each in trials]) for name in columns)
    error, inside, count = value / truth - 1, (low <= truth) & (truth <= high), len(trials)
    half = 50 * np.median(high - low, axis=0) / truth[0]
    rms, most = 100 * np.sqrt(np.mean(error**2, axis=0)), 100 * np.abs(error).max(axis=0)
    lines = [f"{one.name}: {count} trials, {np.median([t.seconds for t in trials]):.1f} s each"]
    for k, push in enumerate(one.pushes):
        lines.append(
            f"  level {push / one.pushes[1]:4g}: true maximum {truth[0, k]:.5f} rad, error rms {rms[k]:.2f} %, largest "
            f"{most[k]:.2f} %, inside {inside[:, k].sum()} of {count}, half width {half[k]:.2f} %"
        )
    ends = stats.binom.interval(0.95, count, 0.9)
    close = int(np.all(np.abs(error) <= ERROR, axis=1).sum())
    lines.append(
        f"  within {100 * ERROR:g} % at all levels: {close} of {count}; inside in all: {100 * inside.mean():.1f} % "
        f"(of one level 90 % intervals give {ends[0]:.0f} to {ends[1]:.0f})"
    )
    return "\n".join(lines)


def main() -> None:
    """Run the trials and print the tables."""
    parser = trial_parser("forced", __doc__, count=20, of="trials of each oscillator")
    parser.add_argument("--draws", type=int, default=100, help="draws of each band")
    parser.add_argument("--oscillator", choices=[*OSCILLATORS], help="one of them; both without it")
    asked = parser.parse_args()
    for name in [asked.oscillator] if asked.oscillator else OSCILLATORS:
        trials = []
        for seed in asked_seeds(asked):
            trials.append(run_trial(OSCILLATORS[name], seed, asked.draws))
            last = trials[-1]
            rows = zip(last.error, last.inside, strict=True)
            errors = ", ".join(f"{100 * error:+.2f} %{'' if ok else '!'}" for error, ok in rows)
            print(f"{name}, seed {seed}: {errors}, {last.seconds:.1f} s", flush=True)
        print(table(OSCILLATORS[name], trials), flush=True)


if __name__ == "__main__":
    main()
