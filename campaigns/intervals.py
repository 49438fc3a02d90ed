"""Coverage of the intervals of a fit, method by method: `python -m campaigns.intervals`.

Oscillations with known mechanics are made by scipy's integrator, noise is drawn anew for every trial, and it is counted
how often the 90 % interval of each method holds the truth: of the fit's covariance, of the profile, of the posterior.
For repeats that differ from each other by more than noise the bootstrap stands beside the covariance.

Printed: by scenario, number and method the share that covers, with its own 90 % interval, and the median width in
standard deviations of the estimates. Seeded.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import special
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from campaigns.options import TWO, spread_of, spread_options, spread_trials
from sinew.identify.oscillator.bootstrap import bootstrap_repeats
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.posterior import sample_posterior
from sinew.identify.oscillator.profile import interval90
from sinew.identify.oscillator.record import Record, make_record
from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate

OMEGA = 2 * np.pi * 3.0
RATE_HZ = 130.0


@dataclass(frozen=True)
class Scenario:
    """A free decay of r'' + damping r' + dry sign(r') + ω² r + cubic r³ = 0 from half a radian, with noise.

    noise: standard deviation of a sample [rad]; correlation: of neighbouring samples (autoregression of order one).
    asked: the numbers whose intervals are counted.
    """

    model: str
    duration_s: float
    damping: float
    noise: float
    asked: tuple[str, ...]
    cubic: float = 0.0
    dry: float = 0.0
    correlation: float = 0.0

    def truth(self, name: str) -> float:
        """Return the true value of a number that a fit names."""
        return {
            "natural_frequency_hz": OMEGA / (2 * np.pi),
            "damping_ratio": self.damping / (2 * OMEGA),
            "stiffness_per_s2": OMEGA**2,
            "damping_per_s": self.damping,
            "cubic_per_s2_rad2": self.cubic,
            "coulomb_rad_per_s2": self.dry,
        }[name]


SCENARIOS: dict[str, Scenario] = {
    "linear": Scenario("linear", 3.0, 0.2 * OMEGA, np.deg2rad(0.3), ("natural_frequency_hz", "damping_ratio")),
    "coloured": Scenario(
        "linear",
        3.0,
        0.2 * OMEGA,
        np.deg2rad(0.5),
        ("natural_frequency_hz", "damping_ratio"),
        correlation=0.8,
    ),
    "cubic": Scenario("cubic", 2.0, 0.2 * OMEGA, 0.06, ("cubic_per_s2_rad2", "stiffness_per_s2"), cubic=1.5 * OMEGA**2),
    "friction": Scenario("coulomb", 2.5, 0.08 * OMEGA, 0.02, ("coulomb_rad_per_s2", "damping_per_s"), dry=3.0),
}
"""Well determined, with correlated noise, and two with few and noisy samples, where intervals are not symmetric."""


@dataclass(frozen=True)
class Row:
    """One interval of one trial."""

    scenario: str
    name: str
    method: str
    truth: float
    found: Estimate

    @property
    def covers(self) -> bool:
        """Return whether the interval holds the truth."""
        return self.found.low <= self.truth <= self.found.high


@cache
def clean_decay(scenario: Scenario, omega: float = OMEGA) -> tuple[Array, Array]:
    """Return time and motion without noise, dry friction from reversal to reversal."""
    time = np.arange(0, scenario.duration_s, 1 / RATE_HZ)
    motion = np.empty_like(time)
    state, begin, done = np.array([0.5, 0.0]), 0.0, 0

    def spring(r: float) -> float:
        return omega**2 * r + scenario.cubic * r**3

    while done < time.size:
        if abs(spring(state[0])) <= scenario.dry:
            motion[done:] = state[0]
            break
        sign = -np.sign(state[0])

        def rate(_: float, y: Array, sign: float = sign) -> list[float]:
            return [y[1], -scenario.damping * y[1] - scenario.dry * sign - spring(y[0])]

        def turning(_: float, y: Array, sign: float = sign) -> float:
            return float(sign * y[1])

        turning.terminal, turning.direction = True, -1  # type: ignore[attr-defined]
        span = (begin, time[-1] + 1.0)
        end = solve_ivp(rate, span, state, rtol=1e-9, atol=1e-11, max_step=0.02, dense_output=True, events=turning)
        upto = int(np.searchsorted(time, end.t[-1], "right"))
        assert end.sol is not None  # `dense_output` asks for it
        motion[done:upto] = end.sol(time[done:upto])[0]
        begin, state, done = end.t[-1], np.array([end.y[0, -1], 0.0]), upto
    return time, motion


def noise(scenario: Scenario, size: int, chance: np.random.Generator) -> Array:
    """Return the noise of one record."""
    fresh = chance.normal(size=size + 200)
    a = scenario.correlation
    return np.asarray(scenario.noise * np.sqrt(1 - a**2) * lfilter([1.0], [1.0, -a], fresh)[200:])


def run_trial(
    name: str, seed: int, draws: int = 400, methods: Sequence[str] = ("covariance", "profile", "posterior")
) -> list[Row]:
    """Return the intervals of one record of a scenario."""
    scenario = SCENARIOS[name]
    time, clean = clean_decay(scenario)
    chance = np.random.default_rng([seed, list(SCENARIOS).index(name)])
    found = fit(make_record(time, clean + noise(scenario, time.size, chance), output_unit="rad"), scenario.model)
    told = found.parameters | {
        "natural_frequency_hz": found.natural_frequency_hz,
        "damping_ratio": found.damping_ratio,
    }
    nothing = Estimate(np.nan, np.nan, -np.inf, np.inf)
    intervals: dict[str, Callable[[str], Estimate]] = {
        "covariance": lambda asked: told[asked],
        "profile": lambda asked: interval90(found, asked) or nothing,
    }
    if "posterior" in methods:
        drawn = sample_posterior(found, seed=seed, draws=draws // 4, warmup=100, chains=4).estimates
        intervals["posterior"] = lambda asked: drawn[asked]
    return [
        Row(name, asked, method, scenario.truth(asked), intervals[method](asked))
        for asked in scenario.asked
        for method in methods
    ]


def repeat_trial(seed: int, repeats: int = 3, scatter: float = 0.01) -> list[Row]:
    """Return the intervals of repeats whose natural frequency differs by a share of `scatter` (standard deviation)."""
    scenario = SCENARIOS["linear"]
    chance = np.random.default_rng([seed, repeats])
    records: list[Record] = []
    for omega in OMEGA * (1 + scatter * chance.normal(size=repeats)):
        time, clean = clean_decay(scenario, float(omega))
        records.append(make_record(time, clean + noise(scenario, time.size, chance), output_unit="rad"))
    drawn = bootstrap_repeats(records, "linear", seed=seed)
    truth, name, label = scenario.truth("natural_frequency_hz"), "natural_frequency_hz", f"{repeats} repeats"
    return [
        Row(label, name, "covariance", truth, drawn.fit.natural_frequency_hz),
        Row(label, name, "bootstrap", truth, drawn.estimates[name]),
    ]


def coverage(rows: Sequence[Row], scenario: str, name: str, method: str) -> tuple[float, int]:
    """Return the share of intervals that hold the truth, and how many there are."""
    mine = [row.covers for row in rows if (row.scenario, row.name, row.method) == (scenario, name, method)]
    return float(np.mean(mine)), len(mine)


def table(rows: Sequence[Row]) -> str:
    """Return a Markdown table of coverage."""
    lines = [
        "| scenario | number | method | covers | 90 % interval of that | width | trials |",
        "|---|---|---|---|---|---|---|",
    ]
    for scenario, name, method in dict.fromkeys((row.scenario, row.name, row.method) for row in rows):
        share, count = coverage(rows, scenario, name, method)
        held = round(share * count)
        low = float(special.betaincinv(held, count - held + 1, 0.05)) if held else 0.0
        high = float(special.betaincinv(held + 1, count - held, 0.95)) if held < count else 1.0
        mine = [row.found for row in rows if (row.scenario, row.name, row.method) == (scenario, name, method)]
        spread = np.std([row.found.value for row in rows if (row.scenario, row.name) == (scenario, name)])
        width = np.median([one.high - one.low for one in mine]) / spread
        lines.append(
            f"| {scenario} | {name} | {method} | {100 * share:.1f} % | {100 * low:.1f}-{100 * high:.1f} % "
            f"| {width:.2f} | {count} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Run the trials and print the table."""
    parser = argparse.ArgumentParser(prog="python -m campaigns.intervals", description="Coverage of 90 % intervals.")
    parser.add_argument("--trials", type=int, default=200, help="trials of each scenario")
    parser.add_argument("--only", choices=[*SCENARIOS, "repeats"], help="one scenario")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--draws", type=int, default=400, help="draws of the posterior in each trial")
    spread_options(parser, TWO)
    chosen = parser.parse_args()
    seeds = range(chosen.seed, chosen.seed + chosen.trials)
    rows: list[Row] = []
    spread = spread_of(chosen)
    trials = [(name, seed, chosen.draws) for name in SCENARIOS if chosen.only in (None, name) for seed in seeds]
    for part in spread_trials(run_trial, *zip(*trials, strict=True), spread=spread):
        rows += part
    if chosen.only in (None, "repeats"):
        repeated = [(seed, repeats) for repeats in (3, 5) for seed in seeds]
        for part in spread_trials(repeat_trial, *zip(*repeated, strict=True), spread=spread):
            rows += part
    print(table(rows))


if __name__ == "__main__":
    main()
