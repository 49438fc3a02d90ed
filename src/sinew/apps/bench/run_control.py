"""The control socket of a run: it listens there to whoever steers it, and is spoken to there; its line on the screen.

DIR/control holds the socket's path; the socket lies in a folder that only its owner may enter. One line of JSON each
way: {"command": ..., "folder": [device, inode]} and {"ok": ..., "sentence": ..., "state": {...}}. A folder may be
planted by others, or copied with all that lies in it. So the file, the socket and its folder must be our own, and a run
carries out what is meant for its folder alone.
"""

import gc
import json
import os
import shutil
import socket
import socketserver
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, cast

from sinew.apps.console import progress_bar, remark
from sinew.measure.errors import FileError, SinewError
from sinew.measure.events import Ended, Event, Health, Track

if TYPE_CHECKING:
    from sinew.bench.run import Runner
    from sinew.bench.stops import Steering


COMMANDS = ("pause", "resume", "hold", "release", "stop", "emergency", "status")
"""What a run can be told."""

CONTROL = "control"
"""Name of the file in a run's folder that says where it listens."""

_MOST_BYTES = 4096
_PATIENCE_S = 0.2  # for a client that says nothing, or reads nothing
_LOOK_S = 0.05  # until the server of commands sees that its run is over
_WRITTEN_S = 2.0  # for what waits to be shown at the end
_FROZEN_S = 0.12  # whoever asks for an emergency stop acts himself after 0.15 s
_LONGEST_PATH = 100  # a Unix socket's has at most 107 bytes
_PREFIX = "sinew-"
_REASONS = {"stop": "stopped", "hold": "stopped, to hold,", "release": "stopped, to release,"}


class ControlError(SinewError):
    """Nobody listens there, or no proper answer came."""


def send_control(folder: Path, command: str, timeout_s: float = 0.5) -> dict[str, Any]:
    """Return what the run in a folder answers to a command: ok, sentence, state.

    command: one of `COMMANDS`. timeout_s: for connecting, and for the answer [s].
    Raises ControlError where nobody listens, who listens is not ours or runs in another folder, or no answer comes in
    time.
    """
    try:
        where = _own_socket(own_text(folder / CONTROL))
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
            line.settimeout(timeout_s)
            line.connect(where)
            message = {"command": command, "folder": _folder_id(folder)}
            line.sendall(json.dumps(message).encode() + b"\n")
            with line.makefile("rb") as answered:
                answer = json.loads(answered.readline(_MOST_BYTES))
    except (OSError, ValueError) as error:
        raise ControlError(
            f"no run in {folder} answers to {command} ({error}); see whether it goes on, else `sinew stop`"
        ) from error
    if not isinstance(answer, dict):
        raise ControlError(f"the run in {folder} answered {answer!r} to {command}, expected an object")
    if answer.get("elsewhere") is True:
        raise ControlError(f"no run in {folder} answers to {command}: its {CONTROL} leads to a run in another folder")
    return answer


def own_text(file: Path) -> str:
    """Return what a small file of ours says. Raises OSError for a link, another's file, and what is no file."""
    with os.fdopen(os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as opened:
        about = os.fstat(opened.fileno())
        if not stat.S_ISREG(about.st_mode) or about.st_uid != os.geteuid():
            raise PermissionError(f"{file} is not a file of our own")
        return opened.read(_MOST_BYTES).decode("utf-8", "replace")


def _own_socket(where: str) -> str:
    """Return the path of a run's socket; raises OSError where it cannot be one that `listening` made for us."""
    path = Path(where)
    folder, about = path.parent.lstat(), path.lstat()
    is_private = stat.S_ISDIR(folder.st_mode) and not folder.st_mode & (stat.S_IRWXG | stat.S_IRWXO)
    if not (is_private and stat.S_ISSOCK(about.st_mode) and {folder.st_uid, about.st_uid} == {os.geteuid()}):
        raise PermissionError(f"{where[:200]} is no socket of a run of our own")
    return where


def _folder_id(folder: Path) -> list[int]:
    """Return what tells a folder from every other, by whatever path: device and inode."""
    about = folder.stat()
    return [about.st_dev, about.st_ino]


class RunControl:
    """Carries out commands. steering: of the run. runner: of which the state is told, once there is one."""

    def __init__(self, steering: "Steering") -> None:
        self._steering = steering
        self.runner: Runner | None = None

    def state(self) -> dict[str, Any]:
        """Return what the run is at; pid: of its process."""
        steering, at = self._steering, self.runner.at if self.runner is not None else None
        document: dict[str, Any] = {"state": "preparing", "done_s": 0.0, "total_s": None, "group": None, "groups": None}
        if at is not None:
            newest = at.newest_s
            document = {
                "state": at.state,
                "done_s": round(at.done_s(newest), 2),
                "total_s": round(at.total_s, 2),
                "group": at.group,
                "groups": at.groups,
            }
        halt, stopped = steering.halt, steering.stopped
        document |= {
            "pid": os.getpid(),
            "begun": steering.has_begun,
            "pause_asked": steering.pause_requested,
            "ending": halt.reason if halt is not None else None,
            "frozen": sorted(stopped.frozen) if stopped is not None else None,
            "frozen_ms": round(1e3 * stopped.frozen_s, 1) if stopped is not None else None,
        }
        return document

    def carry_out(self, command: str) -> dict[str, Any]:
        """Carry out a command and return the answer to it."""
        act = {"pause": self._pause, "resume": self._resume, "emergency": self._emergency, "status": self._status}
        if command in _REASONS:
            ok, sentence = self._stop(command)
        elif command in act:
            ok, sentence = act[command]()
        else:
            ok, sentence = False, f"found command {command!r}, expected one of {', '.join(COMMANDS)}"
        return {"ok": ok, "sentence": sentence, "state": self.state()}

    def _status(self) -> tuple[bool, str]:
        return True, f"the run is {self.state()['state']}"

    def _pause(self) -> tuple[bool, str]:
        if not self._steering.can_pause:
            return False, "a run that tracks a resonance does not pause; stop it, or let it end"
        if self._is_ending():
            return False, "the run is ending, so it cannot pause"
        self._steering.request_pause()
        return True, "the run pauses after the segment under way"

    def _resume(self) -> tuple[bool, str]:
        was_asked = self._steering.pause_requested
        self._steering.request_resume()
        return was_asked, "the run goes on" if was_asked else "the run has no pause to end"

    def _stop(self, command: str) -> tuple[bool, str]:
        if self._is_ending():
            return False, "the run is ending already"
        state: Mapping[str, Any] = {"hold": "hold", "release": "release"}
        self._steering.request_stop(f"{_REASONS[command]} by the operator", state.get(command))
        return (
            True,
            "the run ends at its next cycle" if self._steering.has_begun else "nothing moves; it will not start",
        )

    def _emergency(self) -> tuple[bool, str]:
        began = time.monotonic()
        self._steering.request_emergency("emergency stop by the operator")
        if not self._steering.has_begun:
            return True, "nothing has moved, and the run will not start"
        stopped = self._steering.await_frozen(_FROZEN_S)
        took = f"{1e3 * (time.monotonic() - began):.0f} ms after the request"
        if stopped is None:
            return False, f"no motor has confirmed that it stands, {took}; switch the supply off"
        if stopped.port_lost or self._steering.is_over:
            return stopped.is_safe, stopped.sentence()
        if self.runner is not None and len(stopped.frozen) < self.runner.motors:
            return False, f"only {', '.join(sorted(stopped.frozen)) or 'no motor'} stand, {took}"
        return True, f"all motors stand, {took}"

    def _is_ending(self) -> bool:
        return self._steering.halt is not None or self._steering.stopped is not None


@contextmanager
def listening(folder: Path, steering: "Steering") -> Iterator[RunControl]:
    """Have the run in a folder take commands, and give what carries them out; afterwards nothing of it is left.

    Raises FileError where another run listens there, or the folder cannot be written.
    """
    control, made = (
        RunControl(steering),
        [folder_id for folder_id in (folder, *folder.parents) if not folder_id.exists()],
    )
    if os.path.lexists(folder / CONTROL):
        _refuse_other(folder)
    private = _private_folder()
    try:
        with _Server(private / CONTROL, control.carry_out) as server:
            _announce(folder, private / CONTROL)
            server.folder_id = _folder_id(folder)
            threading.Thread(target=server.serve_forever, args=(_LOOK_S,), name="control", daemon=True).start()
            try:
                yield control
            finally:
                server.shutdown()
    finally:
        with suppress(OSError):
            (folder / CONTROL).unlink()
        shutil.rmtree(private, ignore_errors=True)
        with suppress(OSError):  # of a run that was refused nothing is left
            for folder_id in made:
                folder_id.rmdir()


def _refuse_other(folder: Path) -> None:
    """Raise FileError where a run listens in a folder; of one that was killed the socket is cleared away."""
    try:
        send_control(folder, "status")
    except ControlError:
        with suppress(OSError):
            forget_socket(Path(_own_socket(own_text(folder / CONTROL))))
        return
    raise FileError(f"another run is under way in {folder}; wait until it has ended, or choose another --out")


def _private_folder() -> Path:
    """Return a new folder for a socket, which only its owner may enter."""
    private = Path(tempfile.mkdtemp(prefix=_PREFIX))
    if len(os.fsencode(private / CONTROL)) > _LONGEST_PATH:
        private.rmdir()
        private = Path(tempfile.mkdtemp(prefix=_PREFIX, dir="/tmp"))
    return private


def forget_socket(path: Path) -> None:
    """Remove a socket of ours and its folder, unless something else is there, or somebody listens."""
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        is_ours = path.parent.name.startswith(_PREFIX) and path.parent.lstat().st_uid == os.geteuid()
        if is_ours and [one.name for one in path.parent.iterdir()] == [path.name]:
            line.settimeout(_PATIENCE_S)
            try:
                line.connect(str(path))
            except ConnectionRefusedError:
                path.unlink()
                path.parent.rmdir()


def _announce(folder: Path, path: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / CONTROL).unlink(missing_ok=True)  # of a run that was killed, or a link to elsewhere
        with (folder / CONTROL).open("x", encoding="utf-8") as file:
            file.write(str(path))
    except OSError as error:
        raise FileError(
            f"cannot write {folder / CONTROL}: {error.strerror}; see that the folder may be written"
        ) from error


class _Server(socketserver.ThreadingMixIn, socketserver.TCPServer):
    """Takes clients at a socket's path, each in a thread of its own, so that none that is silent holds up another."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = 16

    def __init__(self, path: Path, answer: Callable[[str], dict[str, Any]]) -> None:
        self.address_family = socket.AF_UNIX  # as socketserver's own, which Windows has not
        self.answer = answer
        self.folder_id: list[int] = []
        super().__init__(cast("Any", str(path)), _Client)

    def handle_error(self, request: object, client_address: object) -> None:
        """Do nothing: a client has left, or says nothing."""


class _Client(socketserver.StreamRequestHandler):
    """Reads one command and answers it; what is no command is refused by name."""

    server: _Server
    timeout = _PATIENCE_S

    def handle(self) -> None:
        try:
            message = json.loads(self.rfile.readline(_MOST_BYTES))
        except ValueError:
            message = None
        command, meant = (message.get("command"), message.get("folder")) if isinstance(message, dict) else (None, None)
        if meant in (None, self.server.folder_id):
            said = self.server.answer(command if isinstance(command, str) else "(none)")
        else:
            sentence = "this is the run of another folder; nothing was done"
            said = {"ok": False, "elsewhere": True, "sentence": sentence}
        self.wfile.write(json.dumps(said).encode() + b"\n")


# A run is shown on stderr while it goes on.


class Screen:
    """Shows a run's events on stderr: remarks, and on a terminal a bar, or the state of a run that tracks; a Listener.

    Another thread writes: a terminal that is stopped (Ctrl-S) holds up whoever writes to it, and one that is closed
    raises, neither of which may reach the bench's cycle.
    """

    def __init__(self, bar: Callable[[float, float], None] | None) -> None:
        self._bar = bar
        self._waiting: SimpleQueue[Event | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._write, name="screen", daemon=True)
        self._thread.start()

    def on_sample(self, sample: Any) -> None:
        """Do nothing."""

    def on_event(self, event: Event) -> None:
        """Have an event shown."""
        self._waiting.put(event)

    def close(self) -> None:
        """Have shown what waits; what takes longer than 2 s is left behind."""
        self._waiting.put(None)
        self._thread.join(_WRITTEN_S)

    def _write(self) -> None:
        """Write events as they come: a tracking state in the place of the last one, the others on lines."""
        has_line = False
        with suppress(OSError, ValueError):  # of a terminal that was closed
            while (event := self._waiting.get()) is not None:
                if isinstance(event, Health) and self._bar is not None:
                    self._bar(event.done_s, event.total_s)
                elif isinstance(event, Track) and sys.stderr.isatty():
                    sys.stderr.write(f"\r\x1b[2K{event}")
                    sys.stderr.flush()
                    has_line = True
                elif event.severity != "state" and not isinstance(event, Ended):  # the summary says how it ended
                    sys.stderr.write("\n" * has_line)
                    has_line = False
                    remark(str(event))
            sys.stderr.write("\n" * has_line)


@contextmanager
def showing(*, tracking: bool = False) -> "Iterator[Screen]":
    """Give what shows a run's events. tracking: without a bar."""
    with nullcontext() if tracking else progress_bar("run") as bar:
        screen = Screen(bar)
        try:
            yield screen
        finally:
            screen.close()


# A loop that must keep time gets the computer to itself, as far as the system lets it.


@contextmanager
def keeping_time(*, collecting: bool = False) -> Iterator[bool]:
    """Run the calling thread before others and without garbage collection; give whether the system granted the first.

    collecting: keep the collector at work on what comes, and only what there is already out of its way.

    Real-time priority is asked of Linux (`ulimit -r`, or the capability SYS_NICE); who does not have it runs as usual.
    Collecting garbage pauses a program for longer than a cycle; a loop that makes no cycles of references needs none.
    """
    gc.collect()  # a tenth of a second where JAX is loaded: not yet at a priority that holds up another bench's loop
    gc.freeze()
    if not collecting:
        gc.disable()
    granted = _raise_priority()
    try:
        yield granted
    finally:
        if granted:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        gc.enable()
        gc.unfreeze()


def _raise_priority() -> bool:
    try:
        # Threads that are started meanwhile inherit it: one without it that holds the interpreter would hold up all.
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except (AttributeError, OSError):  # another system than Linux, or not permitted
        return False
    return True
