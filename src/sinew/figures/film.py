"""Film of a recording: the joint as it swings, its torsion over time or its amplitude over frequency.

A decay is the paper's Video S1: driven, let go, at rest. A sweep goes through the drive frequencies of one pretension,
and the resonance curve grows. The joint is drawn upright, as a cylinder that twists evenly.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr
from matplotlib import animation
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sinew.figures.motion import Group, Motion, at_pretension, groups_of, motion_of, nearest, released_motion
from sinew.figures.style import ACCENT, GREY, INK, RED, styled
from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, RecordingError
from sinew.measure.recording import SegmentKind
from sinew.measure.validation import write_atomically

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
