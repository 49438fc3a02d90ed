"""Constants of a bench out of small moves: the drive's friction and speed, the sensor's delay."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, lfilter, savgol_filter

from sinew.bench.guide.moves import LeverMove, Numbers
from sinew.plan.rig import RigSpec

SAMPLE_PERIOD = 5e-3
"""Time between two samples of the node [s], over which it averages."""


@dataclass(frozen=True, slots=True)
class Found:
    """A number and its standard deviation."""

    value: float
    std: float


# The lever's motor: what it draws, and what duty it needs, at two slow speeds.

_SMOOTH = 9  # samples, to both sides alike: no delay
_TURNS_S = 0.12  # after the lever has turned round; until then its motor accelerates it


def drive_friction(moves: Sequence[LeverMove], spec: RigSpec) -> Found:
    """Return the Coulomb friction of the drive at its horn [N m], from what it draws while the lever goes slowly.

    The current is a mean, what swinging head and lever ask, what friction takes, and something proportional to the
    speed: goals come in steps, and readings at one moment between two of them. The torque of a current contains the
    friction itself, (M_s + f)/I_s a unit, so f = c M_s/(I_s - c).
    """
    swing, current, _, speed = _gathered(moves, _delay_s(spec))
    found, std = _fitted(np.column_stack([np.ones(len(speed)), swing, speed, np.sign(speed)]), current)
    stall, most = spec.drive.stall_torque.value, spec.drive.stall_current.value
    return Found(found * stall / (most - found), std * stall * most / (most - found) ** 2)


def drive_no_load_speed(moves: Sequence[LeverMove], spec: RigSpec, friction: float, supply: float) -> Found:
    """Return the speed of the unloaded drive at its nominal voltage [rad/s], from the duty that two speeds need.

    duty · M_0 = M + (M_s/ω_0) · speed, M = I (M_s + f)/I_s, M_0 = (M_s + f) supply/nominal. friction: f [N m].
    supply: measured [V].
    """
    _, currents, duty, speed = _gathered(moves, _delay_s(spec))
    drive = spec.drive
    per_ampere = (drive.stall_torque.value + friction) / drive.stall_current.value
    full = (drive.stall_torque.value + friction) * supply / drive.nominal_voltage.value
    left = duty * full - per_ampere * currents
    slope, std = _fitted(np.column_stack([np.ones(len(left)), speed]), left)
    found = drive.stall_torque.value / slope
    return Found(found, found * std / slope)


def _delay_s(spec: RigSpec) -> float:
    """Return by how much the sensor's chain is late at low frequency [s]."""
    imu = spec.imu
    low_pass = math.sqrt(2) / (math.tau * imu.low_pass.value)
    return imu.residual_delay.value + low_pass + 0.5 * (imu.average_samples - 1) * SAMPLE_PERIOD


def _gathered(moves: Sequence[LeverMove], delay: float) -> tuple[Numbers, Numbers, Numbers, Numbers]:
    """Return accelerations of head and lever [rad/s²], current, duty and speed, where the lever goes steadily."""
    rows = []
    for move in moves:
        step = float(np.median(np.diff(move.time)))

        def slope(values: Numbers, order: int = 1, step: float = step) -> Numbers:
            return np.asarray(savgol_filter(values, _SMOOTH, 2, deriv=order, delta=step))

        speed = slope(move.angle)
        head = slope(np.interp(move.time + delay, move.gyro_time, move.gyro))
        usual = float(np.median(np.abs(speed)))
        steady = np.abs(np.abs(speed) - usual) < 0.25 * usual
        steady &= np.convolve(~steady, np.ones(round(_TURNS_S / step)), "full")[: len(steady)] == 0
        rows.append(np.column_stack([head, slope(move.angle, 2), move.current, move.duty, speed])[steady])
    found = np.concatenate(rows)
    return found[:, :2], *found[:, 2:].T


def _fitted(columns: Numbers, values: Numbers) -> tuple[float, float]:
    """Return the last coefficient of a least-squares fit, and its standard deviation."""
    if len(values) <= columns.shape[1]:
        return math.nan, math.nan
    found, _, _, _ = np.linalg.lstsq(columns, values, rcond=None)
    left = values - columns @ found
    variance = float(left @ left) / (len(values) - columns.shape[1])
    return float(found[-1]), math.sqrt(variance * np.linalg.pinv(columns.T @ columns)[-1, -1])


# The sensor's delay: the head answers a step of the lever at once, what the sensor tells of it comes later.

_GRID_S = 0.5e-3
_LEAST_STD = 0.2e-3  # what encoder counts and unlike samples leave, whatever the fit says


@dataclass(frozen=True, slots=True)
class Answer:
    """How the head answers the lever.

    share: the lever's inertia in the whole, signed: negative where the lever turns the other way than it is told.
    frequency_hz, damping: of the joint with slack tendons. delay: of the sensor's chain beyond its low-pass and its
    average [s]. misfit: root mean square of what the fit leaves, over that of the gyroscope.
    """

    share: float
    frequency_hz: float
    damping: float
    delay: Found
    misfit: float


def answer_to(move: LeverMove, spec: RigSpec) -> Answer:
    """Return how the head answers the lever's steps: I φ'' + d φ' + k φ = -I_l θ'', seen through the sensor's chain.

    With ψ = φ + (I_l/I) θ no acceleration is needed. The chain is the chip's low-pass, the mean over its newest samples
    and a delay, which with share, frequency, damping and bias is fitted to the gyroscope.
    """
    start, stop = float(move.time[0]), float(move.time[-1])
    grid = np.arange(start, stop, _GRID_S)
    smooth = savgol_filter(move.angle, _SMOOTH, 3)
    angle = CubicSpline(move.time, smooth)
    theta, rate = angle(grid) - float(angle(start)), angle(grid, 1)
    inside = (move.gyro_time > start + 0.05) & (move.gyro_time < stop)
    times, gyro = move.gyro_time[inside], move.gyro[inside]
    imu, silicone = spec.imu, spec.silicone
    whole = spec.inertia.head.value + spec.inertia.lever.value
    omega0 = math.sqrt(silicone.stiffness(0.0) / whole)
    scale = np.array([0.1, 0.05, 0.02, 1e-3, 1e-3])
    begin = np.array([spec.inertia.lever.value / whole, 1.0, 0.05, 0.0, 0.0])

    def told(x: Numbers) -> Numbers:
        share, stretch, damping, bias, delay = x
        omega = omega0 * stretch
        seen = _through(_head_rate(grid, theta, rate, share, omega, damping), imu.low_pass.value)
        averaged = np.mean(
            [np.interp(times - delay - k * SAMPLE_PERIOD, grid, seen) for k in range(imu.average_samples)], axis=0
        )
        return np.asarray(averaged + bias)

    def fit(from_: Numbers) -> tuple[Numbers, Numbers, float]:
        done = least_squares(lambda y: told(y * scale) - gyro, from_ / scale, method="lm")
        spread = float(done.fun @ done.fun) / max(1, len(gyro) - len(scale))
        covariance = np.linalg.pinv(done.jac.T @ done.jac) * spread
        return done.x * scale, np.sqrt(np.diag(covariance)) * scale, math.sqrt(float(np.mean(done.fun**2)))

    turned = begin * np.array([-1.0, 1, 1, 1, 1])
    best, std, left = min((fit(begin), fit(turned)), key=lambda each: each[2])
    size = math.sqrt(float(np.mean((gyro - gyro.mean()) ** 2)))
    return Answer(
        share=float(best[0]),
        frequency_hz=omega0 * float(best[1]) / math.tau,
        damping=float(best[2]),
        delay=Found(float(best[4]), max(_LEAST_STD, float(std[4]))),
        misfit=left / size if size > 0 else math.inf,
    )


def _head_rate(grid: Numbers, theta: Numbers, rate: Numbers, share: float, omega: float, damping: float) -> Numbers:
    """Return φ' [rad/s] of a linear joint whose lever moves by θ [rad], at θ' [rad/s]."""
    push = share * (omega**2 * theta + 2 * damping * omega * rate)
    return np.asarray(_answered([1.0, 0.0], [1.0, 2 * damping * omega, omega**2], push) - share * rate)


def _through(signal: Numbers, corner_hz: float) -> Numbers:
    """Return a signal on the grid behind the second-order Butterworth low-pass."""
    w = math.tau * corner_hz
    return _answered([w * w], [1.0, math.sqrt(2) * w, w * w], signal)


def _answered(numerator: list[float], denominator: list[float], signal: Numbers) -> Numbers:
    """Return what a transfer function in s makes of a signal on the grid, from rest; exact for lines between points."""
    b, a, _ = cont2discrete((numerator, denominator), _GRID_S, method="foh")
    return np.asarray(lfilter(np.ravel(b), a, signal))
