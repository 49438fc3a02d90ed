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
from sinew.bench.pretension import rest_tilt
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
    except BaseException as why:
        report = stop(rig, clock, "release")
        if not report.is_safe:
            raise UnconfirmedError(f"{why}; {report.sentence()}") from why
        raise
    report = stop(rig, clock, "release")
    if not report.is_safe:
        raise UnconfirmedError(report.sentence())


def widen_window(rig: Rig) -> None:
    """Have the drive take positions of its whole turn again: a window about another middle would refuse this one's.

    Limits that no run has set are the laboratory's, and stay.
    """
    drive, names = rig.drive, ("min_position_limit", "max_position_limit")
    drive.require_torque_off("to be set up")
    if may_be_widened(drive, names[0], drive.get_counts(names[::-1])):
        drive.ensure_count("min_position_limit", 0)
        drive.ensure_count("max_position_limit", COUNTS_PER_TURN - 1)


# The lever is moved: to and fro in smooth steps, and slowly in triangles.


@dataclass(frozen=True, slots=True)
class LeverMove:
    """What was read while the lever moved, (n,) each.

    time, gyro_time: of the drive's and the sensor's readings [s]. angle: of the lever in the sense of the rig so far
    [rad]. current [A], duty [share of the supply]: of its motor, in that sense. gyro: about the head's x [rad/s].
    """

    time: Numbers
    angle: Numbers
    current: Numbers
    duty: Numbers
    gyro_time: Numbers
    gyro: Numbers

    @classmethod
    def of(cls, samples: Sequence[Sample]) -> "LeverMove":
        """Return what samples tell; the sensor's, each once."""
        drive = np.array(
            [(s.time_s, s.drive_rad, s.drive_current_a, s.drive_pwm) for s in samples if not math.isnan(s.drive_rad)]
        ).reshape(-1, 4)
        told = {s.imu_counter_s: (s.imu_time_s, s.gyro_rad_s[0]) for s in samples if not math.isnan(s.imu_time_s)}
        gyro = np.array(list(told.values())).reshape(-1, 2)
        return cls(*drive.T, *gyro.T)


STEP = math.radians(6.0)
STEP_S = 0.1
_STEP_REST_S = 0.6
_STEPS = (1.0, 0.0, -1.0, 0.0)
SLOW = math.radians(20.0)
_SPEEDS = (0.5, 1.2)  # rad/s


def swing_lever(loop: Loop, rounds: int = 1) -> LeverMove:
    """Return what the sensors say to smooth steps of the lever to either side, `rounds` times."""
    samples: list[Sample] = []
    at = 0.0
    for share in _STEPS * rounds:
        there, begin, start = share * STEP, loop.due, at

        def path(time: float, start: float = start, there: float = there, begin: float = begin) -> float:
            done = min(1.0, max(0.0, (time - begin) / STEP_S))
            return start + (there - start) * 0.5 * (1 - math.cos(math.pi * done))

        samples += loop.run(STEP_S + _STEP_REST_S, path)
        at = there
    return LeverMove.of(samples)


def stroke_lever(loop: Loop) -> list[LeverMove]:
    """Return what the lever's motor says while it goes slowly to and fro, at one speed and at another."""
    moves = []
    for speed in _SPEEDS:
        begin, period = loop.due, 4 * SLOW / speed

        def path(time: float, begin: float = begin, period: float = period) -> float:
            phase = (max(0.0, time - begin) / period) % 1.0
            return SLOW * (4 * phase if phase < 0.25 else 2 - 4 * phase if phase < 0.75 else 4 * phase - 4)

        moves.append(LeverMove.of(loop.run(2 * period, path)))
    return moves


def bring_lever_home(loop: Loop, rig: Rig) -> None:
    """Bring the lever slowly to its middle."""
    lever, begin = rig.drive.angle(), loop.due
    time = max(0.5, abs(lever) / 0.5)
    loop.restart()
    begin = loop.due
    loop.run(time, lambda now: lever * max(0.0, 1 - (now - begin) / time))


# A tendon is pulled: until its motor carries a little current, and the head leans.


@dataclass(frozen=True, slots=True)
class Pull:
    """What a tendon motor did.

    sense: of the counts that pulled, 0 where none did. travel: to contact, as length of cable [m]. lean: of the head
    about y and z [rad], towards it. current: at contact [A]. friction: half of what winding takes more than paying out
    does [A], and its standard deviation. turned: the farthest that the horn went [m].
    """

    sense: int
    travel: float = 0.0
    lean: tuple[float, float] = (0.0, 0.0)
    current: float = 0.0
    friction: float = math.nan
    friction_std: float = math.nan
    turned: float = 0.0


REACHES_M = (0.008, 0.018)
"""How much cable is wound either way in search of contact: first a little [m]."""

LEANS = math.radians(0.25)
"""By so much the head must lean for a current to be a pull [rad]."""

_PULL_SPEED, _BACK_SPEED = 0.012, 0.02  # m/s
_MOST_CURRENT = 0.25  # of the rig's limit
_AT_LIMIT = 0.06
_CONTACT_S = 0.2
_AHEAD_M = 2e-3
_LOOK_S = 0.4
_RUB_M, _RUB_SPEED, _RUBS = 0.3e-3, 2e-3, 3


def pull_current(rig: Rig) -> float:
    """Return the current up to which a tendon is pulled [A]: that of first contact, a quarter of the limit at most."""
    tendons = rig.spec.tendons
    wanted = tendons.current(tendons.first_contact_tension.value)
    counts = int(min(wanted, _MOST_CURRENT * rig.spec.limits.tendon_current_a) / tendons.current_lsb.value)
    return max(1, counts) * tendons.current_lsb.value


def pull_tendon(loop: Loop, rig: Rig, index: int) -> Pull:
    """Return what one tendon motor, the only one with torque, did when it was turned either way; it is back then."""
    before = _lean(loop)
    turned = 0.0
    for reach in REACHES_M:
        for sense in (1, -1):
            rig.tendons[index].limit_output(pull_current(rig))
            loop.restart()
            found, far = _seek(loop, rig, index, sense, reach)
            turned = max(turned, far)
            if found:
                pull = _judge(loop, rig, index, sense, before, far)
                _go_back(loop, rig, index)
                if pull.sense:
                    return pull
            else:
                _go_back(loop, rig, index)
    return Pull(0, turned=turned)


def _seek(loop: Loop, rig: Rig, index: int, sense: int, reach: float) -> tuple[bool, float]:
    """Wind cable until the motor carries its current, or so much is wound [m]; return whether it does, and how far."""
    radius, lsb, limit = loop.pulley_radius, rig.spec.tendons.current_lsb.value, pull_current(rig)
    start = loop.watch.origin[index]
    goal, held, far = start, 0.0, 0.0
    step = sense * _PULL_SPEED * loop.period / radius
    for _ in range(round((reach / _PULL_SPEED + 2 * _CONTACT_S) / loop.period)):
        sample = _told(loop, index, goal)
        angle, current = sample.tendon_rad[index], sample.tendon_current_a[index]
        if math.isnan(angle):
            continue
        far = max(far, abs(angle - start) * radius)
        held = held + loop.period if sense * current >= (1 - _AT_LIMIT) * limit - lsb else 0.0
        if held > _CONTACT_S:
            return True, far
        ahead = angle + sense * _AHEAD_M / radius
        goal = min(goal + step, ahead, start + sense * reach / radius, key=lambda value: sense * value)
    return False, far


def _judge(loop: Loop, rig: Rig, index: int, sense: int, before: tuple[float, float], far: float) -> Pull:
    """Return what a pull does to the head, and what its cable rubs."""
    after = _lean(loop)
    lean = (after[0] - before[0], after[1] - before[1])
    angles = np.array([s.tendon_rad[index] for s in loop.run(_LOOK_S)])
    at, radius = float(np.nanmean(angles)), loop.pulley_radius
    current = sense * float(np.nanmean([s.tendon_current_a[index] for s in loop.run(_LOOK_S / 2)]))
    if math.hypot(*lean) < LEANS:
        return Pull(0, turned=far)
    rig.tendons[index].limit_output(2 * pull_current(rig))
    loop.restart()
    quarter = _RUB_M / _RUB_SPEED
    goal = loop.watch.goals[index] if abs(loop.watch.goals[index] - at) < _RUB_M / radius else at
    rows, begin = [], loop.due
    for _ in range(round(4 * quarter * _RUBS / loop.period)):
        phase = ((loop.due - begin) / (4 * quarter)) % 1.0
        wave = 4 * phase if phase < 0.25 else 2 - 4 * phase if phase < 0.75 else 4 * phase - 4
        sample = _told(loop, index, goal + wave * _RUB_M / radius)
        rows.append((sense * sample.tendon_rad[index], sense * sample.tendon_current_a[index]))
    friction, std = _rubbing(np.array(rows))
    return Pull(sense, far, lean, current, friction, std, far)


def _rubbing(rows: Numbers) -> tuple[float, float]:
    """Return half of the jump of the current where the horn turns round [A], and its standard deviation.

    rows: angle [rad] and current [A] of a horn that goes to and fro, positive where it winds, (n, 2). The current is
    taken to be a line over the angle, and the jump.
    """
    angle, current = rows.T
    speed = np.gradient(angle)
    moves = np.isfinite(angle + current + speed) & (np.abs(speed) > 0.3 * np.nanquantile(np.abs(speed), 0.9))
    if moves.sum() < 20:
        return math.nan, math.nan
    columns = np.column_stack([np.ones(moves.sum()), angle[moves] - angle[moves].mean(), np.sign(speed[moves])])
    return _last_of_fit(columns, current[moves])


def _last_of_fit(columns: Numbers, values: Numbers) -> tuple[float, float]:
    """Return the last coefficient of a least-squares fit, and its standard deviation."""
    found, _, rank, _ = np.linalg.lstsq(columns, values, rcond=None)
    if rank < columns.shape[1]:
        return math.nan, math.nan
    left = values - columns @ found
    variance = float(left @ left) / max(1, len(values) - columns.shape[1])
    return float(found[-1]), math.sqrt(variance * np.linalg.inv(columns.T @ columns)[-1, -1])


def _go_back(loop: Loop, rig: Rig, index: int) -> None:
    """Take the horn back to where it stood before."""
    start, goal = loop.watch.origin[index], loop.watch.goals[index]
    angle = rig.tendons[index].angle()
    loop.restart()
    goal = angle if abs(angle - start) < abs(goal - start) else goal
    steps = max(1, round(abs(goal - start) * loop.pulley_radius / _BACK_SPEED / loop.period))
    for k in range(1, steps + 1):
        _told(loop, index, goal + (start - goal) * k / steps)
    loop.run(0.1)


def _told(loop: Loop, index: int, goal: float) -> Sample:
    goals = list(loop.watch.goals)
    goals[index] = goal
    loop.set_goals(goals)
    return loop.cycle()


def _lean(loop: Loop) -> tuple[float, float]:
    """Return the mean tilt of the resting head about y and z [rad]. Raises LostError without a reading."""
    seen = [
        tilt for s in loop.run(_LOOK_S)[round(0.25 * _LOOK_S / loop.period) :] if (tilt := rest_tilt(s)) is not None
    ]
    if not seen:
        raise LostError("no reading of the IMU came while the head rested; check its cable, then `sinew doctor`")
    return sum(y for y, _ in seen) / len(seen), sum(z for _, z in seen) / len(seen)


# ---- constants of a bench out of small moves: the drive's friction and speed, the sensor's delay


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
