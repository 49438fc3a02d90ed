"""A run that is killed, looked at, gone on with, killed again, and at last completed.

Bench and run are processes of their own, as a user starts them: `sinew emulate` and `sinew run`. What the motors did is
read over the wire after each kill and, in the end, from the emulator's own record of its watchdogs.
"""

import json
import math
import random
import select
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import xarray as xr

from sinew.analysis.analysed import analyse
from sinew.analysis.tracked import tracking_document
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.record.journal import JournalReader
from sinew.hardware.bus import Bus, BusTiming, MonotonicClock
from sinew.hardware.registers import WATCHDOG_TRIPPED
from sinew.hardware.rig import Rig
from sinew.hardware.serial_port import SerialPort
from sinew.measure.errors import RecordingError
from sinew.measure.files.netcdf import load_recording
from sinew.measure.recording import read_registers, segment_slices
from sinew.plan.rig import RigSpec
from sinew.plan.servo import FULL_DUTY_COUNTS, P_GAIN_LSB, PULSE
from sinew.plan.toml import load_rig, parse_plan

TRACKED = ("--pretension-mm", "4", "--amplitude-deg", "10, 20", "--duration-s", "8")
"""What every other series tracks: one group at rest, two tracked motions, long enough for a point of the backbone."""

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

LONGEST_S, LONGEST_TRACK_S = 17.0, 27.0
"""From opening the journal to the end of a run nobody kills, and of one that tracks, about [s]."""

_PATIENCE_S = 90.0
_SAMPLE_HZ = 200.0
_UNTIL_STOPPED_S = 0.3
_MOST_OFF = 0.01  # of the predicted resonance
_RESUMES = 12  # a busy computer stops runs, too
_SINEW = str(Path(sys.executable).with_name("sinew"))


@dataclass
class Kill:
    """One kill, and what was found.

    how: run or track, or either with --resume. phase: what the run was at. after_s: since the journal was opened. at_s:
    host's time.
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

    def document(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in asdict(self).items()}


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
        self._tracks = number % 2 == 1

    def run(self, kills: int) -> Series:
        series = self.series
        truth = self._folder / "truth.json"
        with self._emulated(truth):
            while len(series.kills) < kills and "complete" not in series.ended and len(series.ended) < _RESUMES:
                kill = self._start_and_kill()
                if kill is not None and any(torque for torque, _, _ in kill.motors.values()):
                    self._look_at_torque()
            self._complete()
        self._hold_against(json.loads(truth.read_text(encoding="utf-8")))
        return series

    @contextmanager
    def _emulated(self, truth: Path) -> Iterator[None]:
        options = ["--own-time", "--link", str(self._port), "--truth", str(truth), "--seed", str(self.series.number)]
        with subprocess.Popen([_SINEW, "emulate", *options], stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                if not select.select([process.stdout], [], [], _PATIENCE_S)[0]:
                    raise TimeoutError("the emulator does not get ready")
                process.stdout.readline()
                yield
            finally:
                process.send_signal(signal.SIGINT)
                process.wait(_PATIENCE_S)

    def _command(self, out: Path, resume: bool) -> list[str]:
        what = ["track", "paper"] if self._tracks else ["run", str(self._plan)]
        asked = [*TRACKED] if self._tracks and not resume else []
        return [_SINEW, *what, "--port", str(self._port), "--out", str(out), *asked] + ["--resume"] * resume

    def _start_and_kill(self) -> Kill | None:
        """Start the run, or go on with it, and kill it at a random moment; return None where it ended before."""
        resume = self._journal.exists()
        sessions = _sessions(self._journal)
        wait = self._moments.uniform(0.0, LONGEST_TRACK_S if self._tracks else LONGEST_S)
        command = self._command(self._out, resume)
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            _until(lambda: _sessions(self._journal) > sessions or process.poll() is not None, "the run begins")
            began = time.monotonic()
            while time.monotonic() < began + wait and process.poll() is None:
                time.sleep(0.001)
            if process.poll() is not None:
                self._note_end(*process.communicate(), status=process.returncode)
                return None
            process.kill()
            at = time.monotonic()
            process.wait()
        how = f"{'track' if self._tracks else 'run'}{' --resume' * resume}"
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
            done = subprocess.run(
                self._command(other, False), capture_output=True, text=True, timeout=_PATIENCE_S, check=False
            )
            series.refused = done.stderr.strip() or done.stdout.strip()
            if done.returncode != 2 or "torque is on at" not in series.refused:
                series.wrong.append(f"a start on motors under torque ended with status {done.returncode}")
        elif not series.stopped:
            done = subprocess.run(
                [_SINEW, "stop", "--port", str(self._port)],
                capture_output=True,
                text=True,
                timeout=_PATIENCE_S,
                check=False,
            )
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
            command = self._command(self._out, self._journal.exists())
            done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, check=False)
            self._note_end(done.stdout, done.stderr, status=done.returncode)
        if not self._is_complete():
            self.series.wrong.append(f"--resume did not complete the run: {self.series.ended[-1]}")

    def _is_complete(self) -> bool:
        recording = self._out / "recording.nc"
        if not recording.exists():
            return False
        found = load_recording(recording)
        groups = parse_plan(str(found.attrs["plan"])).groups()
        wanted = sum(1 if group.kind in ("idle", "tracking") else 2 for group in groups)
        self.series.is_complete = len(segment_slices(found)) == wanted
        self._look_at_lever(found)
        if self._tracks:
            self._look_at_tracks(found)
        return self.series.is_complete

    def _look_at_lever(self, recording: xr.Dataset) -> None:
        """See that every start after a kill drove as the rig says, whatever the motors had been left with."""
        gain = self._spec.drive.position_gain.value
        for run in read_registers(recording):
            drive = run["motors"]["drive"]["registers"]
            duty_per_rad = drive["position_p_gain"] * P_GAIN_LSB / FULL_DUTY_COUNTS / PULSE
            if drive["goal_pwm"] != FULL_DUTY_COUNTS or abs(duty_per_rad / gain - 1) > 1e-3:
                self.series.wrong.append(f"run {run['run']} measured with {drive}")
        doubts = analyse(recording, self._spec).document["doubts"]
        self.series.wrong += [str(doubt["sentence"]) for doubt in doubts if doubt["kind"] == "lever"]

    def _look_at_tracks(self, recording: xr.Dataset) -> None:
        """See that every motion resonated where that was predicted."""
        for track in tracking_document(recording, self._spec)["tracks"]:
            point = track["point"]
            if point is None or point["predicted_hz"] is None:
                self.series.wrong.append(f"tracked at {track['amplitude_deg']:g}° without a point on the backbone")
            elif abs(point["frequency_hz"]["value"] / point["predicted_hz"] - 1) > _MOST_OFF:
                self.series.wrong.append(
                    f"tracked at {track['amplitude_deg']:g}° to {point['frequency_hz']['value']:.3f} Hz, predicted "
                    f"{point['predicted_hz']:.3f} Hz"
                )

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


def _until(claim: Any, what: str) -> None:
    stop = time.monotonic() + _PATIENCE_S
    while not claim():
        if time.monotonic() > stop:
            raise TimeoutError(f"waited in vain until {what}")
        time.sleep(0.01)
