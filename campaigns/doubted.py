"""Doubts under trial: good recordings of the twin raise none, and recordings of a spoiled bench raise theirs.

    python -m campaigns.doubted --seeds 20

Good: every tendon mode, several joints (the paper's, a short one, one without guide friction, a stiff one), all effects
and noise, with and without what the twin foretold. Spoiled: the same with one thing wrong that the rig file does not
know of. Prints a line for each spoilt thing: how often it was found, by which doubts, and every false alarm.
"""

import argparse
import math
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import xarray as xr

from sinew.analysis.analysed import analyse_recording
from sinew.analysis.doubts import doubts_of, foretold
from sinew.measure.recording import iterate_segments
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig, parse_plan
from sinew.twin.parameters import Effects
from sinew.twin.simulate import simulate

PLAN = """
name = "doubted"
sample_hz = 200
[pretension]
pretension_mm = [2, 9]
mode = "{mode}"
rest_s = 1
[sweep]
frequency_hz = [1.6, 2.2, 2.8, 3.2, 3.6, 4.0, 4.4, 5.0]
amplitude_deg = {amplitude}
settle_s = 3
periods = 5
repeats = 1
[ring_down]
frequency_hz = [3, 4]
amplitude_deg = {amplitude}
drive_s = 3
record_s = 3
repeats = 1
"""
MODES = ("position", "position-with-current-limit", "current")


def the_plan(mode: str = "position", amplitude: float = 20.0) -> Plan:
    return parse_plan(PLAN.format(mode=mode, amplitude=amplitude))


def rigs() -> dict[str, RigSpec]:
    """Return joints that are not the paper's, beside it."""
    paper = load_rig("paper")

    return {
        "paper": paper,
        "short": changed(paper, silicone__length=0.8, tendons__free_span=0.8),
        "without guide friction": changed(paper, tendons__guide_friction=0.0),
        "stiff and lossy": changed(paper, silicone__torsional_rigidity=1.4, silicone__loss_factor=1.5),
        "light lever": changed(paper, inertia__lever=0.7),
    }


def scaled_gyro(recording: xr.Dataset, factor: float) -> xr.Dataset:
    return recording.assign(gyro_rad_s=recording["gyro_rad_s"] * factor)


def swapped_axes(recording: xr.Dataset) -> xr.Dataset:
    gyro = recording["gyro_rad_s"]
    return recording.assign(gyro_rad_s=gyro.copy(data=gyro.values[:, [2, 1, 0]]))


def frozen(recording: xr.Dataset, name: str, for_s: float = 0.6) -> xr.Dataset:
    """Return the recording with one channel standing still in the middle of a steady segment."""
    rate = 1.0 / float(np.median(np.diff(recording["time_s"].values[:50])))
    values = recording[name].values.copy()
    _, _, where = next(one for one in iterate_segments(recording, "steady"))
    first = where.start + (where.stop - where.start) // 4
    values[first : first + round(for_s * rate)] = values[first]
    return recording.assign({name: recording[name].copy(data=values)})


Spoil = Callable[[RigSpec, Plan, int], xr.Dataset]


def changed(rig: RigSpec, **factors: float) -> RigSpec:
    """Return a rig with some parameters (`part__name`) times a factor, its bounds notwithstanding."""
    for name, factor in factors.items():
        part, row = (getattr(rig, name.split("__")[0]), name.split("__")[1])
        parameter = getattr(part, row).model_copy(update={"value": getattr(part, row).value * factor})
        rig = rig.model_copy(update={name.split("__")[0]: part.model_copy(update={row: parameter})})
    return rig


def _of_rig(**factors: float) -> Spoil:
    return lambda rig, plan, seed: simulate(plan, changed(rig, **factors), seed=seed).assign_attrs(rig=dump_rig(rig))


def _of_data(change: Callable[[xr.Dataset], xr.Dataset]) -> Spoil:
    return lambda rig, plan, seed: change(simulate(plan, rig, seed=seed))


def _other_pretension(rig: RigSpec, plan: Plan, seed: int) -> xr.Dataset:
    shifted = plan.model_copy(update={"pretension": plan.pretension.model_copy(update={"pretension_mm": (2.0, 6.0)})})
    recording = simulate(shifted, rig, seed=seed)
    label = recording["pretension_mm"]
    return recording.assign(pretension_mm=label.copy(data=np.where(label == 6.0, 9.0, label)))


SPOILT: dict[str, tuple[Spoil, frozenset[str]]] = {
    "drive at 20 % PWM": (_of_rig(drive__duty_limit=0.2), frozenset({"lever", "saturation"})),
    "drive at 60 % PWM": (_of_rig(drive__duty_limit=0.6), frozenset({"lever", "saturation"})),
    "half the mass on the lever": (_of_rig(inertia__lever=0.5), frozenset({"torsion", "lever", "resonance"})),
    "gyro reads double": (_of_data(lambda r: scaled_gyro(r, 2.0)), frozenset({"torsion", "response"})),
    "gyro reads half": (_of_data(lambda r: scaled_gyro(r, 0.5)), frozenset({"torsion", "response"})),
    "gyro reversed": (_of_data(lambda r: scaled_gyro(r, -1.0)), frozenset({"phase"})),
    "gyro axes swapped": (_of_data(swapped_axes), frozenset({"axis"})),
    "gyro frozen": (_of_data(lambda r: frozen(r, "gyro_rad_s")), frozenset({"frozen"})),
    "accelerometer frozen": (_of_data(lambda r: frozen(r, "acceleration_m_s2")), frozenset({"frozen"})),
    "encoder frozen": (_of_data(lambda r: frozen(r, "drive_rad", 1.0)), frozenset({"frozen"})),
    "6 mm labelled 9 mm": (_other_pretension, frozenset({"pretension", "resonance", "response"})),
    "first contact missed": (
        _of_rig(tendons__first_contact_tension=0.05),
        frozenset({"resonance", "response"}),
    ),
    "guides dry": (_of_rig(tendons__guide_friction=4.0), frozenset({"damping"})),
}


def expected_of(plan: Plan, rig: RigSpec) -> str:
    quiet = Effects().without("sensor_noise", "stamp_jitter", "repeatability")
    return foretold(analyse_recording(simulate(plan, rig, effects=quiet), rig))


def doubts(recording: xr.Dataset, rig: RigSpec) -> list[dict[str, Any]]:
    return doubts_of(analyse_recording(recording, rig))


def good(seeds: int) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield what is doubted of good recordings: nothing should be."""
    for name, rig in rigs().items():
        for mode in MODES:
            for amplitude in (20.0, 6.0):
                plan = the_plan(mode, amplitude)
                expected = expected_of(plan, rig)
                for seed in range(seeds):
                    recording = simulate(plan, rig, seed=seed)
                    where = f"{name}, {mode}, {amplitude:g}°, seed {seed}"
                    yield where, doubts(recording, rig)
                    yield f"{where}, foretold", doubts(recording.assign_attrs(expected=expected), rig)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", choices=("good", "spoilt"))
    seeds, only = (lambda given: (given.seeds, given.only))(parser.parse_args())
    if only != "spoilt":
        count = alarms = 0
        for where, found in good(seeds):
            count += 1
            alarms += bool(found)
            for one in found:
                far = math.inf if one["distance"] is None else one["distance"]
                print(f"FALSE {where}: {one['kind']} {far:.1f}: {one['sentence']}", flush=True)
        print(f"good: {alarms} false alarms in {count} recordings", flush=True)
    if only == "good":
        return
    rig = load_rig("paper")
    for mode in MODES:
        plan = the_plan(mode)
        expected = expected_of(plan, rig)
        for name, (spoil, wanted) in SPOILT.items():
            for hint in ("", expected):
                hits, kinds = 0, Counter[str]()
                for seed in range(seeds):
                    told = {one["kind"] for one in doubts(spoil(rig, plan, seed).assign_attrs(expected=hint), rig)}
                    kinds.update(told)
                    hits += bool(told & wanted)
                counts = ", ".join(f"{kind} {n}" for kind, n in sorted(kinds.items())) or "nothing"
                print(f"{mode}, {name}{', foretold' if hint else ''}: {hits} of {seeds} ({counts})", flush=True)


if __name__ == "__main__":
    main()
