"""What alarms are about: readings of a run under way, and the limits that a rig gives them.

Whether one is beyond its limit, and who has seen it, is decided by each page (`static/alarms.js`), for its viewer.
"""

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from sinew.measure.arrays import Array
from sinew.measure.events import Health
from sinew.plan.rig import RigSpec, Tendons

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
