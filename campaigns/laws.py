"""The choice of a damping law, put to the test: `python -m campaigns.laws --seeds 20`.

Oscillations with hidden numbers go through what `sinew identify --model auto` does.
Whether their law can be told at all is decided without noise: the model of every other law that fits the clean record
best leaves a misfit; the difference of the information criterion that it makes in noise of the known size is what is to
be expected. From 20 on nine of ten draws of the noise exceed the 6 that decide (a difference of Δ scatters by 2√Δ), and
the law can be told; below 2 it cannot; what lies between is counted apart. Dry friction that is too small to be seen is
no law of its own: there the viscous law with a bound on the friction is right, where the bound holds the truth.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp
from scipy.optimize import nnls

from campaigns.options import TWO, asked_seeds, campaign_parser, conclude, spread_of, spread_trials
from sinew.identify.oscillator.comparison import Comparison, compare_laws, laws_to_try, split_record
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.model import Fit, Model, Rest
from sinew.identify.oscillator.record import Record, make_record
from sinew.measure.arrays import Array
from sinew.mechanics.laws import BoucWen, Drag, DryFriction, LossFactor

# Oscillations whose damping law is known: by SciPy's integrator, not by Sinew's simulation.
#
# Numbers are hidden: frequency, damping, spring and noise are drawn anew for every seed. A constant loss factor is made
# of twice as many Prony branches, over a wider band, as Sinew fits with; dry friction is integrated from reversal to
# reversal; a decay is let go after a drive that stops or after a long hold, so its silicone has seen either.

Kind = Literal["decay", "torque", "lever"]
DampingLaw = Literal["viscous", "loss-factor", "coulomb", "drag"]

LAWS: tuple[DampingLaw, ...] = ("viscous", "loss-factor", "coulomb", "drag")
EXCITATIONS: tuple[Kind, ...] = ("decay", "torque", "lever")

_INERTIA, _LEVER_SHARE = 12.74e-3, 0.61  # kg m²; I_l/I
_SWING = 0.5  # rad: about the largest motion
_RATE_HZ = 100.0
_DECAY_S, _SWEEP_S = 5.0, 15.0
_BRANCH_BAND_HZ, _BRANCH_COUNT = (0.06, 60.0), 9


@dataclass(frozen=True)
class Truth:
    """What one oscillation is made with.

    frequency_hz: of the linear spring. damping_ratio: equivalent, at half of the largest motion. dry_share: of the
    damping there that is dry friction (law coulomb) or drag. cubic: share of the cubic torque in the restoring torque
    at the largest motion. noise_deg: standard deviation of a sample. held: a decay begins after a long hold.
    """

    law: DampingLaw
    kind: Kind
    frequency_hz: float
    damping_ratio: float
    dry_share: float
    cubic: float
    noise_deg: float
    held: bool

    @property
    def omega(self) -> float:
        """Return the natural angular frequency [rad/s]."""
        return 2 * math.pi * self.frequency_hz

    @property
    def viscous(self) -> float:
        """Return d/I [1/s]."""
        share = {"viscous": 1.0, "loss-factor": 0.0}.get(self.law, 1.0 - self.dry_share)
        return 2 * self.damping_ratio * self.omega * share

    @property
    def dry(self) -> float:
        """Return c/I [rad/s²], by equal work in a cycle: 4 c r = π d ω r² at r of half of the largest motion."""
        if self.law != "coulomb":
            return 0.0
        return math.pi / 4 * 2 * self.damping_ratio * self.omega * self.dry_share * self.omega * 0.5 * _SWING

    @property
    def drag(self) -> float:
        """Return the quadratic drag over I [1/rad], by equal work in a cycle: 8/3 c r³ ω² = π d ω r² at the same r."""
        if self.law != "drag":
            return 0.0
        return 3 * math.pi / 8 * 2 * self.damping_ratio * self.dry_share / (0.5 * _SWING)

    @property
    def cubic_per_s2(self) -> float:
        """Return k₃/I [1/(s² rad²)]."""
        return self.cubic / (1 - self.cubic) * self.omega**2 / _SWING**2


def draw_truth(law: DampingLaw, kind: Kind, cubic: bool, seed: int) -> Truth:
    """Return the hidden numbers of a seed: 2.5-5 Hz, D of 0.03-0.25, noise of 0.05-1°."""
    rng = np.random.default_rng([seed, LAWS.index(law), EXCITATIONS.index(kind), int(cubic)])
    return Truth(
        law,
        kind,
        frequency_hz=rng.uniform(2.5, 5.0),
        damping_ratio=math.exp(rng.uniform(math.log(0.03), math.log(0.25))),
        dry_share=rng.uniform(0.2, 0.8),
        cubic=rng.uniform(0.1, 0.4) if cubic else 0.0,
        noise_deg=math.exp(rng.uniform(math.log(0.05), math.log(1.0))),
        held=bool(rng.integers(2)),
    )


def _branches(loss_factor: float) -> tuple[Array, Array]:
    """Return (shares, relaxation times [s]) of Maxwell branches whose tan δ is constant over the band."""
    corner = np.geomspace(_BRANCH_BAND_HZ[0] / 1.5, _BRANCH_BAND_HZ[1] * 1.5, _BRANCH_COUNT)
    tau = 1 / (2 * np.pi * corner)
    wt = 2 * np.pi * np.geomspace(*_BRANCH_BAND_HZ, 200)[:, None] * tau
    loss, storage = wt / (1 + wt**2), wt**2 / (1 + wt**2)
    shares, _ = nnls(loss - loss_factor * storage, np.full(wt.shape[0], loss_factor))
    return np.asarray(shares), tau


def _drive(truth: Truth) -> tuple[Callable[[float], float], Callable[[Array], Array]]:
    """Return the push over the inertia [rad/s²] as a function of time, and the input that is measured."""
    low, high = 0.35 * truth.frequency_hz, 1.9 * truth.frequency_hz
    slope = (high - low) / _SWEEP_S

    def phase(t: Array) -> Array:
        return np.asarray(2 * np.pi * (low * t + 0.5 * slope * t**2))

    size = _SWING * 2 * truth.damping_ratio * truth.omega**2
    if truth.kind == "torque":
        return lambda t: size * math.sin(float(phase(np.asarray(t)))), lambda t: _INERTIA * size * np.sin(phase(t))
    swing = min(size / (_LEVER_SHARE * truth.omega**2), math.radians(40))

    def lever_push(t: float) -> float:
        rate = 2 * math.pi * (low + slope * t)
        at = float(phase(np.asarray(t)))
        return _LEVER_SHARE * swing * (rate**2 * math.sin(at) - 2 * math.pi * slope * math.cos(at))

    return lever_push, lambda t: swing * np.sin(phase(t))


class _Joint:
    """The equation of motion r'' = push - damping - stiffness, its branches in the state."""

    def __init__(self, truth: Truth, push: Callable[[float], float]) -> None:
        self.truth, self.push = truth, push
        self.shares, self.tau = _branches(2 * truth.damping_ratio) if truth.law == "loss-factor" else (np.zeros(0),) * 2
        wt = (truth.omega * self.tau) ** 2
        self.relaxed = truth.omega**2 / (1 + float(np.sum(self.shares * wt / (1 + wt))))

    def pull(self, r: float, z: Array) -> float:
        """Return what acts on the position, without dampers."""
        spring = self.relaxed * (r + float(self.shares @ (r - z))) if self.tau.size else self.truth.omega**2 * r
        return spring + self.truth.cubic_per_s2 * r**3

    def rate(self, t: float, y: Array, sign: float) -> Array:
        """Return the state's rate while the motion has this sign."""
        r, v, z = float(y[0]), float(y[1]), y[2:]
        lost = self.truth.viscous * v + self.truth.drag * abs(v) * v + self.truth.dry * sign
        force = self.push(t) - lost - self.pull(r, z)
        return np.concatenate([[v, force], (r - z) / self.tau if self.tau.size else []])

    def motion(self, time: Array, start: Array) -> Array:
        """Return the states at the times, shape (n, 2 + branches)."""
        if self.truth.dry == 0:
            return self._smooth(time, start, 0.0)
        return self._with_reversals(time, start)

    def _smooth(self, time: Array, start: Array, sign: float) -> Array:
        span = (float(time[0]), float(time[-1]))
        done = solve_ivp(self.rate, span, start, "DOP853", time, args=(sign,), rtol=1e-9, atol=1e-11, max_step=0.05)
        return np.asarray(done.y.T)

    def _with_reversals(self, time: Array, start: Array) -> Array:
        """Integrate from reversal to reversal; between them it may rest, as long as the friction holds."""

        def reversal(t: float, y: Array) -> float:
            return float(y[1])

        reversal.terminal = True  # type: ignore[attr-defined]
        out = np.tile(np.asarray(start, dtype=float), (time.size, 1))
        t, y = float(time[0]), np.asarray(start, dtype=float)
        while t < time[-1] - 1e-12:
            net = self.push(t) - self.pull(float(y[0]), y[2:])
            if abs(y[1]) < 1e-9 and abs(net) <= self.truth.dry:
                t = self._rest_until(t, float(y[0]), float(time[-1]))
                continue
            sign = math.copysign(1.0, y[1] if abs(y[1]) >= 1e-9 else net)
            if abs(y[1]) < 1e-9:  # step off the reversal, or its own event would stop it at once
                small = 1e-7
                y = np.array([y[0], sign * (abs(net) - self.truth.dry) * small])
                t += small
            reversal.direction = -sign  # type: ignore[attr-defined]
            done = solve_ivp(
                partial(self.rate, sign=sign), (t, float(time[-1])), y, "DOP853", events=reversal,
                rtol=1e-9, atol=1e-11, max_step=0.05, dense_output=True,
            )  # fmt: skip
            end = float(done.t[-1])
            mine = (time >= t - 1e-6) & (time <= end)
            if mine.any():
                assert done.sol is not None  # `dense_output` asks for it
                out[mine] = done.sol(time[mine]).T
            t, y = end, np.array([done.y[0, -1], 0.0])
            out[time > end] = y
        return out

    def _rest_until(self, t: float, r: float, end: float) -> float:
        held = self.pull(r, np.zeros(0))
        later = np.arange(t, end + 1e-4, 1e-4)
        return next((float(s) for s in later if abs(self.push(float(s)) - held) > self.truth.dry), end)


def clean_record(truth: Truth) -> Record:
    """Return the oscillation without noise: angle [rad] at 100 Hz, under a torque [N m], a lever [rad], or none."""
    if truth.kind == "decay":
        return _decay(truth)
    push, given = _drive(truth)
    time = np.arange(0, _SWEEP_S, 1 / _RATE_HZ)
    joint = _Joint(truth, push)
    turned = joint.motion(time, np.zeros(2 + joint.tau.size))[:, 0]
    unit = "N*m" if truth.kind == "torque" else "rad"
    return make_record(time, turned, given(time), excitation=truth.kind, output_unit="rad", input_unit=unit)


def _decay(truth: Truth) -> Record:
    """Return a decay after a hold of 20 s, or after three seconds of drive at the natural frequency."""
    time = np.arange(0, _DECAY_S, 1 / _RATE_HZ)
    free = _Joint(truth, lambda t: 0.0)
    if truth.held:
        start = np.concatenate([[_SWING, 0.0], _SWING * (1 - np.exp(-20.0 / free.tau))])
    else:
        size = _SWING * 2 * truth.damping_ratio * truth.omega**2
        driven = _Joint(truth, lambda t: size * math.sin(truth.omega * t))
        whole = math.ceil(3.0 * truth.frequency_hz) / truth.frequency_hz
        start = driven.motion(np.array([0.0, 0.5 * whole, whole]), np.zeros(2 + free.tau.size))[-1]
    return make_record(time, free.motion(time, start)[:, 0], output_unit="rad")


def noisy_record(clean: Record, truth: Truth, seed: int) -> Record:
    """Return the record with white noise on its output."""
    rng = np.random.default_rng([seed, 7])
    return replace(clean, output=clean.output + rng.normal(0, math.radians(truth.noise_deg), clean.size))


# The choice of a law.

CAN, CANNOT = 20.0, 2.0
Margin = Literal["can tell", "between", "cannot tell"]
Verdict = Literal["picked", "cannot tell", "bounded", "wrong"]
_EXTEND_VISCOUS: tuple[DampingLaw, ...] = ("coulomb", "drag")


@dataclass(frozen=True)
class Outcome:
    """What came of one oscillation.

    evidence: expected difference of the criterion to the nearest law. chosen: the law that is reported; model: its
    name. verdict: picked; cannot tell; bounded (viscous, and dry friction below a bound that holds the truth); wrong.
    own_misfit: what the generating law leaves of the clean record, over the noise.
    """

    truth: Truth
    seed: int
    evidence: float
    chosen: DampingLaw | Literal["hysteresis"]
    model: str
    verdict: Verdict
    own_misfit: float
    sentence: str

    @property
    def margin(self) -> Margin:
        """Return whether the law can be told."""
        return "can tell" if self.evidence > CAN else "cannot tell" if self.evidence < CANNOT else "between"


def expected_margin(clean: Record, truth: Truth, samples: int) -> tuple[float, float]:
    """Return (expected difference of the criterion to the nearest other law, own misfit over the noise).

    samples: that teach. Every law is given the richest stiffness law (and, in a decay, a creeping rest position) at the
    price of the generating one's, so the difference is rather too small. A law that contains the generating one (dry
    friction or drag beside viscous damping) is no other law.
    """
    noise = math.radians(truth.noise_deg) ** 2
    score = {}
    rests: tuple[Rest, ...] = ("offset", "creep") if truth.kind == "decay" else ("offset",)
    viscous = {rest: _fitted(clean, "viscous", rest, []) for rest in rests}
    for law in LAWS:
        fits = [one for rest, plain in viscous.items() for one in _fitted(clean, law, rest, plain)]
        left = min(one.rmse for one in fits if _law_of(one.model) == law) ** 2
        score[law] = (samples * math.log(noise + left) + (law in _EXTEND_VISCOUS) * math.log(samples), left)
    contained = _EXTEND_VISCOUS if truth.law == "viscous" else ()
    others = [one for law, (one, _) in score.items() if law != truth.law and law not in contained]
    own, misfit = score[truth.law]
    return min(others) - own, math.sqrt(misfit / noise)


def _law_of(model: Model) -> DampingLaw | Literal["hysteresis"]:
    if model.law.has(BoucWen):
        return "hysteresis"
    if model.law.has(Drag):
        return "drag"
    return "coulomb" if model.law.has(DryFriction) else "loss-factor" if model.law.has(LossFactor) else "viscous"


def _fitted(clean: Record, law: DampingLaw, rest: Rest, viscous: Sequence[Fit]) -> list[Fit]:
    """Return the fits of a law with springs of more and more terms; viscous: the same of that law, to begin at."""
    fits = list(viscous)
    for model in laws_to_try():
        if _law_of(model) == law and not (viscous and law == "viscous"):
            known = [one for one in fits if set(one.model.law.bends) <= set(model.law.bends)]
            fits.append(fit(clean, model.resting(rest), smaller=min(known, key=lambda one: one.rmse, default=None)))
    return fits


def run_trial(law: DampingLaw, kind: Kind, cubic: bool, seed: int) -> Outcome:
    """Return what comes of one oscillation."""
    truth = draw_truth(law, kind, cubic, seed)
    clean = clean_record(truth)
    split = split_record(noisy_record(clean, truth, seed), None, None)
    evidence, own = expected_margin(clean, truth, int(split.selected.sum()))
    found = compare_laws(split)
    chosen = found.best.model
    return Outcome(
        truth, seed, evidence, _law_of(chosen), chosen.name, _verdict(found, truth), own, found.verdict
    )  # fmt: skip


def _verdict(found: Comparison, truth: Truth) -> Verdict:
    if not found.decided:
        return "cannot tell"
    told = _law_of(found.best.model)
    if told == truth.law:
        return "picked"
    bound = found.dry_bound
    if truth.law == "coulomb" and told == "viscous" and bound is not None and truth.dry <= bound:
        return "bounded"
    return "wrong"


def table(outcomes: Sequence[Outcome]) -> str:
    """Return law x excitation: counts of the verdicts, by whether the law can be told."""
    names = ("law", "excitation", "margin", "verdict")
    rows = pd.DataFrame([(one.truth.law, one.truth.kind, one.margin, one.verdict) for one in outcomes], columns=names)
    by = [rows[name] for name in names]
    return str(pd.crosstab(by[:2], by[2:], margins=True, margins_name="all").to_string())


def main() -> None:
    """Run the trials and print the table."""
    parser = campaign_parser("laws", __doc__, count=20, of="seeds", numbered=True, workers=TWO, verbose=True)
    parser.add_argument("--law", choices=LAWS, action="append", help="only this law")
    parser.add_argument("--excitation", choices=EXCITATIONS, action="append", help="only this excitation")
    chosen = parser.parse_args()
    trials = [
        (law, kind, cubic, seed)
        for seed in asked_seeds(chosen)
        for law in chosen.law or LAWS
        for kind in chosen.excitation or EXCITATIONS
        for cubic in (False, True)
    ]
    outcomes = []
    for outcome in spread_trials(run_trial, *zip(*trials, strict=True), spread=spread_of(chosen)):
        outcomes.append(outcome)
        if chosen.verbose:
            print(_line(outcome), flush=True)
    told = [one for one in outcomes if one.margin == "can tell"]
    picked = f"picked where it can be told: {np.mean([one.verdict == 'picked' for one in told]):.1%} of {len(told)}"
    wrong = f"wrong and decided: {sum(one.verdict == 'wrong' for one in outcomes)} of {len(outcomes)}"
    conclude(chosen.out, "\n".join([table(outcomes), picked, wrong]), list(map(asdict, outcomes)))


def _line(one: Outcome) -> str:
    t = one.truth
    return (
        f"{one.seed:4d} {t.law:11s} {t.kind:6s} cubic {t.cubic:.2f} f {t.frequency_hz:.2f} D {t.damping_ratio:.3f} dry "
        f"{t.dry_share:.2f} noise {t.noise_deg:.2f} held {int(t.held)}: evidence {one.evidence:8.1f} own misfit "
        f"{one.own_misfit:.3f} -> {one.verdict}, {one.model}"
    )


if __name__ == "__main__":
    main()
