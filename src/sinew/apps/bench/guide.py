"""`sinew doctor --guide`: from an empty rig to a rig file and a first run, step by step with who is at the bench."""

import shlex
import socket
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinew.apps.bench.bench_run import on_signals, open_rig
from sinew.apps.console import print_json, remark, require_file

if TYPE_CHECKING:
    from sinew.bench.doctor import Finding
    from sinew.bench.guide.steps import Step
    from sinew.hardware.bus import Clock
    from sinew.hardware.rig import Rig as HardwareRig
    from sinew.plan.rig import RigSpec

FIRST_PLAN = "first"
"""What is proposed to be run behind the guide."""

_WORDS = {"ok": "  ok   ", "note": "  NOTE ", "warning": "  WARN ", "fault": "  FAULT"}
_HANDS_S = 5.0  # for an emulated bench to do what a person would


def guide(
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
    from sinew.bench.guide.steps import STEPS, Guide, lead
    from sinew.bench.stops import Steering
    from sinew.hardware.serial_port import find_latency_timer
    from sinew.measure.errors import SpecError, StoppedError
    from sinew.plan.toml import load_rig, save_rig

    names = [one.name for one in STEPS]
    for flag, name in (("--step", step), ("--from", start)):
        if name is not None and name not in names:
            raise SpecError(f"found {flag} {name}, expected one of {', '.join(names)}")
    if step is not None and start is not None:
        raise SpecError("found --step and --from, expected one of them: only that step, or all from that one on")
    if Path(port).is_socket():
        raise SpecError(f"{port} is a socket, which has no baud to set; leave --socket out of `sinew emulate`")
    require_file(out)
    spec = load_rig(out if out.exists() else rig)
    first = names.index(step or start or names[0])
    chosen = STEPS[first : first + 1] if step is not None else STEPS[first:]
    told: list[Finding] = []
    steering = Steering(lambda: 0.0)
    person = Asked(port, told, steering.check, yes=yes, loud=not json)
    notes: list[str] = []

    def keep(known: "RigSpec") -> None:
        notes[:] = [f"{note.subject}: {note.found}" for note in led.notes]
        save_rig(known.model_copy(update={"name": out.stem}), out, ["found by sinew doctor --guide", *notes])

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
                "findings": [
                    {
                        "severity": one.severity,
                        "subject": one.subject,
                        "found": one.found,
                        "expected": one.expected,
                        "what_to_do": one.advice,
                    }
                    for one in told
                ],
                "next": then,
            }
        )
        return 0 if well else 1
    if well:
        print(f"{out} describes this bench; no motor has torque")
        print(f"{'the first run' if is_last else 'go on with'}: {then}")
        return 0
    why = ended or f"the step {at} found a fault"
    kept = f"{out} has what was found so far" if out.exists() else "nothing was written"
    left = led.unconfirmed or "no motor has torque"
    remark(f"{why}; {left}; {kept}; go on with: {_again(then, at)}")
    return 1


def _next_words(port: str, out: Path, spec: "RigSpec", is_done: bool, words: Sequence[str]) -> str:
    if is_done:
        return shlex.join(["sinew", "run", FIRST_PLAN, "--rig", str(out), "--port", port, "--out", f"out/{out.stem}"])
    return shlex.join(["sinew", "doctor", "--port", port, "--guide", str(out), *words])


def _again(then: str, step: str) -> str:
    return f"{then} --from {step}" if step else then


class Asked:
    """The person at the terminal; on an emulated bench its hands do what is asked.

    told: takes what is found. check: raises where it is to end. yes: asks nobody, agrees to all, repeats nothing.
    loud: says on stdout what it is told. step: what it is at.
    """

    def __init__(self, port: str, told: "list[Finding]", check: Any, *, yes: bool, loud: bool) -> None:
        self._told, self._check, self._yes, self._loud = told, check, yes, loud
        hands = Path(port + ".hands")
        self._hands = hands if hands.is_socket() else None
        self.step = ""
        self._number = 0

    def begin(self, step: "Step") -> None:
        self.step = step.name
        self._say(f"\n{step.name}: {step.title}")

    def tell(self, finding: "Finding") -> None:
        self._told.append(finding)
        expected = f" (expected {finding.expected})" if finding.expected else ""
        advice = f"; {finding.advice}" if finding.advice else ""
        self._say(f"{_WORDS[finding.severity]} {finding.subject}: {finding.found}{expected}{advice}")

    def do(self, words: str, act: str) -> None:
        asked = f"  {words[0].upper()}{words[1:]}"
        if self._yes:
            self._say(asked)
        else:
            self._ask(f"{asked}, then press Enter: ")
        self._check()
        if self._hands is not None:
            _do_by_hands(self._hands, act)

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


def _do_by_hands(hands: Path, act: str) -> None:
    """Have an emulated bench's hands do something. Raises PortError where they do not answer, or cannot."""
    from sinew.measure.errors import PortError

    answer = b""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
        asking.settimeout(_HANDS_S)
        try:
            asking.connect(str(hands.resolve()))
            asking.sendall(act.encode() + b"\n")
            while not answer.endswith(b"\n") and (more := asking.recv(1024)):
                answer += more
        except OSError as trouble:
            raise PortError(f"the hands at {hands} do not answer ({trouble}); is the emulator running?") from trouble
    if answer != b"done\n":
        raise PortError(f"the hands at {hands} said {answer.decode(errors='replace').strip()!r}, expected done")
