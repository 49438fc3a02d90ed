"""The live record of a run: what is written comes back, one writer at a time, and a disk that fails is heard of."""

import os
import resource
import sqlite3
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.patience import finished, until
from tests.unit.bench_journal import PLAN, PLAN_TEXT, RIG_TEXT, Node, cycles, write_group, written

from sinew.bench.record.journal import Journal, JournalReader
from sinew.bench.record.sample import Sample, sample_columns, sample_row
from sinew.measure.errors import FileError
from sinew.measure.events import Pulled
from sinew.measure.recording import Segment
from sinew.plan.toml import parse_rig

STEADY = Segment("steady", 3.0, 4.3, 20.0, 0)


def create(folder: Path) -> Journal:
    return Journal.create(folder / "journal.sqlite", PLAN_TEXT, RIG_TEXT)


def sample(time: float = 1.0) -> Sample:
    return Sample(
        time, 0.9, 0.1, 0.2, 0.3, 0.4, (1, 2, 3, 4), (5, 6, 7, 8), (9, 10, 11, 12), (13, 14, 15), (16, 17, 18), 0.5,
        0.6, 0.7, (19, 20, 21, 22), 12.3, (), 23.0,
    )  # fmt: skip


def test_what_was_appended_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    group = cycles(PLAN.groups()[1], 1000.0, Node(has_counter=True))
    with create(tmp_path) as journal:
        write_group(journal, 1, group)
    with JournalReader(tmp_path / "journal.sqlite") as reader:
        table = reader.samples(1, len(group) + 1)
    assert np.array_equal(
        np.stack([table[name] for name in sample_columns(parse_rig(RIG_TEXT))], axis=1),
        np.array([sample_row(s) for s in group]),
    )


def test_a_segment_says_which_samples_are_its_own(tmp_path: Path) -> None:
    with create(tmp_path) as journal:
        journal.append(sample())
        journal.begin_segment(2, 1, STEADY)
        for _ in range(3):
            journal.append(sample())
        journal.end_segment("complete")
    with JournalReader(tmp_path / "journal.sqlite") as reader:
        (found,) = reader.stretches()
    assert (found.group, found.attempt, found.planned, found.state, found.first, found.end) == (
        2, 1, STEADY, "complete", 2, 5,
    )  # fmt: skip


def test_events_and_counts_come_back(tmp_path: Path) -> None:
    with create(tmp_path) as journal:
        journal.event(Pulled.of())
        journal.count({"bus_retries": 3})
    with JournalReader(tmp_path / "journal.sqlite") as reader:
        assert ([event for _, event in reader.events()], reader.counts()) == (
            [Pulled.of()],
            {"bus_retries": 3.0},
        )


def test_samples_are_committed_while_the_disk_still_syncs_a_group(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sync is held up until a sample after it has been flushed, which fails if it waits for the sync."""
    begun, synced, connect = threading.Event(), threading.Event(), sqlite3.connect

    def hold() -> int:
        begun.set()
        return int(synced.wait(60.0))

    def held(*args: Any, **options: Any) -> sqlite3.Connection:
        connection = connect(*args, **options)
        connection.create_function("hold", 0, hold)
        return connection

    monkeypatch.setattr("sinew.bench.record.journal._CHECKPOINT", "SELECT hold()")
    monkeypatch.setattr(sqlite3, "connect", held)
    with create(tmp_path) as journal:
        write_group(journal, 1, cycles(PLAN.groups()[1], 1000.0, Node()))
        assert begun.wait(60.0)
        journal.append(sample())
        journal.flush()
        with JournalReader(tmp_path / "journal.sqlite") as reader:
            last = reader.last_sample()
        synced.set()
    with JournalReader(tmp_path / "journal.sqlite") as reader:
        assert last == reader.last_sample()


def test_a_group_that_cannot_be_synced_is_told_by_the_calls_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sinew.bench.record.journal._CHECKPOINT", "SELECT broken()")
    journal = create(tmp_path)
    write_group(journal, 1, cycles(PLAN.groups()[1], 1000.0, Node()), finish=False)
    journal.finish_group(1)
    with pytest.raises(FileError, match="no such function: broken"):
        until(lambda: journal.append(sample()))
    journal.close()
    assert not any(thread.name.startswith("journal") for thread in threading.enumerate())


def test_a_closed_journal_is_one_file_and_its_lock(tmp_path: Path) -> None:
    written(tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["journal.sqlite", "journal.sqlite.lock"]


def test_a_resumed_journal_knows_the_groups_that_were_found_whole(tmp_path: Path) -> None:
    path = written(tmp_path, groups=(0, 2))
    with Journal.open(path, PLAN_TEXT, RIG_TEXT) as journal:
        write_group(journal, 1, cycles(PLAN.groups()[1], 1000.0, Node()), finish=False)
        assert journal.finished_groups() == {0, 2}


def test_a_group_is_not_finished_by_the_segments_of_another(tmp_path: Path) -> None:
    with create(tmp_path) as journal:
        journal.begin_segment(1, 0, STEADY)
        with pytest.raises(ValueError, match="segment of group 1, expected one of group 2"):
            journal.finish_group(2)


def test_a_segment_that_was_running_is_aborted_by_the_next_run_and_keeps_its_samples(tmp_path: Path) -> None:
    path = written(tmp_path, groups=(0,))
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("UPDATE segments SET state = 'running', end_sample = NULL")
        connection.commit()
    with JournalReader(path) as reader:
        before = reader.last_sample()
    Journal.open(path, PLAN_TEXT, RIG_TEXT).close()
    with JournalReader(path) as reader:
        assert ([s.state for s in reader.stretches()], reader.last_sample()) == (["aborted"], before)


def test_a_second_run_on_the_same_journal_is_refused(tmp_path: Path) -> None:
    with create(tmp_path), pytest.raises(FileError, match=r"another run is writing the journal .*; wait until it has"):
        Journal.open(tmp_path / "journal.sqlite", PLAN_TEXT, RIG_TEXT)


def test_a_journal_that_exists_is_not_overwritten_nor_gone_on_with_by_another_plan(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"there is no journal .* to resume; start the run without"):
        Journal.open(tmp_path / "journal.sqlite", PLAN_TEXT, RIG_TEXT)
    path = written(tmp_path)
    with pytest.raises(FileError, match="exists; resume its run, or choose another folder"):
        create(tmp_path)
    with pytest.raises(FileError, match=r"another plan \(line \d+: found 'settle_s = 9', expected 'settle_s = 0.5'\)"):
        Journal.open(path, PLAN_TEXT.replace("settle_s = 0.5", "settle_s = 9"), RIG_TEXT)
    Journal.open(path, PLAN_TEXT, RIG_TEXT).close()  # the lock of one that was refused is given back


def test_a_file_that_is_no_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    path.write_bytes(b"time,drive\n" * 500)
    with pytest.raises(FileError, match=r"is not a journal, or is damaged \(file is not a database\)"):
        Journal.open(path, PLAN_TEXT, RIG_TEXT)


@pytest.mark.parametrize(
    ("own", "statement", "said"),
    [
        (False, "CREATE TABLE runs (id)", "an SQLite file, but no journal of Sinew"),
        (True, "PRAGMA user_version = 99", "a journal of version 99, expected 3; go on with the Sinew that began it"),
    ],
    ids=["a foreign database", "a journal of another version"],
)
def test_a_database_of_others_is_refused(own: bool, statement: str, said: str, tmp_path: Path) -> None:
    path = written(tmp_path) if own else tmp_path / "journal.sqlite"
    with closing(sqlite3.connect(path)) as connection:
        connection.execute(statement)
    with pytest.raises(FileError, match=said):
        Journal.open(path, PLAN_TEXT, RIG_TEXT)


def test_a_damaged_journal_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path)
    data = bytearray(path.read_bytes())
    data[8 * 4096 : 20 * 4096] = bytes(12 * 4096)
    path.write_bytes(data)
    with pytest.raises(FileError, match="damaged"):
        Journal.open(path, PLAN_TEXT, RIG_TEXT)


@contextmanager
def an_ordinary_user() -> Iterator[None]:
    """Step down from the superuser, who may write everywhere, for as long as the test needs."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


def test_a_folder_that_may_not_be_written_is_refused() -> None:
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o555)
        with an_ordinary_user(), pytest.raises(FileError, match=r"cannot write the journal .*: Permission denied; see"):
            create(Path(name))


FULL_DISK = """
import sys, time
from pathlib import Path
from sinew.measure.errors import FileError
from tests.patience import Patience
from tests.unit.test_bench_journal import create, limit_files, sample

journal = create(Path(sys.argv[1]))
limit_files(200_000)
patience = Patience(30.0)
told = []
while len(told) < 2 and not patience.is_over():
    try:
        journal.append(sample())
    except FileError as error:
        told.append(str(error))
    time.sleep(0.0005)
journal.close()
print(*told, "closed", sep="\\n")
"""


def limit_files(size: int) -> None:
    """Let no file of this process grow beyond a size [byte], as on a disk that is full."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def test_a_full_disk_is_told_at_every_call_and_the_journal_still_closes(tmp_path: Path) -> None:
    done = finished([sys.executable, "-c", FULL_DISK, str(tmp_path)], 60, check=True)
    first, second, closed = done.stdout.strip().splitlines()
    assert (first[: first.index(": ")], second, closed) == (
        f"cannot write the journal {tmp_path}/journal.sqlite", first, "closed",
    )  # fmt: skip
