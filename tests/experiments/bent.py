"""A bent joint run through the emulator's bytes, beside the twin.

A joint in space whose cables are slack and whose head leans is pulled, bent, held and swung by `sinew run`'s own code
in virtual time; its recording is analysed, and the twin's answer to the same plan likewise, with the twin's own
orientation and as its sensors tell it.
"""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import xarray as xr
from tests.unit.bench_virtual import virtual_bench

from sinew.analysis.analysed import analyse_recording
from sinew.bench.pretension import Held
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.record.sample import Sample
from sinew.bench.run import RunReport
from sinew.emulator.bench import EmulatedRig, drawn_start
from sinew.emulator.faults import Faults, parse_fault
from sinew.emulator.plant import JointPlant
from sinew.measure.events import Event, Pretensioned
from sinew.plan.check import refuse_beyond_limits
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.predict.preview import held_preview
from sinew.twin.parameters import Effects
from sinew.twin.simulate import rest_tension, simulate

_WATCHDOG_S = 0.3  # without a host, so that the bus watchdogs can act
_REST_MOST_S = 4.0  # until a joint that swings in held tendons is at rest


class Truth(NamedTuple):
    """What the mechanics did, at every cycle: time [s], tilt about y and z [rad], torsion [rad], tensions [N]."""

    time_s: np.ndarray
    tilt: np.ndarray
    torsion: np.ndarray
    tension: np.ndarray


class BentRun(NamedTuple):
    """report of the run; truth; levelled: its cycle when the last pretension had been set; recording, None without a
    whole group; is_safe: whether all motors were in the declared state in the end, by the mechanics."""

    report: RunReport
    truth: Truth
    levelled: int
    recording: xr.Dataset | None
    is_safe: bool


def shortened(plan: Plan, frequency_hz: Sequence[float], pretension_mm: float) -> Plan:
    """Return a plan with one pretension and a few frequencies, without ring-downs, and with shorter waits."""
    assert plan.sweep is not None
    sweep = plan.sweep.model_copy(update={"frequency_hz": tuple(frequency_hz), "settle_s": 2.0, "repeats": 1})
    pretension = plan.pretension.model_copy(update={"pretension_mm": (pretension_mm,)})
    return plan.model_copy(update={"pretension": pretension, "sweep": sweep, "ring_down": None})


class _Watcher:
    """Notes the truth at every sample; a Listener."""

    def __init__(self, emulated: EmulatedRig) -> None:
        self._emulated = emulated
        self.rows: list[tuple[float, ...]] = []
        self.levelled = -1

    def on_sample(self, sample: Sample) -> None:
        now = self._emulated.motion()
        self.rows.append((sample.time_s, *now.tilt, now.torsion, *now.tension))

    def on_event(self, event: Event) -> None:
        if isinstance(event, Pretensioned):
            self.levelled = len(self.rows) - 1

    def truth(self) -> Truth:
        rows = np.array(self.rows).T
        return Truth(rows[0], rows[1:3], rows[3], rows[4:])


def run_bent(plan: Plan, spec: RigSpec, seed: int = 0, fault: str = "") -> BentRun:
    """Run a plan on an emulated bench in space, found as `sinew emulate` finds it for a seed.

    fault: as `sinew emulate --fault` takes it; times count from the emulator's start.
    """
    start = drawn_start(spec, seed)
    plant = JointPlant(spec, slack_m=start.slack, rest_tilt=start.tilt, in_space=True)
    bench = virtual_bench(spec, plant=plant, seed=seed)
    emulated = bench.emulated
    Faults(emulated, [parse_fault(fault)] if fault else [], seed)
    watcher, (tension, held) = _Watcher(emulated), _what_holds(plan, spec)
    with TemporaryDirectory() as folder:
        report = bench.run(plan, Path(folder), tension, held=held, listener=watcher)
        recording = recording_from_journal(Path(folder) / "journal.sqlite") if report.groups_done else None
    ended = emulated.time
    emulated.advance(ended + _WATCHDOG_S)
    while emulated.time < ended + _REST_MOST_S and not emulated.in_safe_state():
        emulated.advance(emulated.time + 0.1)
    return BentRun(report, watcher.truth(), watcher.levelled, recording, emulated.in_safe_state())


def _what_holds(plan: Plan, spec: RigSpec) -> tuple[dict[float, float], dict[float, Held] | None]:
    """Return (tension of a tendon at rest by pretension, what holds a pose), as `sinew run` finds them.

    Raises SpecError for a pose that it refuses.
    """
    pretensions = plan.pretension.pretension_mm
    if not plan.is_spatial:
        return dict(zip(pretensions, rest_tension(pretensions, spec).tolist(), strict=True)), None
    preview, rests = held_preview(plan, spec)
    refuse_beyond_limits(preview)
    held = {mm: Held.of(rest) for mm, rest in rests.items()}
    return dict(zip(pretensions, preview.tension_n, strict=True)), held


def twin_of(plan: Plan, spec: RigSpec) -> xr.Dataset:
    """Return the twin's recording of a plan, without noise and scatter."""
    return simulate(plan, spec, effects=Effects().without("sensor_noise", "stamp_jitter", "repeatability"))


class Row(NamedTuple):
    """How far a run's analysed recording is from the twin's, at one frequency or at most over several.

    torsion: per lever; tilt: out of the plane; coupling: of that tilt to the torsion; all as shares. lag_deg: of that
    coupling. bend_deg: the mean bend.
    """

    torsion: float
    tilt: float
    coupling: float
    lag_deg: float
    bend_deg: float

    def words(self) -> str:
        """Return it in words."""
        return (
            f"{self.torsion:+.2%} in torsion, {self.tilt:+.2%} in tilt, {self.coupling:+.2%} and {self.lag_deg:+.2f}° "
            f"in coupling, {self.bend_deg:+.2f}° in bend"
        )


def rows_between(bench: xr.Dataset, twin: xr.Dataset, spec: RigSpec) -> dict[tuple[float, float], Row]:
    """Return how far the results of a recording are from those of the twin's, by pretension [mm] and frequency [Hz]."""
    a, b = (analyse_recording(recording, spec) for recording in (bench, twin))

    def of(results: xr.Dataset, place: dict[str, float]) -> Row:
        here = results.sel(place).isel(repeat=0)
        amplitude, coupling, lag, mean = (
            here[f"{name}"].values
            for name in ("channel_amplitude_rad", "coupling_ratio", "coupling_lag_rad", "channel_mean_rad")
        )
        gain = float(np.ravel(here["gain"].values)[0])
        return Row(gain, float(amplitude[2]), float(coupling[2]), *np.degrees([lag[2], mean[1]]).tolist())

    found = {}
    for mm in a["pretension_mm"].values.tolist():
        for hz in a["frequency_hz"].values.tolist():
            one, other = (of(results, {"pretension_mm": mm, "frequency_hz": hz}) for results in (a, b))
            shares = [x / y - 1 for x, y in zip(one[:3], other[:3], strict=True)]
            found[mm, hz] = Row(*shares, *(x - y for x, y in zip(one[3:], other[3:], strict=True)))
    return found


def off_by(bench: xr.Dataset, twin: xr.Dataset, spec: RigSpec) -> Row:
    """Return how far the results of two recordings are apart at most."""
    return largest_of(list(rows_between(bench, twin, spec).values()))


def largest_of(rows: Sequence[Row]) -> Row:
    """Return the largest size of every column."""
    return Row(*np.abs(np.array(rows)).max(axis=0).tolist())
