"""This is where the options of `sinew track` become a plan, and what the rig is expected to do."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

from sinew.apps.options import HIGHEST_HZ, LARGEST_DEG, number_list
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.plan.plan import Held, Plan, Track
    from sinew.plan.rig import RigSpec
    from sinew.tune.expected import ExpectedBackbone

__all__ = ["tensions", "track_plan"]

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
    from sinew.tune.expected import expect_backbones
    from sinew.tune.planned import planned_tracker

    if hold not in _HELD:
        raise SpecError(f"--hold is {hold!r}, expected one of {', '.join(_HELD)}")
    amplitudes = _numbers(amplitude, ",", "--amplitude-deg")
    if not 0 < min(amplitudes) <= max(amplitudes) <= LARGEST_DEG:
        raise SpecError(f"--amplitude-deg is {amplitude}, expected positive angles up to {LARGEST_DEG:g}°")
    if start is not None and not 0 < start <= HIGHEST_HZ:
        raise SpecError(f"--start-hz is {start:g}, expected a positive frequency up to {HIGHEST_HZ:g} Hz")
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
    track: Track = _track(amplitudes, held, start, (low, high), seconds, stops[1] if moves else None, wanted)
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
    return number_list(option, text, f"numbers with {between!r} between them", between=between)


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
    if len(found) != 2 or min(found) <= 0 or max(found) > HIGHEST_HZ:
        raise SpecError(
            f"--follow-hz is {follow!r}, expected FROM:TO, two positive frequencies up to {HIGHEST_HZ:g} Hz"
        )
    return found[0], found[1]


def _track(
    amplitudes: Sequence[float],
    held: "Held",
    start: float | None,
    bounds: tuple[float, float],
    seconds: float,
    to_mm: float | None,
    wanted: tuple[float, float] | None,
) -> "Track":
    from sinew.plan.plan import Track

    return Track(
        amplitude_deg=tuple(amplitudes),
        held=held,
        start_hz=start,
        low_hz=bounds[0],
        high_hz=bounds[1],
        duration_s=seconds,
        pretension_to_mm=to_mm,
        wanted_hz=wanted,
    )


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
