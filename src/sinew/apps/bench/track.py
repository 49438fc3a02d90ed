"""`sinew track`: a joint kept in resonance, on a bench or on the emulated one."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sinew.apps import console
from sinew.apps.bench import bench_run
from sinew.apps.bench.run_control import keeping_time, listening, showing
from sinew.apps.console import Json, Seed, flag, option
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import finite, fixed, number, pair, shown

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sinew.hardware.bus import Clock
    from sinew.hardware.rig import Rig as HardwareRig
    from sinew.plan.plan import Held, Plan, Track
    from sinew.plan.rig import RigSpec
    from sinew.tune.track import ExpectedBackbone


Bench = AbstractContextManager["tuple[HardwareRig, Clock]"]


def track(
    rig: Annotated[str, typer.Argument(metavar="[RIG]", help=console.RIG_HELP)] = "paper",
    port: Annotated[str | None, option("PORT", "Serial port of the bench.")] = None,
    emulate: Annotated[bool, flag("--emulate", "Instead: an emulated bench, in virtual time.")] = False,
    pretension: Annotated[
        str | None, option("MM,...|FROM:TO", "Pretensions, or one that moves; else 4.", "--pretension-mm")
    ] = None,
    amplitude: Annotated[str, option("DEG,...", "Amplitudes that are held.", "--amplitude-deg")] = "20",
    hold: Annotated[str, option("command|lever|torsion", "Of what they are: half of peak to peak.")] = "command",
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
    wait: bench_run.Wait = 0.0,
    json: Json = False,
) -> int:
    """Hold the torsion 90° behind the lever: a phase-locked loop moves the drive's frequency.

    At each pretension, and with each amplitude, that is a point of the backbone, in seconds instead of a sweep. With
    FROM:TO the pretension moves, within --duration-s, while the lock is kept. With --follow-hz a slower loop moves it
    within that range, or 0:12, so that the resonance follows a frequency.

    Samples, journal, limits and the end in the rig's safe state are those of `sinew run`. Exit status: 0 complete, 1
    stopped early, 2 refused before anything moved.
    """
    from sinew.plan.toml import load_rig

    _require_one_bench(port, emulate=emulate, has_faults=bool(fault))
    spec = load_rig(rig)
    bench_run.refuse_unfit_folder(out, resume=False)
    plan, expected = track_plan(spec, pretension, amplitude, hold, duration, start, follow)
    where = ["--emulate", "--seed", str(seed)] if emulate else ["--port", str(port)]
    asked = {"--pretension-mm": pretension, "--amplitude-deg": amplitude, "--hold": hold, "--duration-s": duration}
    asked |= {"--from-hz": start, "--follow-hz": follow}
    words = ["sinew", "track", rig, *where, *_options(asked, fault or ()), "--out", str(out)]
    with ExitStack() as stack:
        bench = _emulated(spec, seed, fault or []) if port is None else _real(port, spec, wait)
        document = _run(bench, plan, spec, expected, out, words, stack, virtual=port is None)
    document |= found_tracks(document, plan, spec, expected)
    write_found(document, out)
    if json:
        console.print_json(document)
    else:
        print_found(document)
    return 0 if document["complete"] and document["is_safe"] else 1


def _require_one_bench(port: str | None, *, emulate: bool, has_faults: bool) -> None:
    if (port is None) is not emulate:
        raise SpecError("found both --port and --emulate, or neither; expected one of them: where is the bench?")
    if has_faults and not emulate:
        raise SpecError("found --fault with a real bench; faults are for --emulate")


def _options(asked: Mapping[str, object], faults: Sequence[str]) -> list[str]:
    """Return the words of a command line that says what was asked."""
    options = [word for name, value in asked.items() if value is not None for word in (name, str(value))]
    return options + [word for text in faults for word in ("--fault", text)]


@contextmanager
def _real(port: str, spec: "RigSpec", wait: float) -> "Iterator[tuple[HardwareRig, Clock]]":
    bench_run.await_port(port, wait)
    with bench_run.open_rig(port, spec) as bench:
        yield bench


@contextmanager
def _emulated(spec: "RigSpec", seed: int, faults: Sequence[str]) -> "Iterator[tuple[HardwareRig, Clock]]":
    from sinew.emulator.faults import parse_fault
    from sinew.emulator.found import VirtualPort, drawn_start, found_bench

    found = [parse_fault(text) for text in faults]
    port = VirtualPort(found_bench(spec, drawn_start(spec, seed), seed, found))
    yield bench_run.rig_on(port, port, spec), port


def _run(
    bench: Bench,
    plan: "Plan",
    spec: "RigSpec",
    expected: "Sequence[ExpectedBackbone]",
    out: Path,
    words: Sequence[str],
    signals: ExitStack,
    *,
    virtual: bool,
) -> dict[str, Any]:
    """Run a plan that tracks and return how it ended, as JSON holds it."""
    from sinew.bench.preflight import refuse_unready
    from sinew.bench.run import Runner
    from sinew.bench.stops import Steering
    from sinew.tune.track import planned_tracker

    held = tensions(plan, spec)
    bench_run.refuse_full_disk(out, plan, sum(group.duration_s for group in plan.groups()))
    with bench as (rig, clock), listening(out, steering := Steering(clock.now, can_pause=False)) as control:
        refuse_unready(rig, clock, plan)
        pace = nullcontext() if virtual else keeping_time()
        told = {"source": bench_run.source_of(rig)}
        with (
            pace,
            bench_run.run_journal(out, plan, spec, words, False, **told) as journal,
            showing(tracking=True) as screen,
        ):
            runner = control.runner = Runner(
                rig,
                clock,
                plan,
                journal,
                held,
                listener=screen,
                steering=steering,
                law=lambda group, time: planned_tracker(group, plan, spec, expected, time),
            )
            signals.enter_context(bench_run.on_signals(steering.request_stop, steering.request_emergency))
            report = runner.run()
            bench_run.close_journal(journal, report)
    recording = bench_run.convert_journal(out, report)
    document = bench_run.run_document(report, plan, spec, recording, out / bench_run.JOURNAL)
    document["laws"] = [report.tracks[index] for index in sorted(report.tracks)]
    return document


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


# What tracking found is told: points of the backbone, how well the phase was held, how well followed.

_DIGITS = {"time_s": 4, "frequency_hz": 5, "phase_error_deg": 3, "lever_deg": 3, "torsion_deg": 3, "pretension_mm": 3}


def found_tracks(
    document: dict[str, Any], plan: "Plan", rig: "RigSpec", expected: "Sequence[ExpectedBackbone]"
) -> dict[str, Any]:
    """Return what the recording that a run's document names says of every tracked motion, as JSON holds it."""
    import numpy as np

    from sinew.analysis.tracked import tracked_turns
    from sinew.measure.files.netcdf import load_recording

    laws, tracks = document.pop("laws"), []
    if document["recording"] is not None and laws:
        recording = load_recording(Path(document["recording"]))
        segments = np.flatnonzero(recording["kind"].values == "tracking")
        for segment, law in zip(segments.tolist(), laws, strict=False):
            turns = tracked_turns(recording, segment, rig)
            amplitude = float(recording["amplitude_deg"].values[segment])
            columns = {str(name): turns[name].values for name in turns}
            for name in ("phase_error", "lever", "torsion"):
                columns[f"{name}_deg"] = np.degrees(columns.pop(f"{name}_rad"))
            track: dict[str, Any] = {
                "pretension_mm": float(recording["pretension_mm"].values[segment]),
                "amplitude_deg": amplitude,
                "lock_cycles": law.lock_cycles,
                "lock_losses": law.lock_losses,
                "phase_error_deg": _held_error(columns, law.lock_cycles),
                "point": None,
                "follow": None,
            }
            if plan.track is not None and plan.track.pretension_to_mm is None:
                track["point"] = _point(turns, rig, expected)
            elif plan.track is not None and plan.track.wanted_hz is not None:
                track["follow"] = _followed(columns, plan)
            track["turns"] = {name: np.round(columns[name], digits).tolist() for name, digits in _DIGITS.items()}
            tracks.append(track)
    held = plan.track.held if plan.track is not None else None
    return {"held": held, "expected": [_expected(one) for one in expected], "tracks": tracks}


def _held_error(columns: "dict[str, NDArray[np.float64]]", lock_cycles: float | None) -> float | None:
    """Return the root mean square of the phase error from the lock on [deg]; the lock itself counts two turns more."""
    import numpy as np

    if lock_cycles is None:
        return None
    held = columns["phase_error_deg"][int(lock_cycles) + 2 :]
    return float(np.sqrt(np.mean(held**2))) if held.size else None


def _point(turns: Any, rig: "RigSpec", expected: "Sequence[ExpectedBackbone]") -> dict[str, Any] | None:
    from sinew.analysis.tracked import tracked_point

    try:
        point = tracked_point(turns, rig)
    except RecordingError:
        return None
    near = min(expected, key=lambda one: abs(one.pretension_mm - point.pretension_mm))
    return {
        "pretension_mm": point.pretension_mm,
        "frequency_hz": point.frequency_hz.to_json(),
        "torsion_deg": point.torsion_deg.to_json(),
        "lever_deg": point.lever_deg.to_json(),
        "damping_ratio": point.damping_ratio.to_json(),
        "phase_error_deg": point.phase_error_deg,
        "turns": point.turns,
        "predicted_hz": finite(near.frequency_at(math.radians(point.torsion_deg.value))),
    }


def _followed(columns: "dict[str, NDArray[np.float64]]", plan: "Plan") -> dict[str, float]:
    """Return how far the resonance was from the wanted frequency while that moved."""
    import numpy as np

    track = plan.track
    assert track is not None
    assert track.wanted_hz is not None
    times = (track.lead_s, track.lead_s + track.duration_s)
    time, hertz = columns["time_s"], columns["frequency_hz"]
    moving = (time >= times[0]) & (time <= times[1])
    off = (hertz - np.interp(time, times, track.wanted_hz))[moving]
    return {
        "from_hz": track.wanted_hz[0],
        "to_hz": track.wanted_hz[1],
        "begin_s": track.lead_s,
        "duration_s": track.duration_s,
        "rms_error_hz": float(np.sqrt(np.mean(off**2))),
        "largest_error_hz": float(np.abs(off).max()),
    }


def _expected(one: "ExpectedBackbone") -> dict[str, Any]:
    import numpy as np

    return {
        "pretension_mm": one.pretension_mm,
        "frequency_hz": one.frequency_hz.tolist(),
        "torsion_deg": np.degrees(one.torsion).tolist(),
        "lever_deg": np.degrees(one.lever).tolist(),
        "command_deg": np.degrees(one.command).tolist(),
        "damping_ratio": one.damping_ratio.tolist(),
    }


def write_found(document: dict[str, Any], folder: Path) -> None:
    """Write track.json, and the figure of the tracked motions where there is one."""
    if not document["tracks"]:
        return
    from sinew.figures.style import save_figure
    from sinew.figures.tuned import draw_tracking

    save_figure(draw_tracking(document["tracks"], document["expected"]), folder, "tracking", ("png", "pdf"))
    console.write_json(document, folder / "track.json")


def print_found(document: dict[str, Any]) -> None:
    """Print how the run ended, and what was found."""
    done = f"; {document['groups_done']} of {document['groups']} groups are recorded"
    print(f"{document['ended']}{'' if document['complete'] else done}")
    print(document["left"])
    tracks = document["tracks"]
    if any(track["point"] is not None for track in tracks):
        columns = (
            "pretension/mm",
            "held/°",
            "resonance/Hz",
            "predicted/Hz",
            "torsion/°",
            "lever/°",
            "damping",
            "lock/turns",
            "error/°",
        )
        rows = [_row(track) for track in tracks if track["point"] is not None]
        console.print_table(columns, rows, f"the torsion lags the lever by 90°; amplitude held: {document['held']}")
    for track in tracks:
        if track["point"] is None:
            print(_moved(track))
    print(document["recording"] or "no group is whole, so there is no recording")


def _row(track: dict[str, Any]) -> tuple[str, ...]:
    point = track["point"]
    half = 0.5 * (point["frequency_hz"]["interval90"][1] - point["frequency_hz"]["interval90"][0])
    predicted = point["predicted_hz"]
    return (
        f"{track['pretension_mm']:g}",
        f"{track['amplitude_deg']:g}",
        pair(point["frequency_hz"]["value"], half),
        number(predicted),
        *(shown(point[name]) for name in ("torsion_deg", "lever_deg", "damping_ratio")),
        fixed(track["lock_cycles"], 1),
        number(point["phase_error_deg"], 2),
    )


def _moved(track: dict[str, Any]) -> str:
    turns = track["turns"]
    lock = "never locked" if track["lock_cycles"] is None else f"locked after {fixed(track['lock_cycles'], 1)} turns"
    lost = f"lost {track['lock_losses']:.0f} times" if track["lock_losses"] else "never lost"
    error = (
        ""
        if track["phase_error_deg"] is None
        else f", phase error {number(track['phase_error_deg'], 2)}° (root mean square)"
    )
    way = (
        f"{number(turns['pretension_mm'][0], 3)} to {number(turns['pretension_mm'][-1], 3)} mm, "
        f"{number(turns['frequency_hz'][0])} to {number(turns['frequency_hz'][-1])} Hz"
    )
    follow = track["follow"]
    after = (
        ""
        if follow is None
        else (
            f"; followed {follow['from_hz']:g} to {follow['to_hz']:g} Hz in {follow['duration_s']:g} s to within "
            f"{number(follow['rms_error_hz'], 2)} Hz (root mean square), "
            f"{number(follow['largest_error_hz'], 2)} Hz at most"
        )
    )
    return f"{way}: {lock}, {lost}{error}{after}"
