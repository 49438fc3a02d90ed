"""Constants of a bench out of small moves: the drive's friction and speed, the sensor's delay."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from sinew.analysis.signal.signals import sensor_budget, torsion_chain
from sinew.bench.guide.moves import LeverMove, Numbers
from sinew.plan.rig import RigSpec


@dataclass(frozen=True, slots=True)
class Found:
    """A number and its standard deviation."""

    value: float
    std: float


# The lever's motor: what it draws, and what duty it needs, at two slow speeds.

_SMOOTH = 9  # samples, to both sides alike: no delay
_LEAST_SHARE = 0.02  # of a value, what goals in steps leave whatever the fit says: up to 3 % on the emulator
_SLOW_HZ = 0.1  # so slow that the sensor's chain is late by one time at all that the lever does
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
    friction = found * stall / (most - found)
    return Found(friction, max(_LEAST_SHARE * friction, std * stall * most / (most - found) ** 2))


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
    return Found(found, found * max(_LEAST_SHARE, std / slope))


def _delay_s(spec: RigSpec) -> float:
    """Return by how much the sensor's chain is late at low frequency [s]."""
    return -float(np.angle(torsion_chain(sensor_budget(spec), _SLOW_HZ))) / (math.tau * _SLOW_HZ)


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

_GRID_HZ = 1000.0
_PAD_S = 6.0  # behind the record, in which the joint's swing dies away
_LEAST_STD = 0.2e-3  # what encoder counts and unlike samples leave, whatever the fit says


@dataclass(frozen=True, slots=True)
class Answer:
    """How the head answers the lever.

    share: the lever's inertia in the whole, signed: negative where the lever turns the other way than it is told.
    frequency_hz, loss_factor: of the joint with slack tendons. delay: of the sensor's chain beyond its low-pass and its
    average [s]. misfit: root mean square of what the fit leaves, over that of the gyroscope.
    """

    share: float
    frequency_hz: float
    loss_factor: float
    delay: Found
    misfit: float


def answer_to(move: LeverMove, spec: RigSpec) -> Answer:
    """Return how the head answers the lever's steps: (k* - Iω²) φ = I_l ω² θ, seen through the sensor's chain.

    k* = I ω_0² (jω/ω_0)^α has a loss factor tan(πα/2) at every frequency, as silicone has about; with a dashpot, whose
    losses grow with the frequency, the delay came out 1.1 ms too long. Share, ω_0, α, bias and delay are fitted to the
    gyroscope.
    """
    start, stop = float(move.time[0]), float(move.time[-1])
    count = round((stop - start + _PAD_S) * _GRID_HZ)
    grid = start + np.arange(count) / _GRID_HZ
    angle = np.interp(grid, move.time, savgol_filter(move.angle, _SMOOTH, 3))
    lever, frequency = np.fft.rfft(angle - angle[0]), np.fft.rfftfreq(count, 1 / _GRID_HZ)
    omega = math.tau * frequency
    inside = (move.gyro_time > start + 0.05) & (move.gyro_time < stop)
    times, gyro = move.gyro_time[inside], move.gyro[inside]
    budget = replace(sensor_budget(spec), residual_delay_s=0.0)
    chain = 1j * omega * torsion_chain(budget, frequency)
    whole = spec.inertia.head.value + spec.inertia.lever.value
    usual = math.sqrt(spec.silicone.stiffness(0.0) / whole)
    scale = np.array([0.1, 0.05, 0.02, 1e-3, 1e-3])
    begin = np.array([spec.inertia.lever.value / whole, 1.0, 0.05, 0.0, 0.0])

    def told(x: Numbers) -> Numbers:
        share, stretch, power, bias, delay = x
        own = usual * stretch
        stiff = own**2 * (1j * np.maximum(omega, 1e-9) / own) ** power
        seen = chain * np.exp(-1j * omega * delay) * share * omega**2 / (stiff - omega**2) * lever
        return np.asarray(np.interp(times, grid, np.fft.irfft(seen, count)) + bias)

    def missed(y: Numbers) -> Numbers:
        return told(y * scale) - gyro

    def fit(from_: Numbers) -> tuple[Numbers, Numbers, float]:
        done = least_squares(missed, from_ / scale, method="lm")
        slopes = np.asarray(done.jac, dtype=float)
        spread = float(done.fun @ done.fun) / max(1, len(gyro) - len(scale))
        covariance = np.linalg.pinv(slopes.T @ slopes) * spread
        return done.x * scale, np.sqrt(np.diag(covariance)) * scale, math.sqrt(float(np.mean(done.fun**2)))

    turned = begin * np.array([-1.0, 1, 1, 1, 1])
    best, std, left = min((fit(begin), fit(turned)), key=lambda each: each[2])
    size = math.sqrt(float(np.mean((gyro - gyro.mean()) ** 2)))
    return Answer(
        share=float(best[0]),
        frequency_hz=usual * float(best[1]) / math.tau,
        loss_factor=math.tan(0.5 * math.pi * float(best[2])),
        delay=Found(float(best[4]), max(_LEAST_STD, float(std[4]))),
        misfit=left / size if size > 0 else math.inf,
    )
