"""What a torso joint has to do, a band and a yaw, from walking or from numbers that somebody gives."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate
from sinew.tune.gait.bout import (
    FEWEST_STRIDES,
    SHORTEST_STRIDES,
    BodyMotion,
    BoutGait,
    Walk,
    bout_gait,
    find_walk,
    short_gait,
    unknown,
)

_LARGEST_YAW_DEG = 45.0
_REGULAR, _THROUGHOUT = 0.6, 0.8


@dataclass(frozen=True)
class WalkGait:
    """The gait of one record: its bouts, what swings in them (`BodyMotion.swing`), and what is in no bout [s]."""

    name: str
    swing: str
    drifts: bool
    bouts: tuple[BoutGait, ...]
    left_out_s: float


@dataclass(frozen=True)
class GaitTarget:
    """What a torso joint has to do for a gait.

    source: recordings or numbers. frequency_hz: mean over all strides. band_hz: least and greatest mean of five
    strides in a row. yaw_deg: amplitude, half of peak to peak of the fundamental, mean over all strides; yaw_band_deg:
    least and greatest of a bout. swing: what turns against what. strides: how many. regularity: 0 to 1, NaN where
    unknown. An uncertainty that is not known is NaN. sentences: all this in words, with what was left out.
    """

    source: Literal["recordings", "numbers"]
    frequency_hz: Estimate
    band_hz: tuple[float, float]
    yaw_deg: Estimate
    yaw_band_deg: tuple[float, float]
    swing: str
    strides: float
    regularity: float
    walks: tuple[WalkGait, ...]
    sentences: tuple[str, ...]


def estimate_gait(motion: BodyMotion, name: str) -> WalkGait:
    """Return the gait of a record; of one with fewer than five strides in a row the one short stretch.

    Raises RecordingError where there are no steps, where the steps of a longer record are too few or too uneven, and
    where the yaw is not a walking person's.
    """
    walk = find_walk(motion)
    if not walk.bouts:
        _refuse_scraps(motion, walk)
    bouts = tuple(bout_gait(motion, bout) for bout in walk.bouts) or (short_gait(motion, walk),)
    left_out = float(motion.time_s[-1] - motion.time_s[0]) - sum(bout.stop_s - bout.start_s for bout in bouts)
    swing = motion.swing[0]
    for bout in bouts:
        if not bout.yaw_deg.value < _LARGEST_YAW_DEG:
            raise RecordingError(
                f"the yaw of {swing} swings by ±{bout.yaw_deg.value:.3g}°, more than a walking person's "
                f"{_LARGEST_YAW_DEG:g}°; check the unit of the angle or the gyroscope (--yaw COL:unit, --gyro-unit)"
            )
    return WalkGait(name, swing, motion.drifts, bouts, left_out)


def _refuse_scraps(motion: BodyMotion, walk: Walk) -> None:
    """Raise RecordingError unless a walk without a bout is a short record of even walking throughout."""
    length, whole = walk.longest_s[1] - walk.longest_s[0], float(motion.time_s[-1] - motion.time_s[0])
    if length < _THROUGHOUT * whole or length * walk.frequency_hz < SHORTEST_STRIDES or walk.regularity < _REGULAR:
        raise RecordingError(
            f"no {FEWEST_STRIDES} strides of steady walking in a row; the longest stretch that repeats somewhat like "
            f"steps lasts {length:.3g} s of {whole:.3g} s (autocorrelation {walk.regularity:.2f}); record ten strides "
            "straight on, or choose a stretch with --start and --stop"
        )


def target_of_walks(walks: Sequence[WalkGait]) -> GaitTarget:
    """Return the target of one or several records. Raises RecordingError where they do not tell the same swing."""
    kinds = {walk.swing: walk.name for walk in walks}
    if len(kinds) > 1:
        found = " and ".join(f"{name} that of {swing}" for swing, name in kinds.items())
        raise RecordingError(f"the files tell different yaws, {found}; give files of one kind, or one part in all")
    bouts = [bout for walk in walks for bout in walk.bouts]
    strides, time = [bout.strides for bout in bouts], [bout.strides / bout.frequency_hz.value for bout in bouts]
    yaw = [bout.yaw_deg.value for bout in bouts]
    target = GaitTarget(
        source="recordings",
        frequency_hz=_mean([bout.frequency_hz for bout in bouts], time),
        band_hz=(min(bout.slowest_hz for bout in bouts), max(bout.fastest_hz for bout in bouts)),
        yaw_deg=_mean([bout.yaw_deg for bout in bouts], strides),
        yaw_band_deg=(min(yaw), max(yaw)),
        swing=walks[0].swing,
        strides=sum(strides),
        regularity=sum(b.regularity * n for b, n in zip(bouts, strides, strict=True)) / sum(strides),
        walks=tuple(walks),
        sentences=(),
    )
    return _told(target, bouts)


def target_of_numbers(band_hz: tuple[float, float], yaw_deg: float) -> GaitTarget:
    """Return the target that somebody gives as numbers; its uncertainties are unknown.

    band_hz: lowest and highest stride frequency [Hz]. yaw_deg: amplitude, half of peak to peak [deg].
    Raises SpecError where they are not positive or in the wrong order.
    """
    low, high = band_hz
    if not 0 < low <= high < math.inf:
        raise SpecError(f"found a stride band of {low:g} to {high:g} Hz, expected 0 < lowest <= highest, as 0.7:1.1")
    if not 0 < yaw_deg < _LARGEST_YAW_DEG:
        raise SpecError(f"found a yaw of ±{yaw_deg:g}°, expected more than 0 and less than {_LARGEST_YAW_DEG:g}°")
    band = f"{low:g} to {high:g} Hz" if low < high else f"{low:g} Hz"
    sentence = f"as asked: strides at {band}, yaw ±{yaw_deg:g}°; numbers without intervals, nothing was measured"
    middle = unknown(0.5 * (low + high))
    amplitude = (float(yaw_deg), float(yaw_deg))
    return GaitTarget(
        "numbers", middle, (low, high), unknown(yaw_deg), amplitude, "as asked", 0.0, math.nan, (), (sentence,)
    )


def _mean(estimates: Sequence[Estimate], weights: Sequence[float]) -> Estimate:
    """Return the weighted mean of independent estimates; half widths of intervals add as standard deviations do."""
    share = [weight / sum(weights) for weight in weights]

    def together(parts: Sequence[float]) -> float:
        return math.sqrt(sum((w * x) ** 2 for w, x in zip(share, parts, strict=True)))

    value = sum(w * e.value for w, e in zip(share, estimates, strict=True))
    half = together([0.5 * (e.high - e.low) for e in estimates])
    return Estimate(value, together([e.std for e in estimates]), value - half, value + half)


def _told(target: GaitTarget, bouts: Sequence[BoutGait]) -> GaitTarget:
    """Return the target with its sentences."""
    low, high = target.band_hz
    sentences = [
        f"{target.strides:.3g} strides in {len(bouts)} bout{'s' if len(bouts) > 1 else ''}: stride frequency "
        f"{_words(target.frequency_hz, 4, ' Hz')}, two steps to a stride"
        + (f"; from {low:.4g} to {high:.4g} Hz over five strides in a row" if low < high else ""),
        f"yaw of {target.swing}: amplitude {_words(target.yaw_deg, 3, '°')}, half of peak to peak of the part at the "
        "stride frequency, in the mean over the strides"
        + (f"; {target.yaw_band_deg[0]:.3g} to {target.yaw_band_deg[1]:.3g}° over the bouts" if len(bouts) > 1 else ""),
    ]
    if any(walk.drifts for walk in target.walks):
        sentences.append(
            "gravity tells nothing of yaw, so the sensors' yaw has no zero and drifts: what is slower than a stride "
            "was taken out, and a lasting twist between the parts is not known"
        )
    if target.swing in ("pelvis", "trunk"):
        sentences.append(
            f"only the {target.swing} was recorded: this is its yaw in space, not that between trunk and pelvis, which "
            "a torso joint has to make and which is larger where the two swing against each other"
        )
    short = [bout for bout in bouts if math.isnan(bout.frequency_hz.std)]
    if short:
        sentences.append(
            f"{min(bout.strides for bout in short):.2g} strides in a row show no scatter from stride to stride, so "
            f"there is no interval and no band; record at least {FEWEST_STRIDES + 4} strides, better thirty"
        )
    left_out = sum(walk.left_out_s for walk in target.walks)
    if left_out > 1.0:
        sentences.append(f"left out: {left_out:.3g} s of standing, starting, stopping, and turning (above 20°/s)")
    if target.regularity < _REGULAR:
        sentences.append(
            f"the motion repeats poorly from stride to stride (autocorrelation {target.regularity:.2f}, of even "
            "walking about 0.9); look at the figure before using the numbers"
        )
    return GaitTarget(**{**target.__dict__, "sentences": tuple(sentences)})


def _words(estimate: Estimate, digits: int, unit: str) -> str:
    value = f"{estimate.value:.{digits}g}{unit}"
    if math.isnan(estimate.low):
        return value
    return f"{value} (90 %: {estimate.low:.{digits}g} to {estimate.high:.{digits}g}{unit})"
