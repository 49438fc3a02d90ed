"""Time of the prediction of a hardening oscillator through its folds.

The reference is a hardening oscillator whose peak and folds are known to seven digits. pyHarm-os follows the same curve
beside it, in an interpreter of its own.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.peer_marks import marks
from benchmarks.peers import PeerSilentError, told_by
from benchmarks.table import Row, best_of
from sinew.predict.oscillator import Oscillator, oscillator_problem, resolution_of
from sinew.solve.curves import predict
from sinew.solve.programs import use_all_cores

BAND_HZ = (1.0, 6.0)
UPPER_FOLD_HZ, LOWER_FOLD_HZ = 3.818697, 3.521591
SHOT_PEAK_RAD = 0.7937292
"""Largest rotation that shooting finds (tests/peers)."""

PEER_SETTINGS = [{"harmonics": 7, "samples": 32, "step": step} for step in (0.3, 0.1, 0.02)]
"""Of pyHarm-os: odd harmonics, samples over a period, largest step of the dimensionless arc length. With the last one
its folds come within 1e-6, as ours; more harmonics change nothing there."""


def reference() -> Oscillator:
    """Return the reference oscillator."""
    return Oscillator(12.74e-3, 3.0, 0.05, cubic=6.0, torque=0.45)


def one_curve() -> Any:
    """Return the prediction of the reference oscillator."""
    use_all_cores()
    one = [reference()]
    return predict(oscillator_problem(one, BAND_HZ), BAND_HZ, resolution_of(one))


def rows() -> Iterator[Row]:
    """Yield one curve with folds, peak and stability beside pyHarm-os, which has the curve alone."""
    one_curve()
    seconds, done = best_of(30, one_curve)
    branch = done.branches[0]
    off = _off(branch.peak.amplitude, *(fold.frequency_hz for fold in branch.folds))
    work = "the reference oscillator, 1-6 Hz"
    one = reference()
    asked = {
        "inertia": one.inertia,
        "stiffness": one.stiffness,
        "damping": 2 * one.damping_ratio * np.sqrt(one.stiffness * one.inertia),
        "cubic": one.cubic,
        "torque": one.torque,
        "band_hz": BAND_HZ,
        "amplitude": 0.8,
        "settings": PEER_SETTINGS,
        "runs": 5,
    }
    try:
        told = told_by("pyharm_curve.py", asked)
    except PeerSilentError as error:
        yield Row(work, 1e3 * seconds, "pyHarm-os", None, "ms", f"skipped: {error}; ours {off}")
        return
    for found in told["curves"]:
        f, a = np.array(found["frequency_hz"]), np.array(found["amplitude"])
        name, theirs = f"pyHarm-os, steps up to {found['step']:g}", 1e3 * min(found["seconds"])
        yield Row(work, 1e3 * seconds, name, theirs, "ms", f"ours {off}; its {_off(*marks(f, a))}")


def _off(peak: float, upper: float, lower: float) -> str:
    """Return how far peak [rad] and folds [Hz] are from those of the reference."""
    return (
        f"peak off by {abs(peak - SHOT_PEAK_RAD):.0e}, folds by {abs(upper - UPPER_FOLD_HZ):.0e} and "
        f"{abs(lower - LOWER_FOLD_HZ):.0e}"
    )
