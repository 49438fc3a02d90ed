"""`sinew doctor`: the examination of a bench, and what to do about it; and the guide from an empty rig."""

import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps.bench.bench_run import Wait, await_port, on_signals, open_rig
from sinew.apps.console import Json, Rig, flag, option, print_json, remark, writable_file

if TYPE_CHECKING:
    from sinew.bench.doctor import Finding, Fix
    from sinew.bench.guide import Step
    from sinew.hardware.bus import Bus, Clock
    from sinew.hardware.ports import LatencyTimer
    from sinew.hardware.rig import Rig as HardwareRig
    from sinew.plan.rig import RigSpec


_LED = {"ok": "  ok   ", "note": "  NOTE ", "warning": "  WARN ", "fault": "  FAULT"}


def doctor(
    port: Annotated[
        str | None, option("PORT", "Serial port of the bench, or of `sinew emulate`; else the only one.", "--port")
    ] = None,
    rig: Rig = "paper",
    baud: Annotated[int | None, option("N", "Instead of the rig's.")] = None,
    fix: Annotated[bool, flag("--fix", "Write safe settings, after asking once.")] = False,
    yes: Annotated[bool, flag("--yes", "With --fix or --guide: ask nothing, agree to all.")] = False,
    guide: Annotated[
        Path | None, option("FILE", "Lead from an empty rig to FILE, a rig of this bench, step by step.", "--guide")
    ] = None,
    step: Annotated[str | None, option("NAME", "With --guide: only this step, again.", "--step")] = None,
    start: Annotated[str | None, option("NAME", "With --guide: from this step on.", "--from")] = None,
    wait: Wait = 0.0,
    json: Json = False,
) -> int:
    """Examine a bench: who answers, in what state, how fast.

    Each finding says what to do. Nothing moves and no torque is switched on. With --fix safe settings are written,
    to motors whose torque is off: return delay, answers, limits not wider than the rig's, no homing offset, the
    reboot of a motor that has shut down, and the latency timer of the adapter. Takes about 4 s. Exit status: 0 no
    fault, 1 a fault remains, 2 the port cannot be opened.

    With --guide motors move, a little and one at a time: steps devices (ids and bauds, motors plugged in one by one),
    settings, board, lever, tendons (which is which, and its sense), check. FILE holds what is found after
    every step, --rig what is not, as long as there is no FILE. Ctrl-C or the end of the input ends it at any moment;
    all motors are without torque then, as they are behind every step. Exit status: 0 all found, 1 ended early.
    """
    from sinew.bench.doctor import apply_fixes, list_fixes
    from sinew.hardware.ports import find_latency_timer
    from sinew.measure.errors import SpecError
    from sinew.plan.toml import load_rig

    if guide is None and (step is not None or start is not None):
        raise SpecError("found --step or --from without --guide, expected the rig file that the guide writes")
    if guide is not None and (fix or baud is not None):
        raise SpecError("found --fix or --baud with --guide, which sets bauds and settings itself; leave one out")
    port = port or _only_port()
    if guide is not None:
        await_port(port, wait)
        words = [] if rig == "paper" else ["--rig", rig]
        return _guide(port, rig, guide, step, start, yes=yes, json=json, words=[*words, *(["--yes"] if yes else [])])
    spec = load_rig(rig)
    used = _at_baud(spec, baud or spec.wiring.baud)
    await_port(port, wait)
    timer = find_latency_timer(port)
    findings = _examine(port, used, spec.wiring.baud, timer)
    written: list[Finding] = []
    if fix and (fixes := list_fixes(findings)) and _may_write(fixes, yes):
        with open_rig(port, used, own_time=True) as (bench, clock):
            written = apply_fixes(bench, clock, fixes, timer)
        findings = _examine(port, used, spec.wiring.baud, timer)
    if json:
        print_json(_document(port, used, findings, written))
    else:
        _print(findings, written)
    return 1 if any(finding.severity == "fault" for finding in findings) else 0


def _only_port() -> str:
    """Return the serial port of this computer where there is one alone. Raises PortError."""
    from sinew.hardware.ports import list_ports
    from sinew.measure.errors import PortError

    found = list_ports()
    if len(found) == 1:
        remark(f"the only serial port is {found[0]}")
        return found[0]
    ports = ", ".join(found) or "none"
    raise PortError(f"found {ports} as serial ports at USB, expected one; plug it in, or name it with --port")


def _at_baud(spec: "RigSpec", baud: int) -> "RigSpec":
    return spec.model_copy(update={"wiring": spec.wiring.model_copy(update={"baud": baud})})


def _examine(port: str, spec: "RigSpec", wiring_baud: int, timer: "LatencyTimer | None") -> "list[Finding]":
    """Return all findings; the port is closed in between where other bauds must be tried."""
    from sinew.bench.doctor import call_roll, examine_port, examine_present, search_bauds
    from sinew.hardware.ports import is_ftdi

    findings = examine_port(timer, spec.wiring.baud, wiring_baud, of_ftdi=is_ftdi(port))
    with open_rig(port, spec, own_time=True) as (bench, clock):
        roll = call_roll(bench)
        findings += roll.findings
        if roll.present:
            findings += examine_present(bench, clock, roll)
    if roll.missing:

        @contextmanager
        def open_bus(baud: int) -> "Iterator[Bus]":
            with open_rig(port, _at_baud(spec, baud), own_time=True) as (other, _clock):
                yield other.bus

        remark("not every device answers; looking at the other bauds")
        findings += search_bauds(open_bus, spec.wiring.baud, nobody=not roll.present)
    return findings


def _may_write(fixes: "Sequence[Fix]", yes: bool) -> bool:
    """Return whether the user agrees to the settings listed. Raises SpecError where nobody can be asked."""
    from sinew.measure.errors import SpecError

    for fix in fixes:
        remark(str(fix))
    if yes:
        return True
    if not sys.stdin.isatty():
        raise SpecError("found no terminal to ask on before settings are written; add --yes to --fix")
    return typer.confirm(f"write {len(fixes)} settings to motors whose torque is off?", err=True)


def _document(
    port: str, spec: "RigSpec", findings: "Sequence[Finding]", written: "Sequence[Finding]"
) -> dict[str, Any]:
    return {
        "rig": spec.name,
        "port": port,
        "baud": spec.wiring.baud,
        "ok": all(finding.severity != "fault" for finding in findings),
        "findings": [_row(finding) for finding in findings],
        "written": [_row(finding) for finding in written],
    }


def _row(finding: "Finding") -> dict[str, Any]:
    return {
        "severity": finding.severity,
        "subject": finding.subject,
        "found": finding.found,
        "expected": finding.expected,
        "what_to_do": finding.advice,
        "fixable": finding.fixable,
    }


def _print(findings: "Sequence[Finding]", written: "Sequence[Finding]") -> None:
    for title, rows in (("written", written), ("findings", findings)):
        if rows:
            print(title)
        for row in _same_together(rows):
            print(f"{_LED[row.severity]} {row}")
    faults = sum(finding.severity == "fault" for finding in findings)
    fixable = sum(finding.fixable for finding in findings)
    warnings = sum(finding.severity == "warning" for finding in findings)
    more = f"; --fix would put {fixable} of them right" if fixable and not written else ""
    print(f"{_many(faults, 'fault')}, {_many(warnings, 'warning')}{more}")


def _many(count: int, word: str) -> str:
    return f"{count or 'no'} {word}{'' if count == 1 else 's'}"


def _same_together(findings: "Sequence[Finding]") -> "list[Finding]":
    """Return equal findings as one with all their subjects, in the order of first mention."""
    together: dict[Finding, list[str]] = {}
    for row in findings:
        together.setdefault(replace(row, subject="", fix=None), []).append(row.subject)
    return [replace(row, subject=", ".join(subjects)) for row, subjects in together.items()]


# ---- `sinew doctor --guide`: from an empty rig to a rig file and a first run, step by step with who is at the bench


FIRST_PLAN = "first"
"""What is proposed to be run behind the guide."""


def _guide(
    port: str,
    rig: str,
    out: Path,
    step: str | None,
    start: str | None,
    *,
    yes: bool,
    json: bool,
    words: Sequence[str] = (),
) -> int:
    """Lead through the steps; return 0 where all ended well, 1 where one did not or the person broke off.

    rig: to begin with, where there is no file yet. out: the rig file. step: only this one. start: from this one on.
    yes: ask nobody. words: of the command line, for who goes on. Raises SinewError where nothing can begin.
    """
    from sinew.bench.guide import STEPS, Guide, lead
    from sinew.bench.stops import Steering
    from sinew.hardware.ports import find_latency_timer
    from sinew.measure.errors import SpecError, StoppedError
    from sinew.plan.toml import load_rig, read_spec, save_rig

    names = [one.name for one in STEPS]
    for word, name in (("--step", step), ("--from", start)):
        if name is not None and name not in names:
            raise SpecError(f"found {word} {name}, expected one of {', '.join(names)}")
    if step is not None and start is not None:
        raise SpecError("found --step and --from, expected one of them: only that step, or all from that one on")
    writable_file(out)  # the guide goes on from what it found before
    spec = load_rig(out if out.exists() else rig)
    first = names.index(step or start or names[0])
    chosen = STEPS[first : first + 1] if step is not None else STEPS[first:]
    collected: list[Finding] = []
    steering = Steering(lambda: 0.0)
    person = Person(port, collected, steering.check, yes=yes, loud=not json)
    notes: list[str] = []

    def keep(known: "RigSpec") -> None:
        notes[:] = [f"{note.subject}: {note.found}" for note in led.notes]
        head = ["found by sinew doctor --guide", *notes]
        like = read_spec("rigs", out) if out.exists() else ""
        save_rig(known.model_copy(update={"name": out.stem}), out, head, like)

    @contextmanager
    def opened(known: "RigSpec") -> "Iterator[tuple[HardwareRig, Clock]]":
        # A signal that comes while the port is open waits for the next cycle: what has torque loses it first.
        with on_signals(steering.request_stop), open_rig(port, known) as there:
            yield there
        steering.check()

    with open_rig(port, spec, own_time=True):
        pass  # a port that is not there is no fault of a step
    led = Guide(opened, person, spec, keep, steering.check, find_latency_timer(port))
    try:
        well, ended = lead(led, chosen), ""
    except StoppedError as reason:
        well, ended = False, str(reason)
    except (EOFError, KeyboardInterrupt) as reason:
        well, ended = False, "interrupted by Ctrl-C" if isinstance(reason, KeyboardInterrupt) else "the input ended"
    at = person.step
    is_last = well and chosen[-1].name == names[-1]
    then = _next_words(port, out, led.spec, is_last, words)
    if well and not is_last:
        then = _again(then, names[first + 1])
    if json:
        print_json(
            {
                "port": port,
                "rig": str(out) if out.exists() else None,
                "ok": well,
                "ended": ended,
                "step": at,
                "findings": [_row(one) for one in collected],
                "next": then,
            }
        )
        return 0 if well else 1
    if well:
        print(f"{out} describes this bench; no motor has torque")
        print(f"{'the first run' if is_last else 'go on with'}: {then}")
        return 0
    why = ended or f"the step {at} found a fault"
    stored = f"{out} has what was found so far" if out.exists() else "nothing was written"
    left = led.unconfirmed or "no motor has torque"
    remark(f"{why}; {left}; {stored}; go on with: {_again(then, at)}")
    return 1


def _next_words(port: str, out: Path, spec: "RigSpec", is_done: bool, words: Sequence[str]) -> str:
    if is_done:
        return shlex.join(["sinew", "run", FIRST_PLAN, "--rig", str(out), "--port", port, "--out", f"out/{out.stem}"])
    return shlex.join(["sinew", "doctor", "--port", port, "--guide", str(out), *words])


def _again(then: str, step: str) -> str:
    return f"{then} --from {step}" if step else then


class Person:
    """The person at the terminal; an emulated bench that shares its clock does itself what is asked.

    collected: takes what is found. check: raises where it is to end. yes: asks nobody, agrees to all, repeats nothing.
    loud: says on stdout what it is told. step: what it is at.
    """

    def __init__(self, port: str, collected: "list[Finding]", check: Any, *, yes: bool, loud: bool) -> None:
        self._port, self._collected, self._check, self._yes, self._loud = port, collected, check, yes, loud
        self.step = ""

    def begin(self, step: "Step") -> None:
        self.step = step.name
        self._say(f"\n{step.name}: {step.title}")

    def tell(self, finding: "Finding") -> None:
        self._collected.append(finding)
        self._say(f"{_LED[finding.severity]} {finding}")

    def do(self, words: str, act: int) -> None:
        from sinew.hardware.ports import shared_clock

        question = f"  {words[0].upper()}{words[1:]}"
        if self._yes:
            self._say(question)
        else:
            self._ask(f"{question}, then press Enter: ")
        self._check()
        if (clock := shared_clock(self._port)) is not None:
            with closing(clock):
                clock.do(act)

    def agrees(self, question: str) -> bool:
        return self._yes or self._ask(f"  {question[0].upper()}{question[1:]}? [Y/n] ").lower() in ("", "y", "yes")

    def repeats(self, what: str, failed: bool) -> bool:
        from sinew.measure.errors import StoppedError

        self._check()
        if self._yes:
            return False
        if not failed:
            answer = self._ask(f"  {what} is done: Enter goes on, r repeats it, q ends: ").lower()
        else:
            answer = self._ask(f"  {what} has a fault: Enter or r repeats it, q ends: ").lower() or "r"
        if answer.startswith("q"):
            raise StoppedError("ended by q")
        return answer.startswith("r")

    def _ask(self, question: str) -> str:
        self._check()
        print(question, end="", file=sys.stdout if self._loud else sys.stderr, flush=True)
        line = sys.stdin.readline()
        if not line:
            print(file=sys.stdout if self._loud else sys.stderr)
            raise EOFError
        return line.strip()

    def _say(self, sentence: str) -> None:
        if self._loud:
            print(sentence, flush=True)
