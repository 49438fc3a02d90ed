"""Judgement of a run under way: which measured points miss what was predicted, and what alarms are about.

The uncertainty that counts is that of the difference, at 90 %: the measured interval's end towards the prediction and
the band's edge towards the point, each as a distance from its own middle, added in quadrature. Both leave one honest
point in ten outside.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.measure.arrays import Array
from sinew.measure.estimate import number, shown_interval, span, typeset
from sinew.measure.events import Health
from sinew.plan.rig import RigSpec, Tendons

LEAST_SHARE, LEAST_LAG_DEG = 0.10, 10.0
"""Without a band: how far a gain, as a share of the predicted one, and a lag may be off whatever its own interval."""

_BEYOND = 0.01  # of a frequency: how far outside a predicted curve its end still counts
_PLAINLY = 10.0  # times its uncertainty: from here on a tenth of it tells nothing
_FAR = 100.0  # times: so far off that the interval, of few repeats, is to be doubted before the number
_UNITS = {"gain": "", "phase": "°"}


@dataclass(frozen=True)
class Verdict:
    """What the prediction says of one point.

    predicted: the nearest stable motion at its frequency. low, high: the band there; None without one. off: measured
    less predicted, in degrees or as the gain itself. half: of the 90 % interval of that difference. misses: whether
    it is too far off. sentence: by how much, "+12 %, 2.1 of its uncertainty".
    """

    predicted: float
    low: float | None
    high: float | None
    off: float
    half: float
    misses: bool
    sentence: str


def judge(what: str, curve: dict[str, Any], frequency_hz: float, estimate: dict[str, Any]) -> Verdict | None:
    """Return what a predicted curve says of a measured point; None where one of them leaves it open.

    what: gain or phase. curve: as `sinew.apps.dashboard.hub.Results` has it. estimate: as JSON holds it. With a band a
    point misses if it is farther off than the uncertainty of the difference; without one it must be off by more than
    its own interval and by more than `LEAST_SHARE` of the gain or `LEAST_LAG_DEG`.
    """
    value, (low, high) = estimate["value"], estimate["interval90"]
    if value is None or low is None or high is None:
        return None
    at = np.clip(frequency_hz, np.min(curve["frequency_hz"]), np.max(curve["frequency_hz"]))
    motions = _motions(curve, what, at) if abs(at - frequency_hz) <= _BEYOND * frequency_hz else []
    if not motions:
        return None
    offs = [_difference(what, value, motion) for motion in motions]
    off, predicted = min(zip(offs, motions, strict=True), key=lambda pair: abs(pair[0]))
    own = value - low if off > 0 else high - value
    band = _band(curve, what, at)
    if band is None:
        allowed = LEAST_SHARE * abs(predicted) if what == "gain" else LEAST_LAG_DEG
        half = own
        misses = abs(off) > max(half, allowed)
    else:
        edge = _difference(what, band[1], predicted) if off > 0 else -_difference(what, band[0], predicted)
        half = math.hypot(own, max(0.0, edge))
        misses = abs(off) > half
    first, last = band or (None, None)
    return Verdict(predicted, first, last, off, half, bool(misses), _in_words(what, off, predicted, half))


def _motions(curve: dict[str, Any], what: str, at: float) -> list[float]:
    """Return the stable motions at a frequency, all of them where none is stable; a curve with folds has several."""
    x, y = np.asarray(curve["frequency_hz"], float), np.asarray(curve[what], float)
    stable = np.asarray(curve.get("stable") or np.ones(x.size, bool), bool)
    if x.size == 1:
        return [float(y[0])]
    low, high = np.minimum(x[:-1], x[1:]), np.maximum(x[:-1], x[1:])
    parts = np.flatnonzero((low <= at) & (at <= high))
    steady = parts[stable[parts] & stable[parts + 1]]
    found = []
    for i in steady if steady.size else parts:
        share = 0.0 if x[i] == x[i + 1] else (at - x[i]) / (x[i + 1] - x[i])
        found.append(float(y[i] + share * (y[i + 1] - y[i])))
    return found


def _band(curve: dict[str, Any], what: str, at: float) -> tuple[float, float] | None:
    """Return the ends of the band at a frequency; None where there is none."""
    ends = [np.array(curve.get(f"{what}_{end}") or [], dtype=float) for end in ("low", "high")]
    if not all(end.size for end in ends):
        return None
    x = np.asarray(curve["frequency_hz"], float)
    order = np.argsort(x, kind="stable")
    low, high = (float(np.interp(at, x[order], end[order])) for end in ends)
    return (low, high) if math.isfinite(low) and math.isfinite(high) else None


def _difference(what: str, one: float, other: float) -> float:
    """Return one less the other; of lags the nearer way round, in degrees."""
    return one - other if what == "gain" else (one - other + 180.0) % 360.0 - 180.0


def _in_words(what: str, off: float, predicted: float, half: float) -> str:
    by = f"{100 * off / abs(predicted):+.0f} %" if what == "gain" and predicted else f"{off:+.0f}{_UNITS[what]}"
    if not half > 0:
        return typeset(by)
    times = abs(off) / half
    if times > _FAR:
        return typeset(f"{by}, more than {_FAR:g} times its uncertainty")
    return typeset(f"{by}, {times:.{0 if times >= _PLAINLY else 1}f} of its uncertainty")


# The points of a run, each with what is said of it.


def judged(predicted: Sequence[dict[str, Any]], measured: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return measured curves with `gain_verdict` and `phase_verdict`, one `Verdict` or None for each point."""
    curves = {curve["pretension_mm"]: curve for curve in predicted}
    made = []
    for one in measured:
        curve = curves.get(one["pretension_mm"])
        points = {what: zip(one["frequency_hz"], one[what], strict=True) for what in _UNITS}
        verdicts = {
            f"{what}_verdict": [None if curve is None else judge(what, curve, at, value) for at, value in points[what]]
            for what in _UNITS
        }
        made.append({**one, **verdicts})
    return made


def misses(measured: Sequence[dict[str, Any]]) -> list[str]:
    """Return a sentence for each point that misses its prediction, the farthest by its uncertainty first."""
    found = []
    for one in measured:
        for what, unit in _UNITS.items():
            for at, value, verdict in zip(one["frequency_hz"], one[what], one[f"{what}_verdict"], strict=True):
                if verdict is not None and verdict.misses:
                    hoped = span(verdict.low, verdict.high, unit) if verdict.low is not None else ""
                    hoped = hoped or number(verdict.predicted, 3, unit)
                    name = {"gain": "gain", "phase": "lag"}[what]
                    place = f"{one['pretension_mm']:g} mm, {at:g} Hz"
                    said = f"{place}: {name} {shown_interval(value, unit)}, predicted {hoped}: {verdict.sentence}"
                    found.append((abs(verdict.off) / verdict.half if verdict.half else math.inf, typeset(said)))
    return [said for _, said in sorted(found, key=lambda row: -row[0])]


def tally(measured: Sequence[dict[str, Any]]) -> str:
    """Return how many points miss, in one sentence; empty where none could be judged."""
    verdicts = [v for one in measured for what in _UNITS for v in one[f"{what}_verdict"] if v is not None]
    count = sum(verdict.misses for verdict in verdicts)
    if not verdicts:
        return ""
    if not count:
        return f"None of {len(verdicts)} judged values misses its prediction."
    verb = "misses" if count == 1 else "miss"
    by_chance = " One in ten does by chance." if any(v.low is not None for v in verdicts) else ""
    return f"{count} of {len(verdicts)} judged values {verb} the prediction.{by_chance}"


# Alarms: readings of a run under way, and the limits that a rig gives them. Whether one is beyond its limit, and who
# has seen it, is decided by each page (`static/alarms.js`), for its viewer.

_READINGS_S = 1.0  # how long a reading holds on to its largest value: no frame to a page is later
_MISSED_S = 60.0

ALARM_SHARE = 0.9
"""Of a rig's limit, at which its alarm begins unless somebody sets it elsewhere: before the bench stops."""

MISSED_LIMIT = 5
"""Cycles missed within a minute, beyond which their alarm begins; no rig has a limit for them."""


def alarm_limits(rig: RigSpec) -> dict[str, dict[str, float | None]]:
    """Return where the alarm of each reading begins, `limit`, and what the rig allows, `rig`."""
    allowed = {"temperature": rig.limits.temperature_c, "tension": rig.limits.tension_n, "tilt": rig.limits.tilt_deg}
    limits: dict[str, dict[str, float | None]] = {"missed": {"limit": float(MISSED_LIMIT), "rig": None}}
    for name, most in allowed.items():
        limits[name] = {"limit": round(ALARM_SHARE * most, 3), "rig": most}
    return limits


class Readings:
    """What alarms are about: the largest value of each within the last second, so that no peak slips between frames.

    Values are (largest, of which part), by reading: tension [N], tilt [deg] away from the pose, temperature [°C], and
    cycles missed within the last minute. tendons: of the rig; without them only what a run tells of itself is read.
    """

    def __init__(self, tendons: Tendons | None = None) -> None:
        self._tendons = tendons
        self._peaks: deque[tuple[float, Array, float]] = deque()
        self._missed: deque[tuple[float, int]] = deque()
        self._celsius: dict[str, float] = {}

    def take(self, now: float, traces: Mapping[str, Array]) -> None:
        """Take new samples. now: [s], of any clock. traces: by key, (n,) each, as the oscilloscope has them."""
        tendons = self._tendons
        if tendons is None:
            return
        currents = [traces[f"tendon_{i + 1}_current"] for i in range(tendons.count)]
        away = (traces["in_plane"], traces["out_of_plane"]) if "in_plane" in traces else (traces["tilt"],)
        tension = tendons.tension(np.fmax(0.0, np.fmax.reduce(currents, axis=1)))
        self._peaks.append((now, tension, float(np.fmax.reduce(np.hypot.reduce(away, axis=0)))))
        while self._peaks[0][0] < now - _READINGS_S:
            self._peaks.popleft()

    def take_health(self, now: float, health: Health) -> None:
        """Take what a run told of itself."""
        self._celsius = dict(health.temperature_c)
        if self._missed and health.missed < self._missed[-1][1]:
            self._missed.clear()  # the run began anew
        self._missed.append((now, health.missed))
        while self._missed[0][0] < now - _MISSED_S:
            self._missed.popleft()

    def document(self) -> dict[str, tuple[float, str]]:
        """Return the readings that there are."""
        found: dict[str, tuple[float, str]] = {}
        if self._peaks:
            tension = np.fmax.reduce([peak for _, peak, _ in self._peaks], axis=0)
            if np.isfinite(tension).any():
                tendon = int(np.nanargmax(tension))
                found["tension"] = round(float(tension[tendon]), 1), f"tendon {tendon + 1}"
            tilt = float(np.fmax.reduce([tilt for _, _, tilt in self._peaks]))
            if math.isfinite(tilt):
                found["tilt"] = round(tilt, 2), "head plate"
        known = {name: value for name, value in self._celsius.items() if math.isfinite(value)}
        if known:
            hottest = max(known, key=lambda name: known[name])
            found["temperature"] = known[hottest], hottest
        if self._missed:
            found["missed"] = float(self._missed[-1][1] - self._missed[0][1]), "within a minute"
        return found
