"""`sinew track`: a joint kept in resonance, on a bench or on the emulated one."""

import json as jsonlib
import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sinew.apps import console
from sinew.apps.bench import bench_run
from sinew.apps.console import Json, Seed, flag, option
from sinew.measure.errors import FileError, SpecError

if TYPE_CHECKING:
    from sinew.hardware.bus import Clock
    from sinew.hardware.rig import Rig as HardwareRig
    from sinew.plan.plan import Held, Plan, Track
    from sinew.plan.rig import RigSpec
    from sinew.tune.track import ExpectedBackbone


def track(
    rig: Annotated[str, typer.Argument(metavar="[RIG]", help=console.RIG_HELP)] = "paper",
    port: Annotated[str | None, option("PORT", "Serial port of the bench.")] = None,
    emulate: Annotated[bool, flag("--emulate", "Instead: an emulated bench, in virtual time.")] = False,
    pretension: Annotated[
        str | None, option("MM,...|FROM:TO", "Pretensions, or one that moves; else 4.", "--pretension-mm")
    ] = None,
    amplitude: Annotated[str | None, option("DEG,...", "Amplitudes that are held; else 20.", "--amplitude-deg")] = None,
    hold: Annotated[
        str | None, option("command|lever|torsion", "Of what they are, half of peak to peak; else command.")
    ] = None,
    duration: Annotated[
        float | None, option("S", "Of each; else 10, moving 30.", "--duration-s", min=3.0, max=3600.0)
    ] = None,
    start: Annotated[
        float | None, option("HZ", "First drive frequency; else the expected one.", "--from-hz", min=0.1)
    ] = None,
    follow: Annotated[
        str | None, option("FROM:TO", "Move the pretension so that it resonates there.", "--follow-hz")
    ] = None,
    out: Annotated[Path, option("DIR", "Folder for journal, recording, figure.")] = Path("out/track"),
    fault: Annotated[list[str] | None, option("SPEC", "With --emulate: as of `sinew emulate`.")] = None,
    seed: Seed = 0,
    resume: Annotated[bool, flag("--resume", "Go on with the interrupted tracking in --out.")] = False,
    wait: bench_run.Wait = 0.0,
    json: Json = False,
) -> int:
    """Follow a resonance with a phase-locked loop.

    The torsion is held 90° behind the lever by moving the drive's frequency. At each pretension, and with each
    amplitude, that is a point of the backbone, in seconds instead of a sweep. With FROM:TO the pretension moves,
    within --duration-s, while the lock is kept. With --follow-hz a slower loop moves it within that range, or 0:12,
    so that the resonance follows a frequency.

    Samples, journal, limits and the end in the rig's safe state are those of `sinew run`. Motions that were cut off,
    by a killed process too, are measured with --resume; what was to be tracked is in the journal then, and not said
    again. Exit status: 0 complete, 1 stopped early, 2 refused before anything moved.
    """
    from sinew.plan.toml import load_rig

    _require_one_bench(port, emulate=emulate, has_faults=bool(fault))
    spec = load_rig(rig)
    bench_run.refuse_unfit_folder(out, resume)
    given_options = {
        "--pretension-mm": pretension,
        "--amplitude-deg": amplitude,
        "--hold": hold,
        "--duration-s": duration,
    }
    given_options |= {"--from-hz": start, "--follow-hz": follow}
    if resume:
        plan, expected = _begun_plan(out, given_options)
    else:
        plan, expected = track_plan(spec, pretension, amplitude or "20", hold or "command", duration, start, follow)
    where = ["--emulate", "--seed", str(seed)] if emulate else ["--port", str(port)]
    words = ["sinew", "track", rig, *where, *_options(given_options, fault or ()), "--out", str(out)]
    go_on = shlex.join(["sinew", "track", rig, *where, "--out", str(out), "--resume"])
    if port is not None:
        bench_run.await_port(port, wait)
    document = bench_run.run_plan(
        _emulated(spec, seed, fault or []) if port is None else bench_run.open_rig(port, spec),
        plan, spec, out, words, lambda: _needs(plan, spec, expected), resume=resume, is_virtual=port is None,
    )  # fmt: skip
    document |= found_tracks(document, plan, spec, expected)
    write_found(document, out)
    if json:
        console.print_json(document)
    else:
        print_found(document)
    if not document["complete"]:
        console.remark(f"{document['ended'] + '; ' if json else ''}go on with: {go_on}")
    return 0 if document["complete"] and document["is_safe"] else 1


def _begun_plan(folder: Path, given_options: Mapping[str, object]) -> "tuple[Plan, tuple[ExpectedBackbone, ...]]":
    """Return the plan of the tracking that was begun in a folder, and the backbones that were expected of it.

    Raises SpecError where options ask for another, FileError where the folder holds no tracking.
    """
    from sinew.analysis.tracked import BACKBONES_ATTRIBUTE
    from sinew.bench.record.journal import JournalReader
    from sinew.plan.toml import parse_plan
    from sinew.tune.track import ExpectedBackbone

    if given := [name for name, value in given_options.items() if value is not None]:
        raise SpecError(f"found {given[0]} beside --resume, which goes on with what was begun; leave it out")
    with JournalReader(folder / bench_run.JOURNAL) as journal:
        plan, backbones = parse_plan(journal.plan_toml), journal.attrs.get(BACKBONES_ATTRIBUTE)
    if plan.track is None or backbones is None:
        raise FileError(
            f"the journal in {folder} is not one that this `sinew track` can go on with: found "
            f"{'a plan without [track]' if plan.track is None else 'no predicted backbones in it'}; "
            f"{'go on by `sinew run --resume`' if plan.track is None else 'track anew in another folder'}"
        )
    return plan, tuple(ExpectedBackbone.from_json(row) for row in jsonlib.loads(str(backbones)))


def _require_one_bench(port: str | None, *, emulate: bool, has_faults: bool) -> None:
    if (port is None) is not emulate:
        raise SpecError("found both --port and --emulate, or neither; expected one of them: where is the bench?")
    if has_faults and not emulate:
        raise SpecError("found --fault with a real bench; faults are for --emulate")


def _options(given_options: Mapping[str, object], faults: Sequence[str]) -> list[str]:
    """Return the words of a command line that says what was asked."""
    options = [word for name, value in given_options.items() if value is not None for word in (name, str(value))]
    return options + [word for text in faults for word in ("--fault", text)]


@contextmanager
def _emulated(spec: "RigSpec", seed: int, faults: Sequence[str]) -> "Iterator[tuple[HardwareRig, Clock]]":
    from sinew.emulator.bench import VirtualPort, drawn_start, emulated_bench
    from sinew.emulator.faults import parse_fault

    found = [parse_fault(text) for text in faults]
    port = VirtualPort(emulated_bench(spec, drawn_start(spec, seed), seed, found))
    yield bench_run.rig_on(port, port, spec), port


def _needs(plan: "Plan", spec: "RigSpec", expected: "Sequence[ExpectedBackbone]") -> bench_run.Needs:
    """Return what the run of a plan that tracks needs."""
    from sinew.analysis.tracked import BACKBONES_ATTRIBUTE
    from sinew.tune.track import planned_tracker

    return bench_run.Needs(
        tensions(plan, spec),
        sum(group.duration_s for group in plan.groups()),
        law=lambda group, time: planned_tracker(group, plan, spec, expected, time),
        attrs={BACKBONES_ATTRIBUTE: jsonlib.dumps([one.to_json() for one in expected])},
    )


# The options of `sinew track` become a plan, and what the rig is expected to do.

_STAND_S, _MOVE_S = 10.0, 30.0
_BETWEEN_MM = 3.0
_FULL_MM = 12.0  # beyond it the paper's joint saturates
_LOW, _HIGH = 0.6, 1.5  # bounds of the frequency as shares of what is expected
_HELD = ("command", "lever", "torsion")
_LARGEST_DEG = 30.0  # of a command that is adjusted


def track_plan(
    rig: "RigSpec",
    pretension: str | None,
    amplitude: str,
    hold: str,
    duration: float | None,
    start: float | None,
    follow: str | None,
) -> "tuple[Plan, tuple[ExpectedBackbone, ...]]":
    """Return the plan that the options ask for, and the backbones that are expected, in rising pretension.

    Raises SpecError where an option cannot be meant, or a limit of the rig would be broken.
    """
    from sinew.plan.plan import Track
    from sinew.tune.track import expect_backbones, planned_tracker

    console.check_choice("--hold", hold, _HELD)
    amplitudes = _numbers(amplitude, ",", "--amplitude-deg")
    if not 0 < min(amplitudes) <= max(amplitudes) <= console.LARGEST_DEG:
        raise SpecError(f"--amplitude-deg is {amplitude}, expected positive angles up to {console.LARGEST_DEG:g}°")
    if start is not None and not 0 < start <= console.HIGHEST_HZ:
        raise SpecError(f"--start-hz is {start:g}, expected a positive frequency up to {console.HIGHEST_HZ:g} Hz")
    stops, moves = _stops(rig, pretension, follow)
    wanted = _wanted(follow)
    largest = max(amplitudes) if hold == "command" else _LARGEST_DEG
    expected = expect_backbones(rig, _grid(stops) if moves else sorted(set(stops)), largest)
    if wanted is not None:
        middle = 0.5 * (expected[0].frequency_hz[-1] + expected[-1].frequency_hz[-1])
        stops = sorted(stops) if wanted[0] < middle else sorted(stops, reverse=True)
    held = cast("Held", hold)
    modes = [one.mode(held, math.radians(deg)).frequency_hz for one in expected for deg in amplitudes]
    low, high = _LOW * min(modes), min(_HIGH * max(modes), rig.limits.drive_hz)
    if start is not None:
        low, high = min(low, start), max(high, start)
    seconds = duration if duration is not None else (_MOVE_S if moves else _STAND_S)
    track = Track(
        amplitude_deg=tuple(amplitudes),
        held=held,
        start_hz=start,
        low_hz=low,
        high_hz=high,
        duration_s=seconds,
        pretension_to_mm=stops[1] if moves else None,
        wanted_hz=wanted,
    )
    plan = _plan(stops[:1] if moves else stops, track)
    _refuse_beyond_limits(plan, rig, expected, held, amplitudes)
    for group in plan.groups():
        if group.kind == "tracking":
            planned_tracker(group, plan, rig, expected, 0.0)  # what cannot be tracked is said before anything moves
    return plan, expected


def tensions(plan: "Plan", rig: "RigSpec") -> dict[float, float]:
    """Return the tension of each tendon at rest [N] at every pretension that a plan visits [mm]."""
    from sinew.twin.simulate import rest_tension

    visited = list(plan.pretension.pretension_mm)
    if plan.track is not None and plan.track.pretension_to_mm is not None:
        visited.append(plan.track.pretension_to_mm)
    return dict(zip(visited, rest_tension(visited, rig).tolist(), strict=True))


def _numbers(text: str, between: str, option: str) -> list[float]:
    return console.number_list(option, text, f"numbers with {between!r} between them", between=between)


def _stops(rig: "RigSpec", pretension: str | None, follow: str | None) -> tuple[list[float], bool]:
    """Return the pretensions [mm], and whether they are the ends of a way."""
    if pretension is None:
        low, high = rig.limits.pretension_mm
        return ([4.0], False) if follow is None else ([low, min(_FULL_MM, high)], True)
    moves = ":" in pretension
    stops = _numbers(pretension, ":" if moves else ",", "--pretension-mm")
    if min(stops) < 0:
        raise SpecError(f"--pretension-mm holds {min(stops):g}, expected zero or more: cables cannot push")
    low, high = rig.limits.pretension_mm
    if max(stops) > high or min(stops) < low:
        raise SpecError(f"--pretension-mm is {pretension}, the rig allows {low:g} to {high:g} mm; stay between them")
    if moves and (len(stops) != 2 or stops[0] == stops[1]):
        raise SpecError(f"--pretension-mm is {pretension!r}, expected FROM:TO with two different numbers")
    if follow is not None and not moves:
        raise SpecError(f"--follow-hz needs room to move, found --pretension-mm {pretension}; expected FROM:TO")
    return stops, moves


def _grid(ends: Sequence[float]) -> list[float]:
    low, high = sorted(ends)
    count = max(1, math.ceil((high - low) / _BETWEEN_MM))
    return [low + (high - low) * i / count for i in range(count + 1)]


def _wanted(follow: str | None) -> tuple[float, float] | None:
    if follow is None:
        return None
    found = _numbers(follow, ":", "--follow-hz")
    if len(found) != 2 or min(found) <= 0 or max(found) > console.HIGHEST_HZ:
        raise SpecError(
            f"--follow-hz is {follow!r}, expected FROM:TO, two positive frequencies up to {console.HIGHEST_HZ:g} Hz"
        )
    return found[0], found[1]


def _plan(stops: Sequence[float], track: "Track") -> "Plan":
    from pydantic import ValidationError

    from sinew.plan.plan import Plan, Pretension

    try:
        return Plan(name="track", pretension=Pretension(pretension_mm=tuple(stops)), track=track)
    except ValidationError as error:
        raise SpecError(str(error.errors()[0]["msg"]).removeprefix("Value error, ")) from error


def _refuse_beyond_limits(
    plan: "Plan", rig: "RigSpec", expected: "Sequence[ExpectedBackbone]", held: "Held", amplitudes: Sequence[float]
) -> None:
    from sinew.plan.check import check_plan, refuse_beyond_limits
    from sinew.plan.plan import Pretension

    for mm, newton in tensions(plan, rig).items():
        there = plan.model_copy(update={"pretension": Pretension(pretension_mm=(mm,))})
        refuse_beyond_limits(check_plan(there, rig, [newton]))
    largest = math.radians(max(amplitudes))
    for one in expected:
        twist = max(amplitudes) if held == "torsion" else math.degrees(one.torsion_at(held, largest))
        if twist > rig.limits.torsion_deg:
            raise SpecError(
                f"in resonance at {one.pretension_mm:g} mm the head is expected to twist by {twist:.0f}°, the rig "
                f"allows {rig.limits.torsion_deg:g}°; lower --amplitude-deg"
            )


# What tracking found is printed: points of the backbone, how well the phase was held, how well followed.


def found_tracks(
    document: Mapping[str, Any], plan: "Plan", rig: "RigSpec", expected: "Sequence[ExpectedBackbone]"
) -> dict[str, Any]:
    """Return what the recording that a run's document names says of every tracked motion, as JSON holds it."""
    from sinew.analysis.tracked import Tracking, find_tracking
    from sinew.measure.files.netcdf import load_recording
    from sinew.measure.result import Rows

    if document["recording"] is not None:
        return find_tracking(load_recording(Path(document["recording"])), rig).to_dict()
    held = plan.track.held if plan.track is not None else None
    return Tracking(held, tuple(one.to_json() for one in expected), Rows()).to_dict()


def write_found(document: dict[str, Any], folder: Path) -> None:
    """Write track.json, and the figure of the tracked motions where there is one."""
    if not document["tracks"]:
        return
    from sinew.figures.tuned import save_tracking

    save_tracking(document, folder)
    console.write_json(document, folder / "track.json")


def print_found(document: dict[str, Any]) -> None:
    """Print how the run ended, and what was found."""
    from sinew.analysis.tracked import Tracking

    done = f"; {document['groups_done']} of {document['groups']} groups are recorded"
    print(f"{document['ended']}{'' if document['complete'] else done}")
    bench_run.print_pauses(document)
    print(document["left"])
    console.print_lines(Tracking.from_dict(document).blocks())
    print(document["recording"] or "no group is whole, so there is no recording")
