"""Preview of a plan before anything moves: how long, how far the drive reaches, what breaks."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from scipy import optimize

from sinew.measure.arrays import Array, Complexes
from sinew.measure.attitude import sway_of_torsion
from sinew.measure.errors import SpecError
from sinew.measure.estimate import number
from sinew.measure.recording import FEWEST_FREQUENCIES, too_few_frequencies
from sinew.measure.units import STANDARD_GRAVITY
from sinew.plan.plan import Plan, listed
from sinew.plan.rig import RigSpec
from sinew.plan.servo import SERVOS

# The drive's reach: which lever amplitude it gives for a commanded sine.
#
# The servo of the rig against a held head, or one that swings by φ: inertia J = I_l + J_a, and the torque line of the
# data sheet with a duty u,
#
#     J θ̈ + I_l φ̈ = τ u - c θ̇ - T_f sign(θ̇),   τ = (T_stall + T_f) V/V_nominal,   c = T_stall/ω_no-load,
#     u = clip(K (A sin Ωt - θ), ±u_max).
#
# Harmonic balance on the fundamental replaces the clip by its describing function and the friction by 4 T_f/π in phase
# with the speed (Gelb and Vander Velde, Multiple-Input Describing Functions, 1968, ch. 2). With x = K E/u_max for an
# error of amplitude E, the motor gives the torque amplitude τ u_max y(x), y = x up to saturation and
# (2/π) (x asin(1/x) + sqrt(1 - 1/x²)) beyond, which tends to 4/π. That torque fixes Θ, and the phasors of θ and of the
# error add up to the command.
#
# Where a joint resonates, its head swings against the lever and takes torque that the held head does not: there the
# twin shows up to half less amplitude (paper's rig), and slightly more above the resonance. Where the head's swing is
# known, φ = H θ adds I_l H to the inertia, and the lever is known to a few percent.

_SCAN = np.geomspace(1e-4, 1e6, 400)
_WITHIN, _NARROWED = np.linspace(0.0, 1.0, 33), 5  # a bracket of 6 % becomes one of 2e-9, where a straight line will do


@dataclass(frozen=True)
class Reach:
    """What the drive does for one commanded sine.

    amplitude_rad: of the lever against the head; zero where gear friction holds it.
    lag_rad: of the lever behind its command.
    current_a: amplitude of the motor current's fundamental.
    saturated_share: of the time that the duty is at its limit, 1 - (2/π) asin(1/x) for x > 1, else 0.
    """

    amplitude_rad: float
    lag_rad: float
    current_a: float
    saturated_share: float

    @property
    def saturated(self) -> bool:
        """Whether the duty touches its limit."""
        return self.saturated_share > 0


class _Servos(NamedTuple):
    """Servos and loads at one frequency each, (k, 1): horn torque minus friction is load · θ, phasors, θ real."""

    load: Complexes
    friction: Array
    torque_limit: Array
    error_limit: Array

    @staticmethod
    def of(rigs: Sequence[RigSpec], omega: Array, head: Complexes) -> "_Servos":
        drives, levers = [rig.drive for rig in rigs], [rig.inertia.lever.value for rig in rigs]
        rows = [
            (
                drive.armature.value,
                drive.speed_slope,
                4 / math.pi * drive.friction.value,
                drive.duty_torque * drive.duty_limit.value,
                drive.duty_limit.value / drive.position_gain.value,
            )
            for drive in drives
        ]
        armature, slope, friction, torque_limit, error_limit = np.array(rows).T[:, :, None]
        inertia = np.array(levers)[:, None] * (1 + head) + armature
        return _Servos(-inertia * omega**2 + 1j * slope * omega, friction, torque_limit, error_limit)

    def lever(self, x: Array) -> tuple[Array, Array, Array]:
        """Return lever amplitude Θ [rad], and the command's part in phase with it and the one before it [rad], for
        errors x, (k, n) or (1, n): each (k, n).

        |load Θ + i T_f 4/π| is the torque amplitude, a quadratic in Θ.
        """
        torque = np.maximum(self.torque_limit * _saturated(x), self.friction)
        square, half = np.abs(self.load) ** 2, self.load.imag * self.friction
        theta = (np.sqrt(half**2 + square * (torque**2 - self.friction**2)) - half) / square
        theta = np.where(torque > self.friction, theta, 0.0)
        error = x * self.error_limit / torque
        return theta, theta * (1 + self.load.real * error), (self.load.imag * theta + self.friction) * error


def drive_reach(rig: RigSpec, command_rad: float, frequency_hz: float, head: complex = 0.0) -> Reach:
    """Return lever amplitude, lag and current for a commanded amplitude [rad] at a frequency [Hz].

    head: torsion over lever angle, complex, of a head that swings, a lag having a negative angle; 0 for a held one.
    Where the balance has several solutions the one with the smallest error counts: a drive that starts from rest.
    """
    return drive_reaches([rig], np.array([command_rad]), np.array([frequency_hz]), np.array([head], dtype=complex))[0]


def drive_reaches(rigs: Sequence[RigSpec], command_rad: Array, frequency_hz: Array, head: Complexes) -> list[Reach]:
    """Return `drive_reach` of each rig, command, frequency and head, all (k,); k may be 0."""
    if not rigs:
        return []
    command, omega = command_rad[:, None], 2 * math.pi * frequency_hz[:, None]
    servos = _Servos.of(rigs, omega, head[:, None])
    grid, rows = _SCAN[None], np.arange(len(command))
    for fraction in (*(_WITHIN,) * _NARROWED, np.array([0.0, 1.0])):
        _, along, before = servos.lever(grid)
        below = along**2 + before**2 < command**2
        crossed = below[:, :-1] & ~below[:, 1:]
        at = np.argmax(crossed, axis=1)
        grid = np.broadcast_to(grid, below.shape)
        low = grid[rows, at]
        high = np.where(crossed[rows, at], grid[rows, at + 1], low)
        grid = low[:, None] * (high / low)[:, None] ** fraction
    short = np.hypot(*servos.lever(grid)[1:]) - command
    step = np.diff(short, axis=1)
    x = grid[:, :1] - np.diff(grid, axis=1) * short[:, :1] / np.where(step > 0, step, np.inf)
    theta, along, before = servos.lever(x)
    slope = np.array([[rig.drive.speed_slope] for rig in rigs])
    electrical = np.abs((servos.load - 1j * slope * omega) * theta + 1j * np.where(theta > 0, servos.friction, 0.0))
    share = np.where(x > 1, 1 - 2 / math.pi * np.arcsin(1 / np.maximum(x, 1)), 0.0)
    columns = (column[:, 0].tolist() for column in (theta, np.arctan2(before, along), electrical, share))
    return [
        Reach(lever, lag, torque / rig.drive.torque_constant, part)
        for rig, lever, lag, torque, part in zip(rigs, *columns, strict=True)
    ]


def _saturated(x: Array) -> Array:
    """Return the fundamental of clip(x sin ψ, ±1)."""
    over = np.maximum(x, 1.0)
    return np.where(x <= 1, x, 2 / math.pi * (over * np.arcsin(1 / over) + np.sqrt(1 - 1 / over**2)))


REACHED_SHARE = 0.95
"""Share of the nominal drive amplitude from which it counts as reached."""

_SAMPLES_PER_PERIOD = 20
_TRANSIENT_LEFT = 0.2
_DECAY_PERIODS = 5


_SEVERITIES = ("refuse", "warn", "note")


class Finding(NamedTuple):
    """What a check found: refuse stops a run, warn may spoil its results, note is good to know.

    key: of the plan, at which it is to be mended.
    """

    severity: Literal["refuse", "warn", "note"]
    sentence: str
    key: str = ""


_refuse, _warn, _note = partial(Finding, "refuse"), partial(Finding, "warn"), partial(Finding, "note")


@dataclass(frozen=True)
class Preview:
    """What a plan will do on a rig.

    duration_s: of all motions and rests, without the time to change pretension.
    bench_s: what a bench takes for all of it, within 15 %: with power-up and pull to first contact, the changes of
    pretension and their levelling, the rests before ring-downs, and the stop.
    groups, samples: numbers of motions (idle records included) and of recorded samples.
    full_amplitude_hz: up to where the nominal amplitude is reached (from the lowest frequency on); None if nowhere.
    frequency_hz: of the sweep. drive_amplitude_deg, drive_current_a: what the drive reaches there against a held
    head, and the amplitude of its current's fundamental; see `drive_reach`.
    tension_n, torsion_deg: of one tendon at rest, and the largest torsion, at each pretension, as the caller gave them;
    empty if it did not.
    findings: refusals first, notes last.
    """

    duration_s: float
    bench_s: float
    groups: int
    samples: int
    full_amplitude_hz: float | None
    frequency_hz: tuple[float, ...]
    drive_amplitude_deg: tuple[float, ...]
    drive_current_a: tuple[float, ...]
    tension_n: tuple[float, ...]
    torsion_deg: tuple[float, ...]
    findings: tuple[Finding, ...]

    @property
    def refusals(self) -> tuple[str, ...]:
        """The sentences for which the plan must not run."""
        return tuple(finding.sentence for finding in self.findings if finding.severity == "refuse")


def check_plan(
    plan: Plan,
    rig: RigSpec,
    tension_n: Sequence[float] | None = None,
    torsion_deg: Sequence[float] | None = None,
) -> Preview:
    """Return duration, drive reach and every limit of the rig that the plan would break.

    tension_n: tension of one tendon [N] at each pretension of the plan, where the caller has a model of it; without
    it the limits on tension and tendon current are not checked. torsion_deg: the largest torsion [deg] at each of them,
    likewise. Raises ValueError where a length does not match.
    """
    tensions, torsions = _each_pretension(plan, tension_n), _each_pretension(plan, torsion_deg)
    by_lever = plan.sweep if plan.sweep is not None and plan.sweep.drive == "lever" else None
    frequencies = by_lever.frequency_hz if by_lever else ()
    amplitude = by_lever.amplitude_deg if by_lever else 0.0
    commanded = np.full(len(frequencies), math.radians(amplitude))
    reach = drive_reaches(
        [rig] * commanded.size, commanded, np.asarray(frequencies, dtype=float), np.zeros(commanded.size, complex)
    )
    reached_deg = [math.degrees(r.amplitude_rad) for r in reach]
    groups = plan.groups()
    findings = [
        *setting_findings(plan, rig),
        *_load_findings(plan, rig, reach, tensions, torsions),
        *_pose_findings(plan, rig, torsions),
        *_sway_findings(plan, rig),
        *_reach_findings(plan, rig, reached_deg),
        *_time_findings(plan, rig, tensions),
        *_servo_findings(rig),
        *_upright_findings(plan, rig),
    ]
    duration = sum(group.duration_s for group in groups)
    return Preview(
        duration_s=duration,
        bench_s=sum(stage.duration_s for stage in stages_of(plan)),
        groups=len(groups),
        samples=sum(sum(group.sample_counts(plan.sample_hz)) for group in groups),
        frequency_hz=tuple(frequencies),
        drive_amplitude_deg=tuple(reached_deg),
        drive_current_a=tuple(r.current_a for r in reach),
        full_amplitude_hz=_full_amplitude_hz(frequencies, reached_deg, amplitude),
        tension_n=tensions,
        torsion_deg=torsions,
        findings=tuple(sorted(findings, key=lambda finding: _SEVERITIES.index(finding.severity))),
    )


# What a bench needs beside the plan's motions [s], as its routines take it with a paper rig (`sinew.bench`): head at
# rest, lever to zero, slack, first contact until the silicone has given way, bias; one levelling, longer where the
# joint still swings; the joint coming to rest before a decay; and rest, let-down and torque off at the end.
_POWER_UP_S, _LEVEL_S, _LEVEL_SWINGING_S, _CALM_S, _STOP_S = 7.6, 3.2, 4.0, 6.0, 4.3
_CHANGE_MM_S = 6.0


StageKind = Literal["pull", "change", "rest", "settle", "steady", "calm", "ring-down", "tracking", "stop"]


class Stage(NamedTuple):
    """A stretch of a plan as a bench runs it, as long as `Preview.bench_s` takes it to be.

    kind: pull to first contact; change of pretension, with levelling; rest for the sensors; settle before a record;
    steady, ring-down and tracking are records; calm until the joint is at rest before a decay; stop.
    start_s, duration_s: [s]. pretension_mm: None before the first is set. frequency_hz, amplitude_deg: None where the
    drive has none; of tendons that drive, the amplitude is in mm and not told here. groups: of the plan that are in it.
    """

    kind: StageKind
    start_s: float
    duration_s: float
    pretension_mm: float | None
    frequency_hz: float | None = None
    amplitude_deg: float | None = None
    groups: int = 1


def stages_of(plan: Plan, most: int = 400) -> list[Stage]:
    """Return the stages of a plan in their order.

    most: of more than so many stages those of a kind at one pretension are taken together, one stage each, the settling
    with its record; the frequency is the last one's then.
    """
    found, last = [Stage("pull", 0.0, _POWER_UP_S, None)], 0.0
    moves_to = plan.track.pretension_to_mm if plan.track is not None else None
    at: float | None = None

    def add(kind: StageKind, duration_s: float, *drive: float) -> None:
        if duration_s > 0:
            hertz, deg = (None if math.isnan(one) else one for one in drive or (math.nan, math.nan))
            found.append(Stage(kind, found[-1].start_s + found[-1].duration_s, duration_s, at, hertz, deg))

    for group in plan.groups():
        if group.pretension_mm != at:
            for mm in (group.pretension_mm,) if moves_to is None else (moves_to, group.pretension_mm):
                at = mm
                add("change", abs(mm - last) / _CHANGE_MM_S + (_LEVEL_S if len(found) == 1 else _LEVEL_SWINGING_S))
                last = mm
        if group.kind == "ring-down":
            add("calm", _CALM_S)
        drive = group.frequency_hz, group.amplitude_deg
        add("settle", group.settle_s, *drive)
        add("rest" if group.kind == "idle" else group.kind, group.record_s, *drive)
    add("stop", _STOP_S)
    return found if len(found) <= most else _together(found)


def _together(stages: list[Stage]) -> list[Stage]:
    """Return neighbouring stages of one pretension and one kind as one; settling and calm belong to what follows."""
    made: list[Stage] = []
    before = 0.0
    for stage in stages:
        if stage.kind in ("settle", "calm"):
            before += stage.duration_s
            continue
        whole = stage._replace(start_s=stage.start_s - before, duration_s=stage.duration_s + before)
        before = 0.0
        if made and (made[-1].kind, made[-1].pretension_mm) == (stage.kind, stage.pretension_mm):
            last = made[-1]
            whole = whole._replace(
                start_s=last.start_s, duration_s=last.duration_s + whole.duration_s, groups=last.groups + 1
            )
            made.pop()
        made.append(whole)
    return made


def refuse_beyond_limits(preview: Preview) -> None:
    """Raise SpecError with the first refusal of a preview, and how many more there are; else do nothing."""
    if preview.refusals:
        more = len(preview.refusals) - 1
        tail = f" (and {more} more refusal{'s' if more > 1 else ''}; see sinew check)" if more else ""
        raise SpecError(preview.refusals[0] + tail)


def setting_findings(plan: Plan, rig: RigSpec) -> Iterator[Finding]:
    """Yield what the plan sets beyond the limits: pretension, amplitude, frequency, sample rate, supply."""
    limits = rig.limits
    low, high = limits.pretension_mm
    moved_to = plan.track.pretension_to_mm if plan.track is not None else None
    settings = {"pretension.pretension_mm": plan.pretension.pretension_mm}
    settings |= {} if moved_to is None else {"track.pretension_to_mm": (moved_to,)}
    for key, pretensions in settings.items():
        if beyond := [p for p in pretensions if not low <= p <= high]:
            sentence = f"plan asks for {_a_or_some('pretension', beyond)} mm, the rig allows {low:g} to {high:g} mm"
            yield _refuse(f"{sentence}; change {key}", key)
    for part, amplitude, key, frequencies in _drives(plan):
        if amplitude is not None and amplitude > limits.drive_amplitude_deg:
            yield _refuse(
                f"{part} asks for {amplitude:g}°, the rig allows {limits.drive_amplitude_deg:g}°; "
                f"lower {part}.amplitude_deg",
                f"{part}.amplitude_deg",
            )
        if beyond := [hertz for hertz in frequencies if hertz > limits.drive_hz]:
            sentence = f"{part} asks for {listed(beyond)} Hz, the rig allows {limits.drive_hz:g} Hz; lower {key}"
            yield _refuse(sentence, key)
        sampled_hz = plan.sample_hz / _SAMPLES_PER_PERIOD * (1 + 1e-12)
        if fast := [hertz for hertz in frequencies if sampled_hz < hertz <= limits.drive_hz]:
            yield _refuse(
                f"{part} asks for {listed(fast)} Hz, a tenth of the Nyquist frequency is "
                f"{plan.sample_hz / _SAMPLES_PER_PERIOD:g} Hz; raise sample_hz to "
                f"{max(fast) * _SAMPLES_PER_PERIOD:g}",
                key,
            )
    low, high = limits.voltage_v
    supply = rig.drive.supply_voltage.value
    if not low <= supply <= high:
        yield _refuse(f"drive.supply_voltage is {supply:g} V, the rig allows {low:g} to {high:g} V")


def _a_or_some(noun: str, values: Sequence[float]) -> str:
    return f"{f'a {noun}' if len(values) == 1 else f'{noun}s'} of {listed(values)}"


def _drives(plan: Plan) -> Iterator[tuple[str, float | None, str, tuple[float, ...]]]:
    """Yield (section, amplitude of the lever [deg], key of frequencies, these [Hz]) of each driven part of a plan.

    The amplitude is None where the tendons drive.
    """
    for name, part in (("sweep", plan.sweep), ("ring_down", plan.ring_down)):
        if part is not None:
            amplitude = part.amplitude_deg if part.drive == "lever" else None
            yield name, amplitude, f"{name}.frequency_hz", part.frequency_hz
    if (track := plan.track) is not None:
        amplitude = max(track.amplitude_deg) if track.held != "torsion" else 0.0
        yield "track", amplitude, "track.high_hz", (track.high_hz,)


def _load_findings(
    plan: Plan, rig: RigSpec, reach: Sequence[Reach], tension_n: Sequence[float], torsion_deg: Sequence[float]
) -> Iterator[Finding]:
    """Yield which limits on currents, tension and torsion the plan breaks, each where it does so most."""
    limits, levels, hertz = rig.limits, plan.pretension.pretension_mm, plan.sweep.frequency_hz if plan.sweep else ()
    lower = "lower pretension.pretension_mm"
    currents = list(map(rig.tendons.current, tension_n))
    rows: list[tuple[Sequence[float], float, Sequence[float], str]] = [
        (
            [one.current_a for one in reach],
            limits.drive_current_a,
            hertz,
            "sweep drives a current of {:.2f} A at {:g} Hz, the rig allows {:g} A; lower sweep.amplitude_deg",
        ),
        (
            tension_n,
            limits.tension_n,
            levels,
            f"each tendon pulls {{:.0f}} N at {{:g}} mm, the rig allows {{:g}} N; {lower}",
        ),
        (
            currents,
            limits.tendon_current_a,
            levels,
            f"each tendon motor draws {{:.2f}} A at {{:g}} mm, the rig allows {{:g}} A; {lower}",
        ),
        (
            torsion_deg,
            limits.torsion_deg,
            levels,
            "the head twists by {:.0f}° at {:g} mm, the rig allows {:g}°; "
            "lower amplitude_deg or leave out the frequencies around the resonance",
        ),
    ]
    for values, most, where, sentence in rows:
        if values and (worst := max(values)) > most:
            yield _refuse(sentence.format(worst, where[values.index(worst)], most))
    if slack := [p for p, t in zip(levels, tension_n, strict=False) if t <= 0]:
        yield _warn(f"tendons are slack at {slack[0]:g} mm; raise tendons.first_contact_tension")


# The pose is judged twice. What is asked for must not bend the head further than limits.bend_deg, and the tendons must
# have the cable for it. limits.tilt_deg is the limit of what nobody asked for: how far the head may lean away from its
# pose, which is where a bench stops. A torsion τ of a head that is bent by β brings some of that with it, by
# asin(sin β sin(τ/2)) out of the plane of the bend, and so does a drive of the tendons.


def _pose_findings(plan: Plan, rig: RigSpec, torsion_deg: Sequence[float]) -> Iterator[Finding]:
    """Yield which limits the pose breaks, and what leans out of it as the head twists."""
    pose, limits = plan.rest_pose, rig.limits
    if pose.is_straight:
        return
    bend = math.degrees(pose.bend_rad)
    if bend > limits.most_bend_deg:
        yield _refuse(f"plan asks for {pose.words()}, the rig allows {limits.most_bend_deg:g}°; change [pose]")
    low, high = limits.tendon_travel_mm
    turned = 2 * np.pi * np.arange(rig.tendons.count) / rig.tendons.count - pose.azimuth_rad
    cable_mm = 1e3 * rig.tendons.head_radius.value * pose.bend_rad * float(np.max(np.abs(np.cos(turned))))
    for pretension in (min(plan.pretension.pretension_mm), max(plan.pretension.pretension_mm)):
        if not low <= pretension - cable_mm or not pretension + cable_mm <= high:
            yield _refuse(
                f"{pose.words()} at {pretension:g} mm takes a tendon from {pretension - cable_mm:.1f} to "
                f"{pretension + cable_mm:.1f} mm, the rig allows {low:g} to {high:g} mm; bend less in [pose]"
            )
            break
    if torsion_deg:
        away = math.degrees(sway_of_torsion(math.radians(max(torsion_deg)), pose.bend_rad))
        if away > limits.tilt_deg:
            yield _refuse(
                f"with {max(torsion_deg):.0f}° of torsion the bent head leans {away:.1f}° out of its pose, the rig "
                f"allows {limits.tilt_deg:g}°; bend less in [pose], or lower amplitude_deg"
            )


def _sway_findings(plan: Plan, rig: RigSpec) -> Iterator[Finding]:
    """Yield what a drive of the tendons asks for beyond the limits, or beyond the speed of their motors."""
    servo, tendons, limits = SERVOS[rig.wiring.tendon_model], rig.tendons, rig.limits
    speed = servo.no_load_speed * rig.drive.supply_voltage.value / servo.nominal_voltage * tendons.pulley_radius.value
    for name, part in (("sweep", plan.sweep), ("ring_down", plan.ring_down)):
        if part is None or part.amplitude_mm is None:
            continue
        tilt = math.degrees(part.amplitude_mm * 1e-3 / tendons.head_radius.value)
        if tilt > limits.tilt_deg:
            yield _refuse(
                f"{name} asks for {part.amplitude_mm:g} mm of cable, which tilts the head by {tilt:.1f}° where it does "
                f"not resonate, the rig allows {limits.tilt_deg:g}°; lower {name}.amplitude_mm"
            )
        frequency = max(part.frequency_hz)
        most = 1e3 * speed / (2 * math.pi * frequency)
        if part.amplitude_mm > most:
            yield _warn(
                f"{name} asks for {part.amplitude_mm:g} mm of cable at {frequency:g} Hz, the tendon motors are fast "
                f"enough for {most:.2g} mm there"
            )


_SERVO_FACTOR = 1.25
"""By which a rig's number and its servo's may differ: that of the maker's voltages, and what "at stall" leaves open."""


def _servo_findings(rig: RigSpec) -> Iterator[Finding]:
    """Yield which numbers of the rig are not those of the servos that its wiring names."""
    tendon, drive = SERVOS[rig.wiring.tendon_model], SERVOS[rig.wiring.drive_model]
    known = {
        "tendons.torque_constant": (tendon, tendon.stall_torque / tendon.stall_current),
        "tendons.current_lsb": (tendon, tendon.current_lsb),
        "drive.supply_voltage": (tendon, tendon.nominal_voltage),
        "drive.nominal_voltage": (drive, drive.nominal_voltage),
        "drive.stall_torque": (drive, drive.stall_torque),
        "drive.no_load_speed": (drive, drive.no_load_speed),
        "drive.stall_current": (drive, drive.stall_current),
        "drive.current_lsb": (drive, drive.current_lsb),
    }
    for name, parameter in rig.parameters():
        if name in known:
            servo, expected = known[name]
            if not 1 / _SERVO_FACTOR <= parameter.value / expected <= _SERVO_FACTOR:
                yield _warn(
                    f"{name} is {parameter.value:.4g} {parameter.unit}, that of the {servo.model} is {expected:.4g}; "
                    "correct it, or the model in the rig's [wiring]"
                )
    if rig.limits.tendon_current_a > _SERVO_FACTOR * tendon.stall_current:
        yield _warn(
            f"limits.tendon_current_a is {rig.limits.tendon_current_a:g} A, a {tendon.model} stalls at "
            f"{tendon.stall_current:g} A; lower it, or correct the model in the rig's [wiring]"
        )


def _upright_findings(plan: Plan, rig: RigSpec) -> Iterator[Finding]:
    """Yield where the silicone alone does not keep the head upright, as it has to while motors hold currents: these
    give way to a tilt, motors that hold positions do not."""
    if rig.space is None:
        return
    mass, lever = rig.inertia.head_mass.value, rig.space.lever_mass.value
    height = ((mass - lever) * rig.space.head_height.value + lever * rig.space.lever_height.value) / mass
    rigidity = rig.bending_over_torsional_rigidity * rig.silicone.torsional_rigidity.value
    carried = mast_load(rigidity, rig.silicone.length.value, height) / STANDARD_GRAVITY
    if mass < carried:
        return
    found = (
        f"the silicone alone keeps up to {number(carried, 2)} kg upright, their centre {number(1e3 * height, 3)} mm "
        f"above the plate, the head has {number(mass, 3)} kg; motors that hold currents let it fall over"
    )
    if plan.pretension.mode == "current":
        yield _refuse(f"{found}; set pretension.mode to position", "pretension.mode")
    else:
        yield _warn(f"{found}; hold it upright until all tendons have been pulled to first contact")


def mast_load(bending_rigidity: float, length: float, height: float) -> float:
    """Return the weight [N] at which a clamped column with a rigid mast on it falls over, without shear.

    height: of the weight above the column's end [m]. The root of k h tan(k L) = 1, P = k² E I (0 < k L < π/2); a height
    of nothing gives π² E I/(4 L²), Euler's free end.
    """
    if height <= 0:
        return float(np.pi**2 * bending_rigidity / (4 * length**2))
    ratio = height / length
    turn = optimize.brentq(lambda x: ratio * x * np.sin(x) - np.cos(x), 0.0, np.pi / 2)
    return float((turn / length) ** 2 * bending_rigidity)


def _each_pretension(plan: Plan, values: Sequence[float] | None) -> tuple[float, ...]:
    """Return the caller's values, one for each pretension; empty where none were given."""
    if values is not None and len(values) != len(plan.pretension.pretension_mm):
        raise ValueError(f"{len(values)} values for {len(plan.pretension.pretension_mm)} pretensions")
    return () if values is None else tuple(map(float, values))


def _full_amplitude_hz(frequencies: Sequence[float], reached: Sequence[float], nominal: float) -> float | None:
    full: float | None = None
    for frequency, amplitude in zip(frequencies, reached, strict=True):
        if amplitude < REACHED_SHARE * nominal:
            break
        full = frequency
    return full


def _reach_findings(plan: Plan, rig: RigSpec, reached: Sequence[float]) -> Iterator[Finding]:
    """Yield where the drive falls short: an outcome to know of, not a fault, for the response is measured anyway."""
    if (sweep := plan.sweep) is not None and reached:
        short = [
            (f, a) for f, a in zip(sweep.frequency_hz, reached, strict=True) if a < REACHED_SHARE * sweep.amplitude_deg
        ]
        if short:
            frequency, amplitude = min(short, key=lambda pair: pair[1])
            full = _full_amplitude_hz(sweep.frequency_hz, reached, sweep.amplitude_deg)
            up_to = f"up to {full:g} Hz" if full is not None else "at none of its frequencies"
            yield _note(
                f"sweep asks for {sweep.amplitude_deg:g}° at {frequency:g} Hz, against a held head the drive reaches "
                f"{amplitude:.1f}° there; it reaches {sweep.amplitude_deg:g}° (within {1 - REACHED_SHARE:.0%}) {up_to}"
            )
    if (ring := plan.ring_down) is not None and ring.drive == "lever":
        frequency = max(ring.frequency_hz)
        amplitude = math.degrees(drive_reach(rig, math.radians(ring.amplitude_deg), frequency).amplitude_rad)
        if amplitude < REACHED_SHARE * ring.amplitude_deg:
            yield _note(
                f"ring_down asks for {ring.amplitude_deg:g}° at {frequency:g} Hz, against a held head the drive "
                f"reaches {amplitude:.1f}° there"
            )


def _time_findings(plan: Plan, rig: RigSpec, tension_n: Sequence[float]) -> Iterator[Finding]:
    """Yield what is short: settling against the damping, frequencies, repeats, the decay against its period."""
    if (sweep := plan.sweep) is not None:
        decay = _slowest_decay(rig, math.radians(sweep.amplitude_deg), min(tension_n, default=0.0))
        left = math.exp(-decay * sweep.settle_s)
        if left > _TRANSIENT_LEFT and sweep.drive == "lever":  # how fast a bending dies is not known here
            enough = (
                f"{math.ceil(-10 * math.log(_TRANSIENT_LEFT) / decay) / 10:.1f} s would leave {_TRANSIENT_LEFT:.0%}"
                if decay > 0
                else "nothing damps it"
            )
            yield _warn(f"sweep.settle_s = {sweep.settle_s:g} s may leave {left:.0%} of the start transient; {enough}")
        if len(sweep.frequency_hz) < FEWEST_FREQUENCIES:
            yield _warn(f"sweep has {too_few_frequencies(len(sweep.frequency_hz))} in sweep.frequency_hz")
        if sweep.repeats < 2:
            yield _note("sweep.repeats = 1 gives no standard deviation; 3 repeats are the paper's")
    if (ring := plan.ring_down) is not None:
        lowest = min(ring.frequency_hz)
        if ring.record_s * lowest < _DECAY_PERIODS:
            yield _warn(
                f"ring_down.record_s = {ring.record_s:g} s holds {ring.record_s * lowest:.1f} periods at {lowest:g} "
                f"Hz; {_DECAY_PERIODS / lowest:.1f} s would hold {_DECAY_PERIODS}"
            )


def _slowest_decay(rig: RigSpec, amplitude_rad: float, tension_n: float) -> float:
    """Return an estimate of the decay rate λ [1/s] of the joint at a torsion amplitude and a tension of each tendon.

    Loss factor η, dashpot d and the energy that the guides' loop takes in a cycle of amplitude a:
    λ = (η/2 + loop/(2π k a²)) ω₀ + d/(2 I), k = GJ/L + N T r_b r_h/ℓ. At tension zero only the bare silicone damps.
    """
    silicone, tendons = rig.silicone, rig.tendons
    total = tendons.count * tension_n
    stiffness = silicone.stiffness(0.0) + tendons.stiffness(total, 0.0)
    inertia = rig.inertia.head.value + rig.inertia.lever.value
    by_guides = float(tendons.damping(total, stiffness, np.asarray(amplitude_rad)))
    ratio = silicone.loss_factor.value / 2 + by_guides
    return ratio * math.sqrt(stiffness / inertia) + silicone.viscous.value / (2 * inertia)
