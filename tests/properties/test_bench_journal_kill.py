"""Whatever moment a run is killed at: its journal is sound, misses half a second at most, and the run goes on.

Twice here; `python -m campaigns.kills --runs 50` kills whole runs on a bench, over and over.
"""

import random
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

from tests.patience import comes
from tests.unit.bench_journal import PLAN, RIG

from sinew.analysis.analysed import analyse_recording
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.record.journal import JournalReader
from sinew.measure.errors import RecordingError
from sinew.measure.recording import segment_slices

CHILD = "tests.properties.bench_journal_child"
ROOT = Path(__file__).parents[2]
MOST_MISSING = 100  # half a second at 200 Hz


def killed_after(path: Path, seconds: float) -> int:
    """Run the child until so long after its first sample, kill it, and return how many samples it handed over."""
    with subprocess.Popen([sys.executable, "-m", CHILD, str(path)], stdout=subprocess.PIPE, cwd=ROOT) as child:
        assert child.stdout is not None
        try:
            assert comes(child.stdout), "the child did not begin"
            time.sleep(seconds)
        finally:
            child.kill()
        return int(child.stdout.read().split(b"\n")[-2])


def stored(path: Path) -> tuple[str, int]:
    """Return SQLite's verdict, and how many samples the last run left."""
    with closing(sqlite3.connect(path)) as connection:
        (verdict,) = connection.execute("PRAGMA integrity_check").fetchone()
        query = "SELECT count(*), 1 + max(id) - min(id) FROM samples WHERE session = (SELECT max(id) FROM sessions)"
        count, span = connection.execute(query).fetchone()
    assert count == (span or 0), "samples are missing in the middle"
    return verdict, count


def is_sound(path: Path) -> bool:
    """Return whether the journal gives a valid recording of its finished groups, or none if there are none."""
    with JournalReader(path) as reader:
        finished = list(reader.finished())
    try:
        recording = recording_from_journal(path)
    except RecordingError:
        return finished == []
    if 1 in finished:
        analyse_recording(recording, RIG)
    groups = [group for i, group in enumerate(PLAN.groups()) if i in finished]
    return len(segment_slices(recording)) == sum(1 if group.kind == "idle" else 2 for group in groups)


def kill_often(path: Path, times: int, seed: int) -> list[tuple[str, bool, bool]]:
    moments = random.Random(seed)
    found = []
    for _ in range(times):
        handed = killed_after(path, moments.uniform(0.02, 2.5))
        verdict, count = stored(path)
        assert handed + 1 >= count
        found.append((verdict, handed - count <= MOST_MISSING, is_sound(path)))
    return found


def test_a_run_that_is_killed_twice_loses_half_a_second_at_most(tmp_path: Path) -> None:
    assert kill_often(tmp_path / "journal.sqlite", 2, 1) == [("ok", True, True)] * 2
