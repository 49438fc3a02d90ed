"""This is where the search through a stepped sine begins: the balance of the fundamental is linear in its numbers.

Of the motion y that was measured, [K - ω² + jωD + jc 4/(π|y|) + ¾κ₃|y|²] y = g a at every frequency. Weighted with the
scatter of the points through that dynamic stiffness (Sanathanan and Koerner's iteration), one linear regression after
the other tells K, D or the loss factor, c, κ₃, g, and a turn of the phase where one is sought.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sinew.identify.grid import Frame, Scales, input_derivative
from sinew.identify.model import Model
from sinew.identify.record import derivative_order
from sinew.identify.response_points import ResponsePoints

__all__ = ["motion_and_push", "regress_response", "scales_of_points"]

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_ROUNDS = 6


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
    if model.damping == "loss-factor":
        columns["damping"] = 1j * y
    if model.damping == "coulomb":
        columns["coulomb"] = 4j / np.pi * y / np.abs(y)
    if "cubic" in model.terms:
        columns["cubic"] = 0.75 * np.abs(y) ** 2 * y
    target = omega**2 * y
    signals = points[0].signals
    if points[0].excitation == "base" and signals.input_motion_unit == signals.motion_unit:
        target = target + a
    else:
        columns |= {"gain": -a} | ({"gain_imag": -1j * a} if turned else {})
    found = _weighted(columns, target, std, y)
    if not found["stiffness"] > 0:
        found["stiffness"] = float(omega[np.argmax(np.abs(y))] ** 2)
    if model.damping == "loss-factor":
        found["loss_factor"] = found.pop("damping") / found["stiffness"]
    if "gain_imag" in found:
        turned_gain = complex(found["gain"], found.pop("gain_imag"))
        found |= {"gain": abs(turned_gain), "phase": float(np.angle(turned_gain))}
    return found


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
        scale = np.linalg.norm(real, axis=0)
        scale[scale == 0] = 1.0
        x = np.linalg.lstsq(real / scale, wanted, rcond=1e-12)[0] / scale
        dynamic = np.abs((table[:, mechanical] @ x[mechanical] - target) / y)
        weight = 1.0 / (std * np.maximum(dynamic, 1e-3 * float(dynamic.max())))
    return dict(zip(names, map(float, x), strict=True))
