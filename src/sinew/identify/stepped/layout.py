"""The points of one or several stepped sines, laid out for a search in normal form."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sinew.analysis.signal.coloured_noise import solve_scaled
from sinew.identify.oscillator.model import Layout, Model, Part, make_layout
from sinew.identify.oscillator.record import Frame, Scales, derivative_order, input_derivative, relaxation_of
from sinew.identify.oscillator.track import Grid
from sinew.identify.stepped.oscillation import Drive, Laws, number_names, oscillate
from sinew.identify.stepped.points import ResponsePoints
from sinew.measure.arrays import Array, Complexes
from sinew.mechanics.laws import Cubic, LossFactor, Term
from sinew.mechanics.silicone import relaxation_times

CHAIN = ("phase", "background_real", "background_imag")
"""What the measuring chain may add: a turn of the response [rad], and a response that does not depend on frequency, as
a share of the largest."""


def drive_of(points: ResponsePoints, scales: Scales, amplitude: float | Array) -> Drive:
    """Return what an input of given amplitudes, in its unit, drives in normal form."""
    power = input_derivative(points.signals)
    sign = -1.0 if points.excitation in ("base", "lever") else 1.0
    return Drive(sign * amplitude * scales.omega**power / scales.forcing, power)


@dataclass(frozen=True)
class Predicted:
    """The response of one group of points, shape (n,), its slopes by the vector x, shape (n, m), and at which points
    the balance was reached, shape (n,)."""

    response: Complexes
    slopes: Complexes
    found: NDArray[np.bool_]


@dataclass(frozen=True)
class ResponseLayout:
    """Which number of the search goes where.

    layout: entries, index, column and ratio as of a fit in time (`sinew.identify.oscillator.model`), for the
    mechanical numbers; those of the chain (`chain`, of `CHAIN`) follow them in x. size: of the largest response, in its
    unit.
    """

    layout: Layout
    points: tuple[ResponsePoints, ...]
    frame: Frame
    chain: tuple[str, ...]
    size: float

    @property
    def mechanics(self) -> int:
        """Return how many of the numbers are mechanical."""
        return len(self.layout.entries)

    @property
    def width(self) -> int:
        """Return how many numbers are sought."""
        return self.mechanics + len(self.chain)

    def laws(self, part: int) -> Laws:
        """Return the laws of one group."""
        model, grid = self.layout.model, self.layout.parts[part].grid
        natural = float(grid.relaxation[0] / relaxation_times()[0])
        return Laws(model.law, natural, float(grid.amplitude))

    def numbers(self, x: Array, part: int) -> Array:
        """Return the numbers of the law and the gain of one group, shape (l,)."""
        return self.layout.local(x[: self.mechanics], part)

    def added(self, x: Array) -> tuple[complex, complex]:
        """Return the turn and the background of the measuring chain."""
        held = dict(zip(self.chain, x[self.mechanics :], strict=True))
        turn = complex(np.exp(1j * held.get("phase", 0.0)))
        return turn, self.size * complex(held.get("background_real", 0.0), held.get("background_imag", 0.0))

    def predict(self, x: Array, part: int) -> Predicted:
        """Return the response of one group; of several oscillations at a frequency the one nearest to the measured."""
        points, layout = self.points[part], self.layout
        scales, order = layout.parts[part].scales, layout.parts[part].order
        numbers, (turn, background) = self.numbers(x, part), self.added(x)
        amplitude, fast = points.input_amplitude, 2j * np.pi * points.frequency_hz
        to_output = (fast / scales.omega) ** order * scales.amplitude * scales.omega**order / amplitude * turn
        carried = np.zeros(points.size, dtype=complex)
        if self.frame == "absolute":  # the base's own motion, in the normal form of the relative motion
            carried = fast ** (-derivative_order(points.input_unit)) * amplitude * scales.omega**2 / scales.forcing
        begin = (points.response - background) / to_output - numbers[-1] * carried
        omega = 2 * np.pi * points.frequency_hz / scales.omega
        steady = oscillate(numbers, omega, drive_of(points, scales, amplitude), self.laws(part), begin)
        bare = (steady.fundamental + numbers[-1] * carried) * to_output
        by_number = steady.slopes.copy()
        by_number[:, -1] += carried
        by_number = by_number * to_output[:, None]
        slopes = np.zeros((points.size, self.width), dtype=complex)
        slopes[:, layout.index[part]] = by_number[:, layout.column[part]] * layout.ratio[part]
        for k, name in enumerate(self.chain, start=self.mechanics):
            slopes[:, k] = {"phase": 1j * bare, "background_real": self.size, "background_imag": 1j * self.size}[name]
        return Predicted(np.asarray(bare + background), slopes, steady.found)


def make_response_layout(
    model: Model,
    points: Sequence[ResponsePoints],
    scales: Sequence[Scales],
    frame: Frame,
    varying: Sequence[str] = (),
    chain: Sequence[str] = (),
) -> ResponseLayout:
    """Return the layout. varying: mechanical numbers (of `LOCAL`) that each group has for itself."""
    names, none = number_names(model.law), np.empty(0)
    parts = []
    for one, own in zip(points, scales, strict=True):
        fixed = np.zeros(len(names))
        if one.excitation == "base":
            fixed[-1] = 1.0 / own.physical("gain")
        grid = Grid(none, np.empty((0, 3)), none, none, relaxation_of(own.omega) * own.omega, np.asarray(own.amplitude))
        order = derivative_order(one.output_unit)
        unit_size = own.amplitude * own.omega**order
        parts.append(Part(one.signals, own, grid, none.astype(np.intp), none.astype(bool), order, unit_size, fixed))
    layout = make_layout(model, parts, varying, names)
    size = max(float(np.abs(one.response).max()) for one in points)
    return ResponseLayout(layout, tuple(points), frame, tuple(chain), size)


# The search through a stepped sine begins: the balance of the fundamental is linear in its numbers.
#
# Of the motion y that was measured, [K - ω² + jωD + jc 4/(π|y|) + ¾κ₃|y|²] y = g a at every frequency. Weighted with
# the scatter of the points through that dynamic stiffness (Sanathanan and Koerner's iteration), one linear regression
# after the other tells K, D or the loss factor, c, κ₃, g, and a turn of the phase where one is sought.

_ROUNDS = 6
_PHASES = 256  # of a motion, at which a force is read whose fundamental has no closed form here
_SEEN = 1e-9  # of the force


def scales_of_points(points: ResponsePoints, values: dict[str, float], frame: Frame) -> Scales:
    """Return what makes the numbers of one group near one. values: of `regress_response`."""
    motion, push = motion_and_push(points, frame)
    return Scales(float(np.sqrt(values["stiffness"])), float(np.abs(motion).max()), float(np.abs(push).max()))


def motion_and_push(points: ResponsePoints, frame: Frame) -> tuple[Complexes, Complexes]:
    """Return motion relative to the base and drive a of the points, in SI units."""
    turn = 2j * np.pi * points.frequency_hz
    motion = points.response * points.input_amplitude / turn ** derivative_order(points.output_unit)
    if frame == "absolute":
        motion = motion - points.input_amplitude / turn ** derivative_order(points.input_unit)
    sign = -1.0 if points.excitation in ("base", "lever") else 1.0
    push = sign * turn ** input_derivative(points.signals) * points.input_amplitude
    return np.asarray(motion, dtype=complex), np.asarray(push, dtype=complex)


def regress_response(points: Sequence[ResponsePoints], model: Model, frame: Frame, turned: bool) -> dict[str, float]:
    """Return coefficients of the model in SI units, by name of `LOCAL`, and `phase` [rad]; all points share them.

    turned: whether the measuring chain may turn the phase. A moving base of the output's own unit has a gain of one.
    """
    pairs = [motion_and_push(one, frame) for one in points]
    y, a = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    omega = 2 * np.pi * np.concatenate([one.frequency_hz for one in points])
    size = [one.input_amplitude / (2 * np.pi * one.frequency_hz) ** derivative_order(one.output_unit) for one in points]
    std = np.concatenate(
        [np.sqrt(0.5 * np.trace(one.covariance, axis1=1, axis2=2)) * s for one, s in zip(points, size, strict=True)]
    )
    columns: dict[str, Complexes] = {"stiffness": y, "damping": 1j * omega * y}
    if model.law.has(LossFactor):
        columns["damping"] = 1j * y
    if model.law.sticks:
        columns["coulomb"] = 4j / np.pi * y / np.abs(y)
    if model.law.has(Cubic):
        columns["cubic"] = 0.75 * np.abs(y) ** 2 * y
    for term in model.law.terms:
        name = term.numbers[0].name
        if name not in (*columns, "loss_factor") and (wave := _fundamental(term, y, omega)) is not None:
            columns[name] = wave
    target = omega**2 * y
    signals = points[0].signals
    if points[0].excitation == "base" and signals.input_motion_unit == signals.motion_unit:
        target = target + a
    else:
        columns |= {"gain": -a} | ({"gain_imag": -1j * a} if turned else {})
    found = _weighted(columns, target, std, y)
    if not found["stiffness"] > 0:
        found["stiffness"] = float(omega[np.argmax(np.abs(y))] ** 2)
    if model.law.has(LossFactor):
        found["loss_factor"] = found.pop("damping") / found["stiffness"]
    if "gain_imag" in found:
        turned_gain = complex(found["gain"], found.pop("gain_imag"))
        found |= {"gain": abs(turned_gain), "phase": float(np.angle(turned_gain))}
    return found


def _fundamental(term: Term, y: Complexes, omega: Array) -> Complexes | None:
    """Return the fundamental of a term's force over its first number, shape (n,), of motions Re y exp(jωt); None where
    it has none, as an even force."""
    phase = 2 * np.pi * (np.arange(_PHASES) + 0.5) / _PHASES
    size = np.abs(y)[:, None]
    signal, order = term.regressor(size * np.cos(phase), -omega[:, None] * size * np.sin(phase))
    wave = 2 * np.mean(signal * np.exp(-1j * phase), axis=1)
    if np.abs(wave).max() < _SEEN * np.abs(signal).max():
        return None
    return np.asarray(wave * (1j * omega) ** order * y / np.abs(y))


def _weighted(columns: dict[str, Complexes], target: Complexes, std: Array, y: Complexes) -> dict[str, float]:
    """Return the coefficients whose equation error, seen as an error of the motion, is least."""
    names = list(columns)
    table = np.stack(list(columns.values()), axis=1)
    mechanical = np.array([not name.startswith("gain") for name in names])
    weight = 1.0 / (np.abs(target) + 1e-300)
    x = np.zeros(len(names))
    for _ in range(_ROUNDS):
        rows, goal = table * weight[:, None], target * weight
        real, wanted = np.concatenate([rows.real, rows.imag]), np.concatenate([goal.real, goal.imag])
        x = solve_scaled(real, wanted, 1e-12)
        dynamic = np.abs((table[:, mechanical] @ x[mechanical] - target) / y)
        weight = 1.0 / (std * np.maximum(dynamic, 1e-3 * float(dynamic.max())))
    return dict(zip(names, map(float, x), strict=True))
