"""This is where the points of one or several stepped sines are laid out for a search, in normal form."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sinew.identify.grid import Frame, Scales, input_derivative
from sinew.identify.layout import Entry, Layout, Part, free_mechanics
from sinew.identify.model import Model
from sinew.identify.record import derivative_order
from sinew.identify.response_balance import NUMBERS, Balance, Laws, balance
from sinew.identify.response_points import ResponsePoints
from sinew.identify.track import LOCAL, Grid
from sinew.twin.prony import BAND_HZ, relaxation_times

__all__ = ["CHAIN", "Normal", "Predicted", "ResponseLayout", "make_response_layout", "normal_form"]

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

CHAIN = ("phase", "background_real", "background_imag")
"""What the measuring chain may add: a turn of the response [rad], and a response that does not depend on frequency, as
a share of the largest."""


class Normal(NamedTuple):
    """Points in normal form: omega in ω_r; push, carried: a and z of the drive at the points' input amplitudes;
    to_output: what r₁ is multiplied by to be the response; shape (n,) each."""

    omega: Array
    push: Complexes
    carried: Complexes
    to_output: Complexes


def normal_form(points: ResponsePoints, scales: Scales, frame: Frame) -> Normal:
    """Return the drive of the points in normal form, the conventions those of `sinew.identify.grid`."""
    signals = points.signals
    turn = 2j * np.pi * points.frequency_hz
    amplitude = points.input_amplitude
    sign = -1.0 if points.excitation in ("base", "lever") else 1.0
    push = sign * turn ** input_derivative(signals) * amplitude / scales.forcing
    order = derivative_order(points.output_unit)
    to_output = (turn / scales.omega) ** order * scales.amplitude * scales.omega**order / amplitude
    carried = np.zeros(points.size, dtype=complex)
    if frame == "absolute":  # the base's own motion, in the normal form of the relative motion
        carried = turn ** (-derivative_order(points.input_unit)) * amplitude * scales.omega**2 / scales.forcing
    omega = 2 * np.pi * points.frequency_hz / scales.omega
    return Normal(omega, np.asarray(push, dtype=complex), carried, np.asarray(to_output, dtype=complex))


@dataclass(frozen=True)
class Predicted:
    """The response of one group of points, shape (n,), its slopes by the vector x, shape (n, m), and the balance."""

    response: Complexes
    slopes: Complexes
    balance: Balance


@dataclass(frozen=True)
class ResponseLayout:
    """Which number of the search goes where.

    layout: entries, index, column and ratio as of a fit in time (`sinew.identify.layout`), for the mechanical numbers;
    those of the chain (`chain`, of `CHAIN`) follow them in x. size: of the largest response, in its unit.
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
        return Laws(model.damping, model.stiffness, bool(model.terms), grid.relaxation, float(grid.amplitude))

    def numbers(self, x: Array, part: int) -> Array:
        """Return the numbers of `NUMBERS` of one group, shape (7,)."""
        return self.layout.local(x[: self.mechanics], part)[: len(NUMBERS)]

    def added(self, x: Array) -> tuple[complex, complex]:
        """Return the turn and the background of the measuring chain."""
        held = dict(zip(self.chain, x[self.mechanics :], strict=True))
        turn = complex(np.exp(1j * held.get("phase", 0.0)))
        return turn, self.size * complex(held.get("background_real", 0.0), held.get("background_imag", 0.0))

    def predict(self, x: Array, part: int, points: ResponsePoints | None = None) -> Predicted:
        """Return the response of one group; points: others than its own, whose measured response chooses the branch."""
        points = self.points[part] if points is None else points
        scales = self.layout.parts[part].scales
        normal = normal_form(points, scales, self.frame)
        numbers, (turn, background) = self.numbers(x, part), self.added(x)
        begin = (points.response - background) / turn / normal.to_output - numbers[6] * normal.carried
        steady = balance(numbers, normal.omega, normal.push, self.laws(part), begin)
        bare = (steady.fundamental + numbers[6] * normal.carried) * normal.to_output * turn
        by_number = steady.slopes[:, 1] + 1j * steady.slopes[:, 2]
        by_number[:, 6] += normal.carried
        by_number = by_number * (normal.to_output * turn)[:, None]
        slopes = np.zeros((points.size, self.width), dtype=complex)
        layout = self.layout
        slopes[:, layout.index[part]] = by_number[:, layout.column[part]] * layout.ratio[part]
        for k, name in enumerate(self.chain, start=self.mechanics):
            slopes[:, k] = {"phase": 1j * bare, "background_real": self.size, "background_imag": 1j * self.size}[name]
        return Predicted(np.asarray(bare + background), slopes, steady)


def _relaxation(omega: float) -> Array:
    """Return the relaxation times in 1/ω_r, moved along where the oscillation is not well inside the twin's band."""
    centre, frequency = float(np.sqrt(BAND_HZ[0] * BAND_HZ[1])), omega / (2 * np.pi)
    move = 1.0 if 0.2 * centre <= frequency <= 5 * centre else centre / frequency
    return relaxation_times() * move * omega


def make_response_layout(
    model: Model,
    points: Sequence[ResponsePoints],
    scales: Sequence[Scales],
    frame: Frame,
    varying: Sequence[str] = (),
    chain: Sequence[str] = (),
) -> ResponseLayout:
    """Return the layout. varying: mechanical numbers (of `LOCAL`) that each group has for itself."""
    groups = list(dict.fromkeys(one.group for one in points))
    signals = [one.signals for one in points]
    entries: list[Entry] = []
    for name in free_mechanics(model, signals[0]):
        entries += [Entry(name, group=group) for group in groups] if name in varying else [Entry(name)]
    parts, index, column, ratio = [], [], [], []
    for record, own in zip(signals, scales, strict=True):
        mine = [k for k, entry in enumerate(entries) if entry.group in ("", record.group)]
        index.append(np.array(mine, dtype=np.intp))
        column.append(np.array([LOCAL.index(entries[k].local) for k in mine], dtype=np.intp))
        names = [entries[k].local for k in mine]
        ratio.append(np.array([scales[0].physical(name) / own.physical(name) for name in names]))
        fixed = np.zeros(len(LOCAL))
        if record.excitation == "base":
            fixed[LOCAL.index("gain")] = 1.0 / own.physical("gain")
        none = np.empty(0)
        grid = Grid(none, np.empty((0, 3)), none, none, _relaxation(own.omega), np.asarray(own.amplitude))
        order = derivative_order(record.output_unit)
        unit_size = own.amplitude * own.omega**order
        nothing = np.empty(0, dtype=bool)
        parts.append(Part(record, own, grid, np.empty(0, dtype=np.intp), nothing, order, unit_size, fixed))
    layout = Layout(model, tuple(parts), tuple(entries), tuple(index), tuple(column), tuple(ratio))
    size = max(float(np.abs(one.response).max()) for one in points)
    return ResponseLayout(layout, tuple(points), frame, tuple(chain), size)
