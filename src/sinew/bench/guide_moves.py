"""Small moves within limits that tell how a bench is wired: one motor at a time, under the guard of every run.

Only motors that are about to move have torque, with little current, their bus watchdogs set; every cycle is held
against the rig's limits. Whatever ends a move, all motors are without torque behind it, as they were found.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from sinew.analysis.signal.signals import sensor_budget, torsion_chain
from sinew.bench.guard import Guard, Watch
from sinew.bench.loop import WATCHDOG_S, Loop
from sinew.bench.pretension import CONTACT_HOLD_S, rest_tilt, wind_to_contact
from sinew.bench.record.sample import Sample
from sinew.bench.stops import stop
from sinew.bench.tilt import TiltEstimator
from sinew.hardware.bus import Clock
from sinew.hardware.configuration import may_be_widened, prepare_goal
from sinew.hardware.motor import Motor
from sinew.hardware.rig import Rig
from sinew.measure.errors import LostError
from sinew.plan.rig import RigSpec
from sinew.plan.servo import COUNTS_PER_TURN

RATE_HZ = 200.0
"""Cycles in a second."""

DRIVE_SHARE = 0.6
"""Of the supply, that the lever's motor may use."""

Numbers = NDArray[np.float64]


class UnconfirmedError(LostError):
    """A motor did not confirm, behind a move, that it has no torque."""


@contextmanager
def moving(rig: Rig, clock: Clock, motors: Sequence[Motor], check: Callable[[], None]) -> Iterator[Loop]:
    """Give a loop in which some motors have torque, and take it from them in the end, whatever happened.

    check: raises, before a cycle, where the guide is to end. Raises UnconfirmedError where a motor does not confirm
    that it has no torque.
    """
    widen_window(rig)
    rig.configure()
    rig.set_tendon_mode("position-with-current-limit")
    tilt = TiltEstimator(rig.spec, RATE_HZ)
    loop = Loop(rig, clock, Guard(rig.spec), tilt, 1 / RATE_HZ, lambda _: None, check)
    angles = rig.stand()
    loop.watch = Watch(origin=angles, goals=angles)
    why: BaseException | None = None
    try:
        for motor in motors:
            check()
            prepare_goal(motor)
            if motor is rig.drive:
                rig.drive.limit_output(DRIVE_SHARE)
            motor.arm_watchdog(WATCHDOG_S)
            motor.torque_on()
        loop.restart()
        yield loop
    except BaseException as trouble:
        why = trouble
        raise
    finally:
        report = stop(rig, clock, "release")
        if not report.is_safe:
            raise UnconfirmedError(f"{why}; {report.sentence()}" if why else report.sentence()) from why


def widen_window(rig: Rig) -> None:
    """Have the drive take positions of its whole turn again: a window about another middle would refuse this one's.

    Limits that no run has set are the laboratory's, and stay.
    """
    drive, names = rig.drive, ("min_position_limit", "max_position_limit")
    drive.require_torque_off("to be set up")
    if may_be_widened(drive, names[0], drive.get_counts(names[::-1])):
        drive.ensure_count("min_position_limit", 0)
        drive.ensure_count("max_position_limit", COUNTS_PER_TURN - 1)


# The lever is moved: to and fro in smooth steps.


@dataclass(frozen=True, slots=True)
class LeverMove:
    """What was read while the lever moved, (n,) each.

    time, gyro_time: of the drive's and the sensor's readings [s]. angle: of the lever in the sense of the rig so far
    [rad]. gyro: about the head's x [rad/s].
    """

    time: Numbers
    angle: Numbers
    gyro_time: Numbers
    gyro: Numbers

    @classmethod
    def of(cls, samples: Sequence[Sample]) -> "LeverMove":
        """Return what samples tell; the sensor's, each once."""
        drive = np.array([(s.time_s, s.drive_rad) for s in samples if not math.isnan(s.drive_rad)]).reshape(-1, 2)
        response = {s.imu_counter_s: (s.imu_time_s, s.gyro_rad_s[0]) for s in samples if not math.isnan(s.imu_time_s)}
        gyro = np.array(list(response.values())).reshape(-1, 2)
        return cls(*drive.T, *gyro.T)


STEP = math.radians(6.0)
STEP_S = 0.1
_STEP_REST_S = 0.6
_STEPS = (1.0, 0.0, -1.0, 0.0)


def swing_lever(loop: Loop, rounds: int = 1) -> LeverMove:
    """Return what the sensors say to smooth steps of the lever to either side, `rounds` times."""
    samples: list[Sample] = []
    at = 0.0
    for share in _STEPS * rounds:
        samples += loop.run(STEP_S + _STEP_REST_S, _smooth_step(loop.due, STEP_S, at, share * STEP))
        at = share * STEP
    return LeverMove.of(samples)


def _smooth_step(begin: float, duration: float, start: float, stop: float) -> Callable[[float], float]:
    """Return the way of the lever [rad] by time [s]."""

    def path(time: float) -> float:
        done = min(1.0, max(0.0, (time - begin) / duration))
        return start + (stop - start) * 0.5 * (1 - math.cos(math.pi * done))

    return path


def bring_lever_home(loop: Loop, rig: Rig) -> None:
    """Bring the lever slowly to its middle, at 0.5 rad/s at most."""
    lever = rig.drive.angle()
    time = max(0.5, 0.5 * math.pi * abs(lever) / 0.5)
    loop.restart()
    loop.run(time, _smooth_step(loop.due, time, lever, 0.0))


# A tendon is pulled: until its motor carries a little current, and the head leans.


@dataclass(frozen=True, slots=True)
class Pull:
    """What a tendon motor did.

    sense: of the counts that pulled, 0 where none did. turned: the farthest that the horn went, to contact where there
    was one, as length of cable [m]. lean: of the head about y and z [rad], towards it.
    """

    sense: int
    turned: float = 0.0
    lean: tuple[float, float] = (0.0, 0.0)


REACHES_M = (0.008, 0.018)
"""How much cable is wound either way in search of contact: first a little [m]."""

LEANS = math.radians(0.25)
"""By so much the head must lean for a current to be a pull [rad]."""

_BACK_SPEED = 0.02  # m/s
_MOST_CURRENT = 0.25  # of the rig's limit
_LOOK_S = 0.4


def pull_current(rig: Rig) -> float:
    """Return the current up to which a tendon is pulled [A]: that of first contact, a quarter of the limit at most."""
    tendons = rig.spec.tendons
    wanted = tendons.current(tendons.first_contact_tension.value)
    counts = int(min(wanted, _MOST_CURRENT * rig.spec.limits.tendon_current_a) / tendons.current_lsb.value)
    return max(1, counts) * tendons.current_lsb.value


def pull_tendon(loop: Loop, rig: Rig, index: int) -> Pull:
    """Return what one tendon motor, the only one with torque, did when it was turned either way; it is back then."""
    before = _lean(loop)
    turned, start, motor = 0.0, loop.watch.origin[index], rig.tendons[index]
    for reach in REACHES_M:
        for sense in (1, -1):
            senses = tuple(sense * (i == index) for i in range(len(rig.tendons)))
            motor.limit_output(pull_current(rig))
            loop.restart()
            _, held = wind_to_contact(loop, rig, pull_current(rig), senses, reach, reach)
            after = _lean(loop) if held[index] > CONTACT_HOLD_S else before
            angle = motor.angle()
            loop.restart()
            far = abs(angle - start) * loop.pulley_radius
            turned = max(turned, far)
            goal = min(angle, loop.watch.goals[index], key=lambda each: abs(each - start))
            steps = max(1, round(abs(goal - start) * loop.pulley_radius / _BACK_SPEED / loop.period))
            for k in range(1, steps + 1):
                there = goal + (start - goal) * k / steps
                loop.set_goals([there if i == index else at for i, at in enumerate(loop.watch.goals)])
                loop.cycle()
            loop.run(0.1)
            lean = (after[0] - before[0], after[1] - before[1])
            if math.hypot(*lean) >= LEANS:
                return Pull(sense, far, lean)
    return Pull(0, turned)


def _lean(loop: Loop) -> tuple[float, float]:
    """Return the mean tilt of the resting head about y and z [rad]. Raises LostError without a reading."""
    seen = [
        tilt for s in loop.run(_LOOK_S)[round(0.25 * _LOOK_S / loop.period) :] if (tilt := rest_tilt(s)) is not None
    ]
    if not seen:
        raise LostError("no reading of the IMU came while the head rested; check its cable, then `sinew doctor`")
    return sum(y for y, _ in seen) / len(seen), sum(z for _, z in seen) / len(seen)


# The sensor's delay: the head answers a step of the lever at once, what the sensor tells of it comes later.

_SMOOTH = 9  # samples, to both sides alike: no delay
_GRID_HZ = 1000.0
_PAD_S = 6.0  # behind the record, in which the joint's swing dies away
_LEAST_STD = 0.2e-3  # what encoder counts and unlike samples leave, whatever the fit says


@dataclass(frozen=True, slots=True)
class Answer:
    """How the head answers the lever.

    share: the lever's inertia in the whole, signed: negative where the lever turns the other way than it is told.
    delay, delay_std: of the sensor's chain beyond its low-pass and its average, and its standard deviation [s]. misfit:
    root mean square of what the fit leaves, over that of the gyroscope.
    """

    share: float
    delay: float
    delay_std: float
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

    def missed(scaled: Numbers) -> Numbers:
        share, stretch, power, bias, delay = scaled * scale
        own = usual * stretch
        stiff = own**2 * (1j * np.maximum(omega, 1e-9) / own) ** power
        seen = chain * np.exp(-1j * omega * delay) * share * omega**2 / (stiff - omega**2) * lever
        return np.asarray(np.interp(times, grid, np.fft.irfft(seen, count)) + bias - gyro)

    def fit(sign: int) -> tuple[float, Numbers, Numbers]:
        begin = np.array([sign * spec.inertia.lever.value / whole, 1.0, 0.05, 0.0, 0.0])
        done = least_squares(missed, begin / scale, method="lm")
        slopes = np.asarray(done.jac, dtype=float)
        covariance = np.linalg.pinv(slopes.T @ slopes) * 2 * done.cost / (len(gyro) - len(scale))
        return math.sqrt(2 * done.cost / len(gyro)), done.x * scale, np.sqrt(np.diag(covariance)) * scale

    left, best, std = min((fit(1), fit(-1)), key=lambda each: each[0])
    size = math.sqrt(float(np.mean((gyro - gyro.mean()) ** 2)))
    return Answer(
        share=float(best[0]),
        delay=float(best[4]),
        delay_std=max(_LEAST_STD, float(std[4])),
        misfit=left / size if size > 0 else math.inf,
    )
