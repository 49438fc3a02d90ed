"""Motion in a recording as pictures show it: stretches over time, Lissajous curves, and film."""

import functools
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr
from matplotlib import animation
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from sinew.analysis.signal.attitude import integrate_rate, steady_motion
from sinew.analysis.signal.signals import drive_channel, read_signals, response_channel, torsion_delay
from sinew.analysis.sweep.response import Ellipse, fit_ellipse
from sinew.figures.style import (
    ACCENT,
    GREY,
    INK,
    RED,
    few,
    frequency_colours,
    frequency_map,
    in_style,
    new_figure,
    note_panel,
    styled,
)
from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, RecordingError
from sinew.measure.recording import Segment, SegmentKind, iterate_segments
from sinew.measure.validation import write_atomically
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_rig

# Figures read the rig that a dataset was made with.


def rig_of(dataset: xr.Dataset) -> RigSpec | None:
    """Return the rig in the attributes of a recording or of results, None where there is none.

    Raises SpecError where there is one and it is not valid.
    """
    text = str(dataset.attrs.get("rig", ""))
    return _parsed(text) if text.strip() else None


@functools.lru_cache(maxsize=4)
def _parsed(text: str) -> RigSpec:
    return parse_rig(text)


@dataclass(frozen=True)
class Group:
    """One group of a recording: what was asked for, its place, its samples, and those of the settle before it."""

    segment: Segment
    index: int
    record: slice
    settle: slice | None


@dataclass(frozen=True)
class Motion:
    """What a picture shows of a stretch of samples.

    time_s: (n,) from the start of the record [s], negative before it.
    torsion: (n,) in `unit`; degrees where the response is an angle.
    drive: (n,) in degrees or its own unit, None where none was recorded.
    is_integral: the torsion was integrated from its rate, so that its rest position means nothing.
    """

    time_s: Array
    torsion: Array
    drive: Array | None
    unit: str
    is_integral: bool = False

    @property
    def label(self) -> str:
        """Return the axis label of the torsion, or of a response that is not an angle."""
        return "torsion φ in degrees" if self.unit == "degrees" else f"response in {self.unit}"


def groups_of(recording: xr.Dataset, kind: SegmentKind) -> list[Group]:
    """Return the groups of one kind (steady, ring-down or idle), in the order in which they were recorded."""
    groups = []
    before: tuple[str, slice] | None = None
    for index, segment, where in iterate_segments(recording):
        if segment.kind == kind:
            settle = before[1] if before is not None and before[0] == "settle" else None
            groups.append(Group(segment, index, where, settle))
        before = (segment.kind, where)
    return groups


def nearest(groups: Iterable[Group], pretension_mm: float, frequency_hz: float | None = None) -> Group | None:
    """Return the group closest in pretension, then in frequency where one is given, then of the first repeat."""

    def distance(group: Group) -> tuple[float, float, int]:
        s = group.segment
        off = abs(s.frequency_hz - frequency_hz) if frequency_hz is not None else 0.0
        return (abs(s.pretension_mm - pretension_mm), off, s.repeat)

    return min(groups, key=distance, default=None)


def motion_of(recording: xr.Dataset, group: Group) -> Motion:
    """Return the motion over the whole periods of a steady group, on one true time: the delay budget is undone.

    Raises RecordingError where the group holds no whole period.
    """
    motion = _steady(recording, group)
    factor, unit = _in_degrees(str(motion["torsion"].attrs["units"]))
    drive = None
    if "drive" in motion:
        drive = motion["drive"].values * _in_degrees(str(motion["drive"].attrs["units"]))[0]
    time = motion["time_s"].values - recording["time_s"].values[group.record.start]
    return Motion(time, factor * motion["torsion"].values, drive, unit)


def _steady(recording: xr.Dataset, group: Group) -> xr.Dataset:
    return steady_motion(recording.isel(sample=group.record, segment=[group.index]), 0, rig_of(recording))


def ellipse_of(recording: xr.Dataset, group: Group) -> Ellipse:
    """Return the Lissajous ellipse of a steady group, in the units of `motion_of`.

    Raises RecordingError where the group holds no whole period or no drive was recorded.
    """
    motion = _steady(recording, group)
    ellipse = fit_ellipse(motion)
    drive, torsion = (_in_degrees(str(motion[name].attrs["units"]))[0] for name in ("drive", "torsion"))
    return Ellipse(
        drive * ellipse.drive_amplitude,
        torsion * ellipse.torsion_amplitude,
        ellipse.lag_rad,
        drive * torsion * ellipse.area,
    )


def at_pretension(recording: xr.Dataset, pretension_mm: float) -> str:
    """Return the end of a title that names the pretension, empty for a foreign recording, which has none."""
    return "" if recording.attrs.get("source") == "import" else f" at a pretension of {pretension_mm:g} mm"


def drive_of(recording: xr.Dataset, where: slice, origin_s: float) -> tuple[Array, Array, Array | None]:
    """Return time from an origin [s], measured drive [deg] and commanded drive [deg], None where not recorded."""
    time = recording["time_s"].values[where] - origin_s
    command = None
    if "drive_command_rad" in recording:
        command = np.rad2deg(recording["drive_command_rad"].values[where])
    return time, np.rad2deg(recording["drive_rad"].values[where]), command


def released_motion(recording: xr.Dataset, group: Group, *, with_settle: bool = False) -> Motion:
    """Return the motion in the record of a ring-down, with the drive's last seconds before it on request.

    A rate is integrated after its reading at rest (idle record of the same pretension, where there is one) was taken
    off; the torsion is put earlier by the delay budget's delay at the drive frequency.
    """
    start = group.settle.start if with_settle and group.settle is not None else group.record.start
    alone = recording.isel(sample=slice(start, group.record.stop), segment=[group.index])
    time = alone["time_s"].values - recording["time_s"].values[group.record.start]
    channel, drive = response_channel(alone), drive_channel(alone)
    factor, unit = _in_degrees("rad" if channel.is_rate else channel.unit)
    torsion = channel.values
    if channel.is_rate:
        torsion = integrate_rate(time, channel.values - _reading_at_rest(recording, group))
        # Shifted samples keep their stamps: the value that was true at t was read at t + delay.
        torsion = np.interp(time + _delay(recording, group), time, torsion)
    driven = None if drive is None else drive.values * _in_degrees(drive.unit)[0]
    return Motion(time, factor * torsion, driven, unit, channel.is_rate)


def _in_degrees(unit: str) -> tuple[float, str]:
    return (180.0 / np.pi, "degrees") if unit == "rad" else (1.0, unit)


def _reading_at_rest(recording: xr.Dataset, group: Group) -> float:
    idle = nearest(groups_of(recording, "idle"), group.segment.pretension_mm)
    if idle is None or idle.segment.pretension_mm != group.segment.pretension_mm:
        return 0.0
    return float(recording["gyro_rad_s"].values[idle.record, 0].mean())


def _delay(recording: xr.Dataset, group: Group) -> float:
    """Return the delay of the recorded torsion against the recorded drive [s]."""
    rig = rig_of(recording)
    if rig is None or not np.isfinite(group.segment.frequency_hz):
        return 0.0
    record = recording.isel(sample=group.record, segment=[group.index])
    budget = read_signals(record, rig).budget
    return torsion_delay(budget, group.segment.frequency_hz) - budget.drive_delay_s


# Figure 7 is drawn: torsion over drive as Lissajous curves, beside the ideal shapes.

_SHAPES = {"a": 0, "b": 45, "c": 90, "d": 135, "e": 180}


@in_style
def draw_lissajous(recording: xr.Dataset, pretension_mm: float = 4.0, curves: int = 9) -> Figure | None:
    """Return Figure 7 of the paper, or None where drive and response were not both recorded in steady groups.

    Middle: measured curves of the first repeat at the pretension closest to `pretension_mm`, some frequencies of
    it, and the ellipse fitted where the lag is closest to 90 degrees. Left and right: the ideal shapes for lags from
    0 to 180 degrees, drive and torsion of equal amplitude.
    """
    groups = [g for g in groups_of(recording, "steady") if g.segment.repeat == 0]
    if not groups or not ({"drive_rad", "drive"} & set(map(str, recording.data_vars))):
        return None
    found = min((g.segment.pretension_mm for g in groups), key=lambda p: abs(p - pretension_mm))
    here = sorted((g for g in groups if g.segment.pretension_mm == found), key=lambda g: g.segment.frequency_hz)
    chosen = [here[i] for i in few(len(here), curves)]
    figure = new_figure(3.9)
    places = figure.subplot_mosaic("ame;bmd;cmk", width_ratios=(1, 3.4, 1))
    for phase, degrees in _SHAPES.items():
        _draw_shape(places[phase], degrees)
    middle = places["m"]
    label = ""
    frequencies = [g.segment.frequency_hz for g in chosen]
    for group, colour in zip(chosen, frequency_colours(frequencies), strict=True):
        motion = motion_of(recording, group)
        assert motion.drive is not None
        label = motion.label
        middle.plot(motion.drive, motion.torsion, color=colour, linewidth=1.0)
    _draw_ellipse(middle, recording, chosen)
    nominal = chosen[0].segment.amplitude_deg
    if "drive_rad" in recording and np.isfinite(nominal):
        for level in (-nominal, nominal):
            middle.axvline(level, color=GREY, linestyle=":", linewidth=1.0)
    angle = "drive_rad" in recording
    drive_label = "drive θ in degrees (dotted: nominal)" if angle else f"drive in {recording['drive'].attrs['units']}"
    middle.set(xlabel=drive_label, ylabel=label)
    note_panel(middle, "", "measured" + at_pretension(recording, found))
    _draw_key(figure, places["k"], frequencies)
    return figure


def _draw_ellipse(axes: Axes, recording: xr.Dataset, groups: list[Group]) -> None:
    """Draw the ellipse fitted to the curve whose lag is closest to a right angle, and say the lag."""
    ellipses = [ellipse_of(recording, group) for group in groups]
    i = min(range(len(groups)), key=lambda i: abs(ellipses[i].lag_rad - np.pi / 2))
    label = f"ellipse at {groups[i].segment.frequency_hz:.3g} Hz: lag {np.rad2deg(ellipses[i].lag_rad):.0f}°"
    axes.plot(*ellipses[i].curve(91), color=INK, linewidth=1.0, linestyle=(0, (4, 3)), zorder=4, label=label)
    axes.legend(loc="upper left", borderaxespad=0.1, handlelength=2.4)


def _draw_shape(axes: Axes, degrees: int) -> None:
    """Draw sin(t - lag) over sin(t), with the sense in which it is run through."""
    lag, t = np.deg2rad(degrees), np.linspace(0, 2 * np.pi, 91)
    axes.plot(np.sin(t), np.sin(t - lag), color=ACCENT, linewidth=1.4)
    if degrees % 180:
        tip, tail = np.array([0.30, 0.05]) + lag / 2 - np.pi / 4
        ends = [(np.sin(a), np.sin(a - lag)) for a in (tip, tail)]
        axes.annotate("", ends[0], ends[1], arrowprops={"arrowstyle": "-|>", "color": ACCENT, "lw": 1.2})
    axes.set(xlim=(-1.25, 1.25), ylim=(-1.25, 1.25), aspect="equal", xticks=[], yticks=[])
    axes.axhline(0, color=GREY, linewidth=0.5)
    axes.axvline(0, color=GREY, linewidth=0.5)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.set_title(f"{degrees}°", loc="center")


def _draw_key(figure: Figure, axes: Axes, frequencies: list[float]) -> None:
    axes.axis("off")
    mappable = ScalarMappable(Normalize(min(frequencies), max(frequencies)), frequency_map())
    inner = axes.inset_axes((0.1, 0.0, 0.16, 1.0))
    bar = figure.colorbar(mappable, cax=inner, label="drive frequency in Hz")
    for frequency in frequencies:
        bar.ax.axhline(frequency, color="white", linewidth=0.7)
    bar.outline.set_visible(False)


# ---- film: the joint as it swings, its torsion over time or its amplitude over frequency
#
# A decay is the paper's Video S1: driven, let go, at rest. A sweep goes through the drive frequencies of one
# pretension, and the resonance curve grows. The joint is drawn upright, as a cylinder that twists evenly.

FilmKind = Literal["ring-down", "sweep"]
_FILMED: dict[FilmKind, SegmentKind] = {"ring-down": "ring-down", "sweep": "steady"}
FORMATS = (".gif", ".webp")  # which Pillow writes; .mp4 would need another program
_SIZE_IN, _DPI = (7.2, 3.6), 100
_LATEST_S = 3.0  # of a drive before it stops
_PERIODS = 2.0  # that a sweep stays at each frequency
_RADIUS = 0.3  # of the silicone over its length, as it is drawn
_FLAT = 0.32  # height over width of a circle seen from the side


class _Reel(NamedTuple):
    """What is shown: torsion and lever (n,) in degrees at times (n,) [s], and the curve that grows beside the joint.

    curve: (m, 2). latest: the point that a sample has reached (n,). title: format of such a point. over: of the axis.
    """

    time_s: Array
    torsion: Array
    lever: Array
    curve: Array
    latest: Array
    title: str
    over: str


def save_film(
    recording: xr.Dataset,
    path: Path,
    kind: FilmKind = "ring-down",
    pretension_mm: float = 0.0,
    *,
    frames_per_s: int = 25,
    progress: Callable[[float, float], None] | None = None,
) -> int:
    """Write a film of the groups closest to a pretension, as fast as it was, and return how many frames it has.

    path: ends with .gif or .webp. progress: called with (which, total) frames.
    Raises RecordingError where the recording has no such groups, FileError where the format cannot be written.
    """
    if path.suffix.lower() not in FORMATS:
        raise FileError(f"cannot write a film as {path.name}; expected a name that ends with {' or '.join(FORMATS)}")
    groups = [one for one in groups_of(recording, _FILMED[kind]) if one.segment.repeat == 0]
    first = nearest(groups, pretension_mm)
    if first is None:
        raise RecordingError(f"the recording holds no {_FILMED[kind]} segment; film the other kind, or record one")
    reel = _decay(recording, first) if kind == "ring-down" else _sweep(recording, groups, first.segment.pretension_mm)
    ticks = np.arange(reel.time_s[0], reel.time_s[-1], 1 / frames_per_s)
    with styled():
        figure = Figure(figsize=_SIZE_IN, dpi=_DPI, layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(2, 3))
        turn = _joint(left)
        right.plot(*reel.curve.T, color=GREY, linewidth=0.7, alpha=0.4)
        right.set(xlabel=reel.over, ylabel="torsion in degrees")
        (grown,) = right.plot([], [], "o-" if kind == "sweep" else "-", color=ACCENT, markersize=4, linewidth=1.2)
        title = figure.suptitle(reel.title, fontsize=10, color=INK)

        def show(time_s: float) -> list[Artist]:
            now = int(np.searchsorted(reel.time_s, time_s, side="right")) - 1
            turn(np.radians(reel.torsion[now]), np.radians(reel.torsion[now] + reel.lever[now]))
            grown.set_data(*reel.curve[: reel.latest[now] + 1].T)
            title.set_text(reel.title.format(*reel.curve[reel.latest[now]]))
            return []

        FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call]
        figure.set_layout_engine("none")  # arranged once; to do it for every picture would take most of the time
        film = animation.FuncAnimation(figure, show, frames=ticks, cache_frame_data=False)
        pillow = animation.PillowWriter(fps=frames_per_s)
        write_atomically(path, lambda file: film.save(file, writer=pillow, dpi=_DPI, progress_callback=progress))
    return int(ticks.size)


def _decay(recording: xr.Dataset, group: Group) -> _Reel:
    time, torsion, lever = _angles(released_motion(recording, group, with_settle=True))
    shown = time >= -_LATEST_S
    curve, latest = np.stack([time, torsion], axis=1)[shown], np.arange(shown.sum())
    title = "driven, then let go" + at_pretension(recording, group.segment.pretension_mm)
    return _Reel(time[shown], torsion[shown], lever[shown], curve, latest, title, "time since the drive stopped in s")


def _sweep(recording: xr.Dataset, steady: list[Group], found: float) -> _Reel:
    chosen = [group for group in steady if group.segment.pretension_mm == found]
    columns, begin = [], 0.0
    curve: list[tuple[float, float]] = []
    for group in sorted(chosen, key=lambda group: group.segment.frequency_hz):
        hz, (time, torsion, lever) = group.segment.frequency_hz, _angles(motion_of(recording, group))
        shown = time < time[0] + _PERIODS / hz
        columns.append((time[shown] - time[0] + begin, torsion[shown], lever[shown], np.full(shown.sum(), len(curve))))
        curve.append((hz, 0.5 * float(np.ptp(torsion))))
        begin += _PERIODS / hz
    time, torsion, lever, latest = (np.concatenate(column) for column in zip(*columns, strict=True))
    title = f"{{:.2f}} Hz{at_pretension(recording, found)}: ±{{:.1f}}°"
    return _Reel(time, torsion, lever, np.array(curve), latest, title, "drive frequency in Hz")


def _angles(motion: Motion) -> tuple[Array, Array, Array]:
    """Return (time [s], torsion, lever) of a motion in degrees. Raises RecordingError for any other."""
    if motion.unit != "degrees" or not np.isfinite(motion.torsion).all():
        raise RecordingError(f"found a response in {motion.unit}, or one that is not finite; a film draws angles alone")
    return motion.time_s, motion.torsion, np.zeros(motion.time_s.size) if motion.drive is None else motion.drive


def _joint(axes: Axes) -> Callable[[float, float], None]:
    """Draw silicone, tendons, head plate and lever; return what turns the head and the lever against the base [rad]."""
    axes.set(xlim=(-2.6 * _RADIUS, 2.6 * _RADIUS), ylim=(-0.25, 1.45), aspect="equal")
    axes.axis("off")
    around, feet, ends = np.linspace(0, 2 * np.pi, 61), np.pi / 4 + np.pi / 2 * np.arange(4), np.array([0.0, 1.0])
    axes.fill(np.array([-1, 1, 1, -1]) * _RADIUS, (0, 0, 1, 1), color="#cfe3f3")
    tendons = [axes.plot([], [], color=INK, linewidth=1.3)[0] for _ in feet]
    axes.fill(*_seen(1.5 * _RADIUS, around, 1.0), color="#e7ebee", alpha=0.9)
    (mark,) = axes.plot([], [], color=ACCENT, linewidth=2.2)
    (arms,) = axes.plot([], [], "o-", color=RED, linewidth=2.4, markersize=9)
    axes.text(0, -0.23, "lever (red) against the head plate (blue mark)", ha="center", fontsize=7.5, color=INK)

    def turn(torsion: float, lever: float) -> None:
        for tendon, foot in zip(tendons, feet, strict=True):
            tendon.set_data(*_seen(1.25 * _RADIUS, foot + torsion * ends, ends))
        mark.set_data(*_seen(1.45 * _RADIUS * ends, torsion - np.pi / 2, 1.0))
        arms.set_data(*_seen(2.2 * _RADIUS, lever + np.pi * ends, 1.18))

    return turn


def _seen(radius: Array | float, angle: Array | float, height: Array | float) -> tuple[Array, ...]:
    """Return where a point at an angle and a height of the joint is on the picture."""
    return np.broadcast_arrays(radius * np.cos(angle), height + _FLAT * radius * np.sin(angle))
