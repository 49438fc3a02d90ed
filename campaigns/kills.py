"""Runs killed with SIGKILL at random moments: `python -m campaigns.kills --runs 50`.

Every interrupted run is looked at, gone on with, killed again while it resumes, and completed in the end. Bench and run
are processes of their own, as a user starts them: `sinew emulate` and `sinew run`. What the motors did is read over the
wire after each kill and, in the end, from the emulator's own record of its watchdogs.
The table says how soon the motors were stopped, what the journals lack, and whether all was completed; exit status 1 if
something happened that may not. Takes real time: about 12 s for each kill.
"""

import json
import math
import os
import random
import re
import select
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from campaigns.options import campaign_parser, conclude
from sinew.analysis.analysed import analyse_with, recording_result
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.record.journal import JournalReader
from sinew.hardware.bus import Bus, BusTiming, MonotonicClock
from sinew.hardware.ports import SerialPort
from sinew.hardware.registers import WATCHDOG_TRIPPED
from sinew.hardware.rig import Rig
from sinew.measure.errors import RecordingError
from sinew.measure.files.netcdf import load_recording
from sinew.measure.recording import read_registers, segment_slices
from sinew.plan.rig import RigSpec
from sinew.plan.servo import FULL_DUTY_COUNTS, P_GAIN_LSB, PULSE
from sinew.plan.toml import load_rig, parse_plan

PLAN = """
name = "killed"
sample_hz = 200
[pretension]
pretension_mm = [4]
mode = "position-with-current-limit"
rest_s = 0.3
[sweep]
frequency_hz = [3.2, 4.4]
amplitude_deg = 20
settle_s = 0.5
periods = 2
repeats = 1
[ring_down]
frequency_hz = [3.6, 3.6]
amplitude_deg = 20
drive_s = 0.6
record_s = 0.8
repeats = 1
"""
"""Everything that a bench does, as short as that goes: four groups."""

LONGEST_S = 17.0
"""From opening the journal to the end of a run nobody kills, about [s]."""

_PATIENCE_S = 90.0
_SAMPLE_HZ = 200.0
_UNTIL_STOPPED_S = 0.3
_RESUMES = 12  # a busy computer stops runs, too
SINEW = str(Path(sys.executable).with_name("sinew"))


@dataclass
class Kill:
    """One kill, and what was found.

    how: run, or run --resume. phase: what the run was at. after_s: since the journal was opened. at_s: host's time.
    motors: name to (torque on, watchdog tripped, standing still), over the wire 0.3 s later.
    heard_ms: from the last instruction to the last motor's stop; stopped_ms: from the kill to that. turned_deg: how far
    the lever went after it was stopped. All three NaN where no motor was under a watchdog.
    missing: samples, at most, that the journal does not have: the fewer of cycles from its newest sample to the kill
    and of reads of all devices that passed on the wire (those of the look before a start among them, while the head
    comes to rest) less samples, since the kill before at which a watchdog tripped; None where none did. over: how many
    kills that is. cycles: those to the kill, None where this start took no sample.
    is_sound: whether the journal's finished groups make a valid recording. groups: finished.
    """

    series: int
    how: str
    phase: str
    after_s: float
    at_s: float
    motors: dict[str, tuple[bool, bool, bool]] = field(default_factory=dict)
    heard_ms: float = math.nan
    stopped_ms: float = math.nan
    turned_deg: float = math.nan
    samples: int = 0
    missing: int | None = None
    over: int = 0
    cycles: int | None = None
    is_sound: bool = False
    groups: int = 0
    wrong: list[str] = field(default_factory=list)


@dataclass
class Series:
    """One interrupted run, from start to completion.

    number. kills: in order. ended: what starts that nobody killed said in the end, the last one's among it.
    is_complete: whether --resume completed it with a valid recording of all groups. refused: what a start said that
    found the torque on. stopped: what `sinew stop` said then. wrong: what may not happen.
    """

    number: int
    kills: list[Kill] = field(default_factory=list)
    ended: list[str] = field(default_factory=list)
    is_complete: bool = False
    refused: str = ""
    stopped: str = ""
    slipped_s: float = 0.0
    wrong: list[str] = field(default_factory=list)


def kill_series(number: int, kills: int, folder: Path, seed: int = 0) -> Series:
    """Kill a run so often, at random moments, and let it complete.

    folder: an empty one. Raises TimeoutError where a process does not do its part within a minute and a half.
    """
    return _Trial(number, folder, random.Random(f"{seed} {number}")).run(kills)


@contextmanager
def emulated(port: Path, truth: Path, *options: str) -> Iterator[None]:
    """Have `sinew emulate` play a bench at a port; what truly happened is in the file `truth` afterwards."""
    command = [SINEW, "emulate", "--link", str(port), "--truth", str(truth), *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            if not select.select([process.stdout], [], [], _PATIENCE_S)[0]:
                raise TimeoutError("the emulator does not get ready")
            process.stdout.readline()
            yield
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(_PATIENCE_S)


class _Trial:
    """A series under way."""

    def __init__(self, number: int, folder: Path, moments: random.Random) -> None:
        self._folder, self._moments = folder, moments
        self._out, self._journal = folder / "out", folder / "out" / "journal.sqlite"
        self._spec: RigSpec = load_rig("paper")
        self._plan = folder / "plan.toml"
        self._plan.write_text(PLAN, encoding="utf-8")
        self._port = folder / "bench"
        self.series = Series(number)

    def run(self, kills: int) -> Series:
        series = self.series
        truth = self._folder / "truth.json"
        with emulated(self._port, truth, "--own-time", "--seed", str(series.number)):
            while len(series.kills) < kills and "complete" not in series.ended and len(series.ended) < _RESUMES:
                kill = self._start_and_kill()
                if kill is not None and any(torque for torque, _, _ in kill.motors.values()):
                    self._look_at_torque()
            self._complete()
        self._hold_against(json.loads(truth.read_text(encoding="utf-8")))
        return series

    def _command(self, out: Path, resume: bool) -> list[str]:
        return [SINEW, "run", str(self._plan), "--port", str(self._port), "--out", str(out)] + ["--resume"] * resume

    def _start_and_kill(self) -> Kill | None:
        """Start the run, or go on with it, and kill it at a random moment; return None where it ended before."""
        resume = self._journal.exists()
        sessions = _sessions(self._journal)
        wait = self._moments.uniform(0.0, LONGEST_S)
        command = self._command(self._out, resume)
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            until(lambda: _sessions(self._journal) > sessions or process.poll() is not None, "the run begins")
            began = time.monotonic()
            while time.monotonic() < began + wait and process.poll() is None:
                time.sleep(0.001)
            if process.poll() is not None:
                self._note_end(*process.communicate(), status=process.returncode)
                return None
            process.kill()
            at = time.monotonic()
            process.wait()
        how = f"run{' --resume' * resume}"
        kill = Kill(self.series.number, how, "", at - began, at)
        self.series.kills.append(kill)
        time.sleep(_UNTIL_STOPPED_S)
        self._look_at_motors(kill)
        self._look_at_journal(kill)
        return kill

    def _note_end(self, out: str, error: str, *, status: int) -> None:
        """Note how a start ended that nobody killed."""
        self.series.ended.append("complete" if status == 0 else (out.splitlines() or error.splitlines() or [""])[0])
        if status not in (0, 1, 2) or "Traceback" in error:
            self.series.wrong.append(f"a start ended with status {status}: {error.strip()}")

    def _look_at_motors(self, kill: Kill) -> None:
        clock, wiring = MonotonicClock(), self._spec.wiring
        port = SerialPort(str(self._port), wiring.baud, clock)
        bus = Bus(port, clock, BusTiming(wiring.baud, latency=0.1), retries=5)
        with closing(bus):
            for motor in Rig(bus, clock, self._spec).motors:
                torque, tripped = motor.torque_is_on(), motor.get_count("bus_watchdog") == WATCHDOG_TRIPPED
                is_still = motor.get_count("moving") == 0
                kill.motors[motor.name] = torque, tripped, is_still
                if torque and not tripped and not is_still:
                    kill.wrong.append(f"{motor.name} moves, and no watchdog has stopped it")

    def _look_at_journal(self, kill: Kill) -> None:
        with closing(sqlite3.connect(f"{self._journal.as_uri()}?mode=ro", uri=True)) as connection:
            (verdict,) = connection.execute("PRAGMA integrity_check").fetchone()
            kill.samples, span = connection.execute("SELECT count(*), 1 + max(id) - min(id) FROM samples").fetchone()
            (newest,) = connection.execute(
                "SELECT max(time_s) FROM samples WHERE session = (SELECT max(id) FROM sessions)"
            ).fetchone()
            kill.phase = _phase(connection)
        if newest is not None:
            kill.cycles = math.ceil((kill.at_s - newest) * _SAMPLE_HZ)
        if verdict != "ok":
            kill.wrong.append(f"the journal is damaged: {verdict}")
        if kill.samples != (span or 0):
            kill.wrong.append("samples are missing in the middle of the journal")
        with JournalReader(self._journal) as reader:
            kill.groups = len(reader.finished())
        try:
            recording_from_journal(self._journal)
            kill.is_sound = True
        except RecordingError as error:
            kill.is_sound = kill.groups == 0
            if kill.groups:
                kill.wrong.append(f"{kill.groups} finished groups make no recording: {error}")
        if (recording := self._out / "recording.nc").exists():
            load_recording(recording)

    def _look_at_torque(self) -> None:
        """Once: see that a fresh start refuses motors under torque. Once more: see that `sinew stop` lets go."""
        series = self.series
        if not series.refused:
            other = self._folder / "other"
            done = _ended(self._command(other, False))
            series.refused = done.stderr.strip() or done.stdout.strip()
            if done.returncode != 2 or "torque is on at" not in series.refused:
                series.wrong.append(f"a start on motors under torque ended with status {done.returncode}")
        elif not series.stopped:
            done = _ended([SINEW, "stop", "--port", str(self._port)])
            series.stopped = done.stdout.strip() or done.stderr.strip()
            after = Kill(series.number, "stop", "", 0.0, 0.0)
            self._look_at_motors(after)
            if done.returncode or any(torque for torque, _, _ in after.motors.values()):
                series.wrong.append(f"`sinew stop` ended with status {done.returncode} and left {after.motors}")

    def _complete(self) -> None:
        """Go on with the run until it has completed."""
        for _ in range(_RESUMES):
            if "complete" in self.series.ended:
                break
            done = _ended(self._command(self._out, self._journal.exists()))
            self._note_end(done.stdout, done.stderr, status=done.returncode)
        if not self._is_complete():
            self.series.wrong.append(f"--resume did not complete the run: {self.series.ended[-1]}")

    def _is_complete(self) -> bool:
        recording = self._out / "recording.nc"
        if not recording.exists():
            return False
        found = load_recording(recording)
        groups = parse_plan(str(found.attrs["plan"])).groups()
        wanted = sum(1 if group.kind == "idle" else 2 for group in groups)
        self.series.is_complete = len(segment_slices(found)) == wanted
        self._look_at_lever(found)
        return self.series.is_complete

    def _look_at_lever(self, recording: xr.Dataset) -> None:
        """See that every start after a kill drove as the rig says, whatever the motors had been left with."""
        gain = self._spec.drive.position_gain.value
        for run in read_registers(recording):
            drive = run["motors"]["drive"]["registers"]
            duty_per_rad = drive["position_p_gain"] * P_GAIN_LSB / FULL_DUTY_COUNTS / PULSE
            if drive["goal_pwm"] != FULL_DUTY_COUNTS or abs(duty_per_rad / gain - 1) > 1e-3:
                self.series.wrong.append(f"run {run['run']} measured with {drive}")
        doubts = recording_result(analyse_with(recording, self._spec)).doubts
        self.series.wrong += [doubt.sentence for doubt in doubts if doubt.kind == "lever"]

    def _hold_against(self, truth: dict[str, Any]) -> None:
        """Find the watchdogs that each kill let trip, and count what the journal lacks."""
        zero, self.series.slipped_s = truth["clock_s_at_zero"], truth["slipped_s"]
        lost = over = 0
        drive = self._spec.wiring.drive_id
        for kill in self.series.kills:
            over += 1
            since = [(zero + trip["tripped_s"] - kill.at_s, trip) for trip in truth["watchdog_trips"]]
            trips = [trip for after, trip in since if 0 < after < 2 * _UNTIL_STOPPED_S]
            if not trips:
                continue
            kill.heard_ms = max(1e3 * (trip["tripped_s"] - trip["heard_s"]) for trip in trips)
            kill.stopped_ms = max(1e3 * (zero + trip["tripped_s"] - kill.at_s) for trip in trips)
            kill.turned_deg = max((trip["turned_deg"] for trip in trips if trip["id"] == drive), default=math.nan)
            missing = max(trip["group_reads"] for trip in trips) - kill.samples
            kill.missing, lost = missing - lost, missing
            if kill.cycles is not None:
                kill.missing = min(kill.missing, kill.cycles)
            kill.over, over = over, 0


def _ended(command: list[str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, check=False)


def _phase(connection: sqlite3.Connection) -> str:
    """Return what the newest run of a journal was at."""
    (session,) = connection.execute("SELECT max(id) FROM sessions").fetchone()
    where = "WHERE session = ? ORDER BY id DESC LIMIT 1"
    running = connection.execute(f"SELECT kind, state FROM segments {where}", (session,)).fetchone()
    event = connection.execute(f"SELECT kind FROM events {where}", (session,)).fetchone()
    if event and event[0] == "end":
        return "end"
    if running and running[1] == "running":
        return str(running[0])
    return f"after {event[0]}" if event else "start"


def _sessions(journal: Path) -> int:
    """Return how many runs have written to a journal; 0 where there is none."""
    if not journal.exists():
        return 0
    with closing(sqlite3.connect(f"{journal.as_uri()}?mode=ro", uri=True)) as connection:
        try:
            return int(connection.execute("SELECT count(*) FROM sessions").fetchone()[0])
        except sqlite3.OperationalError:
            return 0  # it is being changed


def until(claim: Callable[[], object], what: str, patience_s: float = _PATIENCE_S) -> None:
    """Wait until a claim is true. Raises TimeoutError where it is not in time."""
    stop = time.monotonic() + patience_s
    while not claim():
        if time.monotonic() > stop:
            raise TimeoutError(f"waited in vain until {what}")
        time.sleep(0.01)


MOST_MISSING = 100
"""Half a second at 200 Hz."""

MOST_STOPPED_MS = 100.0
"""From the last instruction to the last motor's stop."""

_KILLS_EACH = 4


def run_series(kills: int, seed: int = 0) -> Iterator[Series]:
    """Yield series until there have been so many kills."""
    number, left = 0, kills
    while left > 0:
        with tempfile.TemporaryDirectory() as folder:
            series = kill_series(number, min(left, _KILLS_EACH), Path(folder), seed)
        left -= len(series.kills)
        number += 1
        yield series


def violations(series: Sequence[Series]) -> list[str]:
    """Return what happened that may not."""
    found = [f"series {one.number}: {wrong}" for one in series for wrong in one.wrong]
    for kill in _kills(series):
        where = f"series {kill.series}, killed {kill.after_s:.2f} s after {kill.how} began"
        found += [f"{where}: {wrong}" for wrong in kill.wrong]
        if kill.heard_ms > MOST_STOPPED_MS:
            found.append(f"{where}: motors stopped {kill.heard_ms:.1f} ms after the last instruction")
        if kill.missing is not None and kill.missing > MOST_MISSING * kill.over:
            found.append(f"{where}: {kill.missing} samples are missing of {kill.over} kills")
        if not kill.is_sound:
            found.append(f"{where}: the journal makes no valid recording")
    found += [f"series {one.number} was not completed" for one in series if not one.is_complete]
    return found


def table(series: Sequence[Series]) -> str:
    """Return what became of all kills, as text."""
    kills = _kills(series)
    phases = Counter(f"{kill.how}, {kill.phase}" for kill in kills)
    lines = [f"{len(kills)} kills in {len(series)} runs, {sum('resume' in kill.how for kill in kills)} while resuming"]
    lines += [f"  {count:3d}  {phase}" for phase, count in sorted(phases.items())]
    under = [kill for kill in kills if not np.isnan(kill.stopped_ms)]
    lines.append(f"motors under torque with a watchdog at {len(under)} kills, all stopped by it:")
    lines.append(f"  from the last instruction  {_spread([kill.heard_ms for kill in under])} ms")
    lines.append(f"  from the kill              {_spread([kill.stopped_ms for kill in under])} ms")
    lines.append(f"  the lever went on by       {_spread([kill.turned_deg for kill in under])}°")
    missing = [kill.missing / kill.over for kill in kills if kill.missing is not None]
    lines.append(f"samples missing in the journal for each kill {_spread(missing)} of at most {MOST_MISSING}")
    sound = sum(kill.is_sound for kill in kills)
    lines.append(f"journal sound, and its recording valid: {sound} of {len(kills)}")
    complete = sum(one.is_complete for one in series)
    lines.append(f"completed by --resume: {complete} of {len(series)}")
    own = Counter(re.sub(r"\d+ ms", "… ms", end) for one in series for end in one.ended if end != "complete")
    lines += [f"  ended by itself {count} times: {sentence}" for sentence, count in own.most_common()]
    refused, stopped = (sum(bool(getattr(one, name)) for one in series) for name in ("refused", "stopped"))
    lines.append(f"a fresh run refused because torque was on {refused} times; `sinew stop` let go {stopped} times")
    slipped = max((one.slipped_s for one in series), default=0.0)
    lines.append(f"emulated time held up by at most {slipped:.2f} s; load average {os.getloadavg()[0]:.1f}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign, print its table, and return the exit status."""
    given = campaign_parser("kills", __doc__, count=50, verbose=True).parse_args(arguments)
    done: list[Series] = []
    for series in run_series(given.runs, given.seed):
        done.append(series)
        if given.verbose:
            for kill in series.kills:
                print(json.dumps(asdict(kill)), file=sys.stderr)
            print(series.number, series.ended, series.refused, series.stopped, file=sys.stderr, flush=True)
    return conclude(given.out, table(done), list(map(asdict, done)), violations(done))


def _kills(series: Sequence[Series]) -> list[Kill]:
    return [kill for one in series for kill in one.kills]


def _spread(values: Sequence[float]) -> str:
    if not len(values):
        return "(none)"
    return f"median {np.nanmedian(values):.1f}, largest {np.nanmax(values):.1f}"


if __name__ == "__main__":
    sys.exit(main())
