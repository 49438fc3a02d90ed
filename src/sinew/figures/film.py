"""Film of a recording: the joint as it swings, its amplitude over time or frequency, and its motion over itself.

A decay is the paper's Video S1: driven, let go, at rest. A sweep goes through the drive frequencies of one pretension,
and the resonance curve grows. The joint is drawn upright, as a cylinder that twists evenly.
"""

import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr
from matplotlib import animation
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sinew.figures.motion import Motion, at_pretension, groups_of, motion_of, nearest, released_motion, rig_of
from sinew.figures.style import ACCENT, GREY, INK, RED, styled
from sinew.measure.arrays import Array
from sinew.measure.doors import write_atomically
from sinew.measure.errors import FileError, RecordingError

FilmKind = Literal["decay", "sweep"]
FORMATS = (".gif", ".webp", ".mp4", ".webm")
_OWN = FORMATS[:2]  # which need no other program

_SIZE_IN, _DPI = (7.2, 3.6), 100
_LATEST_S = 3.0  # of a drive before it stops
_PERIODS = 2.0  # that a sweep stays at each frequency
_LINES = 9  # on the silicone
_FLAT = 0.32  # height over width of a circle seen from the side


@dataclass(frozen=True)
class _Reel:
    """What is shown: torsion and lever (n,) in degrees at times (n,) of samples [s], and what stands beside the joint.

    rate: of the torsion [deg/s]. part: which stretch a sample belongs to (n,). x, y: the curve that grows, one point a
    stretch; empty where the torsion is drawn over time instead.
    """

    time_s: Array
    torsion: Array
    rate: Array
    lever: Array
    part: Array
    x: Array
    y: Array
    title: str
    titles: tuple[str, ...] = ()


def save_film(
    recording: xr.Dataset,
    path: Path,
    kind: FilmKind = "decay",
    pretension_mm: float = 0.0,
    *,
    frames_per_s: int = 25,
    speed: float = 1.0,
    progress: Callable[[float, float], None] | None = None,
) -> int:
    """Write a film of the groups closest to a pretension, and return how many frames it has.

    path: ends with .gif, .webp, .mp4 or .webm; the latter two need the program ffmpeg on the path. speed: of what is
    shown, 1 as it was, 0.25 four times slower. progress: called with (done, total) frames.
    Raises RecordingError where the recording has no such groups, FileError where the format cannot be written.
    """
    if path.suffix.lower() not in FORMATS:
        raise FileError(f"cannot write a film as {path.name}; expected a name that ends with {', '.join(FORMATS)}")
    if path.suffix.lower() not in _OWN and not animation.FFMpegWriter.isAvailable():
        raise FileError(f"found no ffmpeg to write {path.name}; install it, or name a .gif or .webp")
    reel = _decay(recording, pretension_mm) if kind == "decay" else _sweep(recording, pretension_mm)
    ticks = np.arange(reel.time_s[0], reel.time_s[-1], speed / frames_per_s)
    with styled():
        figure = Figure(figsize=_SIZE_IN, dpi=_DPI, layout="constrained")
        stage = _Stage(figure, reel, recording)
        FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call]
        figure.set_layout_engine("none")  # arranged once; to do it for every picture would take most of the time
        film = animation.FuncAnimation(figure, stage.show, frames=ticks, cache_frame_data=False)

        def write(temporary: Path) -> None:
            try:
                film.save(
                    temporary,
                    writer=_writer(path.suffix.lower(), frames_per_s),
                    dpi=_DPI,
                    progress_callback=None if progress is None else lambda i, n: progress(i + 1, n),
                )
            except subprocess.CalledProcessError as error:
                raise FileError(
                    f"ffmpeg cannot write {path.name}: it ended with status {error.returncode}; name a .gif or .webp"
                ) from error

        write_atomically(path, write)
    return int(ticks.size)


def _writer(suffix: str, frames_per_s: int) -> animation.AbstractMovieWriter:
    if suffix in _OWN:
        return animation.PillowWriter(fps=frames_per_s)
    codec = {".mp4": "libx264", ".webm": "libvpx-vp9"}[suffix]
    return animation.FFMpegWriter(fps=frames_per_s, codec=codec, extra_args=["-pix_fmt", "yuv420p"])


def _decay(recording: xr.Dataset, pretension_mm: float) -> _Reel:
    group = nearest(groups_of(recording, "ring-down"), pretension_mm)
    if group is None:
        raise RecordingError(
            "the recording holds no ring-down to film; record one, or film its sweep with --kind sweep"
        )
    motion = _angle(released_motion(recording, group, with_settle=True))
    shown = motion.time_s >= -_LATEST_S
    lever = np.zeros(motion.time_s.size) if motion.drive is None else motion.drive
    title = "driven, then let go" + at_pretension(recording, group.segment.pretension_mm)
    columns = (motion.time_s, motion.torsion, motion.rate, lever)
    time, torsion, rate, lever = (np.asarray(column[shown]) for column in columns)
    none = np.zeros(0)
    return _Reel(time, torsion, rate, lever, np.zeros(time.size), none, none, title)


def _sweep(recording: xr.Dataset, pretension_mm: float) -> _Reel:
    steady = [group for group in groups_of(recording, "steady") if group.segment.repeat == 0]
    first = nearest(steady, pretension_mm)
    if first is None:
        raise RecordingError("the recording holds no steady group to film; record a sweep, or film a decay")
    found = first.segment.pretension_mm
    chosen = sorted(
        (group for group in steady if group.segment.pretension_mm == found), key=lambda g: g.segment.frequency_hz
    )
    pieces = [(_angle(motion_of(recording, g)), g.segment.frequency_hz) for g in chosen]
    columns: list[list[Array]] = [[], [], [], [], []]
    begin = 0.0
    for number, (motion, frequency) in enumerate(pieces):
        lasts = _PERIODS / frequency
        shown = motion.time_s < motion.time_s[0] + lasts
        lever = np.zeros(shown.sum()) if motion.drive is None else motion.drive[shown]
        values = (motion.time_s[shown] - motion.time_s[0] + begin, motion.torsion[shown], motion.rate[shown], lever)
        for column, piece in zip(columns, (*values, np.full(shown.sum(), float(number))), strict=True):
            column.append(piece)
        begin += lasts
    swing = np.array([0.5 * np.ptp(motion.torsion) for motion, _ in pieces])
    time, torsion, rate, lever, part = (np.concatenate(column) for column in columns)
    titles = tuple(f"{frequency:.2f} Hz" for _, frequency in pieces)
    frequencies = np.array([frequency for _, frequency in pieces])
    return _Reel(time, torsion, rate, lever, part, frequencies, swing, at_pretension(recording, found), titles)


def _angle(motion: Motion) -> Motion:
    """Return a motion that can be drawn as the turn of a joint. Raises RecordingError for any other."""
    if motion.unit != "degrees" or not np.isfinite(motion.torsion).all():
        raise RecordingError(f"found a response in {motion.unit}, or one that is not finite; a film draws angles alone")
    return motion


class _Stage:
    """The figure of a film, and what of it moves."""

    def __init__(self, figure: Figure, reel: _Reel, recording: xr.Dataset) -> None:
        self._reel = reel
        places = figure.subplot_mosaic("jjaaa;jjaaa;jjbbb;jjbbb")
        rig = rig_of(recording)
        radius = 0.3 if rig is None else 0.5 * rig.silicone.diameter.value / rig.silicone.length.value
        tendons = 4 if rig is None else rig.tendons.count
        self._joint = _Joint(places["j"], radius, tendons)
        over, self_ = places["a"], places["b"]
        self._is_sweep = reel.x.size > 0
        if self._is_sweep:
            over.plot(reel.x, reel.y, color=GREY, linewidth=0.8, alpha=0.4)
            over.set(xlabel="drive frequency in Hz", ylabel="torsion in degrees", ylim=(0, 1.15 * reel.y.max() or 1.0))
            (self._grown,) = over.plot([], [], "o-", color=ACCENT, markersize=4)
            self_.set(xlabel="lever θ in degrees", ylabel="torsion φ in degrees")
            self._across, self._along = reel.lever, reel.torsion
        else:
            over.plot(reel.time_s, reel.torsion, color=GREY, linewidth=0.6, alpha=0.5)
            over.axvline(0, color=RED, linewidth=0.8, linestyle=(0, (4, 3)))
            over.set(xlabel="time since the drive stopped in s", ylabel="torsion φ in degrees")
            (self._grown,) = over.plot([], [], color=ACCENT, linewidth=1.2)
            self_.set(xlabel="torsion φ in degrees", ylabel="dφ/dt in degrees/s")
            self._across, self._along = reel.torsion, reel.rate
        for low_high, values in ((self_.set_xlim, self._across), (self_.set_ylim, self._along)):
            most = 1.1 * float(np.max(np.abs(values))) or 1.0
            low_high(-most, most)
        (self._way,) = self_.plot([], [], color=ACCENT, linewidth=0.9)
        (self._now,) = self_.plot([], [], "o", color=RED, markersize=5)
        self._title = figure.suptitle(reel.title, fontsize=10, color=INK)

    def show(self, time_s: float) -> list[Artist]:
        """Draw the picture of one time."""
        reel = self._reel
        torsion, lever = (float(np.interp(time_s, reel.time_s, values)) for values in (reel.torsion, reel.lever))
        self._joint.turn(np.radians(torsion), np.radians(torsion + lever))
        seen = slice(0, int(np.searchsorted(reel.time_s, time_s, side="right")))
        now = seen.stop - 1
        if self._is_sweep:
            part = int(reel.part[now])
            self._grown.set_data(reel.x[: part + 1], reel.y[: part + 1])
            self._title.set_text(f"{reel.titles[part]}{reel.title}: ±{reel.y[part]:.1f}°")
            seen = slice(int(np.searchsorted(reel.part, part)), seen.stop)
        else:
            self._grown.set_data(reel.time_s[seen], reel.torsion[seen])
        self._way.set_data(self._across[seen], self._along[seen])
        self._now.set_data(self._across[now : now + 1], self._along[now : now + 1])
        return []


class _Joint:
    """The joint seen from the side and a little from above: silicone, tendons, head plate and lever."""

    def __init__(self, axes: Axes, radius: float, tendons: int) -> None:
        self._radius, self._circle = radius, 1.25 * radius
        self._reach = 2.2 * radius
        axes.set(xlim=(-2.6 * radius, 2.6 * radius), ylim=(-0.25, 1.45), aspect="equal")
        axes.axis("off")
        around = np.linspace(0, 2 * np.pi, 61)
        for height, size in ((0.0, 1.5 * radius), (0.0, radius)):
            axes.fill(*_seen(size, around, height), color="#d9dee3", edgecolor="#8a939b", linewidth=0.8)
        side = np.array([-1.0, 1.0, 1.0, -1.0]) * radius
        axes.fill(side, (0, 0, 1, 1), color="#cfe3f3", alpha=0.8, linewidth=0)
        self._angles = np.linspace(0, 2 * np.pi, _LINES, endpoint=False)
        self._lines = [axes.plot([], [], color="#7fa9c9", linewidth=0.9)[0] for _ in self._angles]
        self._anchors = np.linspace(0, 2 * np.pi, tendons, endpoint=False)
        self._tendons = [axes.plot([], [], color=INK, linewidth=1.3)[0] for _ in self._anchors]
        axes.fill(*_seen(1.5 * radius, around, 1.0), color="#e7ebee", edgecolor="#8a939b", linewidth=0.8, alpha=0.9)
        (self._mark,) = axes.plot([], [], color=ACCENT, linewidth=2.2)
        (self._lever,) = axes.plot([], [], "o-", color=RED, linewidth=2.4, markersize=9, solid_capstyle="round")
        axes.text(0, -0.23, "lever (red) against the head plate (blue mark)", ha="center", fontsize=7.5, color=INK)

    def turn(self, torsion: float, lever: float) -> None:
        """Draw it at a torsion of the head and an angle of the lever [rad], both against the base."""
        heights = np.linspace(0, 1, 21)
        for line, angle in zip(self._lines, self._angles, strict=True):
            here = angle + torsion * heights
            x, y = _seen(self._radius, here, heights)
            line.set_data(np.where(np.sin(here) < 0.1, x, np.nan), y)  # what is behind is not seen
        for line, angle in zip(self._tendons, self._anchors + np.pi / 4, strict=True):
            low, high = _seen(self._circle, angle, 0.0), _seen(self._circle, angle + torsion, 1.0)
            line.set_data((low[0], high[0]), (low[1], high[1]))
            line.set_alpha(0.35 if np.sin(angle) > 0.1 else 1.0)
        end = _seen(1.45 * self._radius, torsion - np.pi / 2, 1.0)
        self._mark.set_data([0.0, float(end[0])], [1.0, float(end[1])])
        ends = [_seen(self._reach, lever + turn, 1.18) for turn in (0.0, np.pi)]
        self._lever.set_data([x for x, _ in ends], [y for _, y in ends])


def _seen(radius: float, angle: Array | float, height: Array | float) -> tuple[Array, Array]:
    """Return where a point at an angle and a height of the joint is on the picture."""
    return np.asarray(radius * np.cos(angle)), np.asarray(height + _FLAT * radius * np.sin(angle))
