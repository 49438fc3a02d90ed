"""From a journal to a recording: the two clocks are brought together, holes are counted, the plan's order is kept."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.bench_journal import (
    DRIVE_RAD,
    PLAN,
    PLAN_TEXT,
    RIG,
    RIG_TEXT,
    SWING_RAD_S,
    Node,
    cycles,
    with_holes,
    write_group,
    written,
)

from sinew.analysis.signal.harmonics import fit_harmonics
from sinew.bench.record.conversion import convert, group_is_whole, imu_series, readings_at, recording_from_journal
from sinew.bench.record.journal import Journal
from sinew.bench.record.sample import MISSING
from sinew.measure.errors import RecordingError
from sinew.measure.files.netcdf import load_recording
from sinew.measure.recording import iterate_segments
from sinew.plan.parameter import Parameter
from sinew.plan.rig import LoadCell
from sinew.plan.toml import dump_rig

NODES = {
    "fast crystal": Node(),
    "slow crystal": Node(drift=-80e-6),
    "with counter": Node(has_counter=True),
    "bad guesses": Node(jitter_s=0.6e-3, has_counter=True),
}
SETTLE, RECORD = PLAN.groups()[2].sample_counts(PLAN.sample_hz)


def fundamental(recording: xr.Dataset, frequency_hz: float) -> complex:
    """Complex amplitude of the head's rate over that of the drive."""
    (where,) = [w for _, s, w in iterate_segments(recording, "steady") if s.frequency_hz == frequency_hz]
    signals = [recording["gyro_rad_s"].values[where, 0], recording["drive_rad"].values[where]]
    time = recording["time_s"].values[where]
    fitted = fit_harmonics(time[None], np.array([signals], dtype=float), np.array([frequency_hz]))
    rate, drive = fitted.coefficient[0, :, 0]
    return complex(rate / drive)


def expected(frequency_hz: float) -> complex:
    """The rate leads the lever by a quarter; the lever's reading is older than its row by the rig's drive_delay."""
    return 1j * SWING_RAD_S / DRIVE_RAD * np.exp(2j * np.pi * frequency_hz * RIG.bus.drive_delay.value)


@pytest.mark.parametrize("node", NODES.values(), ids=NODES)
def test_a_swing_on_two_clocks_keeps_amplitude_and_phase(node: Node, tmp_path: Path) -> None:
    ratio = fundamental(recording_from_journal(written(tmp_path, node)), 4.3) / expected(4.3)
    assert abs(ratio) == pytest.approx(1.0, abs=1e-3)
    assert np.degrees(np.angle(ratio)) == pytest.approx(0.0, abs=0.2)


def test_a_counter_that_wraps_in_the_middle_of_a_group_changes_nothing() -> None:
    own = np.arange(1000) / 200.0
    host = 50.0 + own * (1 + 80e-6)
    wrapped = imu_series(host, own[:, None], (own + 4294.967296 - 2.0) % 4294.967296)
    assert wrapped.time_s == pytest.approx(host, abs=1e-6)


def test_a_sample_that_was_read_twice_counts_once() -> None:
    own = np.repeat(np.arange(500) / 200.0, 2)
    jitter = 1e-4 * np.random.default_rng(0).standard_normal(own.size)
    assert imu_series(own + jitter, own[:, None]).time_s.size == 500


def test_there_is_no_reading_between_two_samples_that_are_three_periods_apart() -> None:
    node = np.delete(np.arange(400) / 200.0, [200, 201])
    found = readings_at(imu_series(node, node[:, None]), np.array([0.994, 0.996, 1.009, 1.011]))
    assert np.isnan(found[:, 0]).tolist() == [False, True, True, False]


def test_a_load_cell_that_misses_answers_leaves_its_own_values_alone_unknown(tmp_path: Path) -> None:
    noise = Parameter(value=0.02, unit="N", origin="assumed", bounds=(0.0, 1.0))
    rig = dump_rig(RIG.model_copy(update={"load_cell": LoadCell(id=30, tendon=2, noise=noise)}))
    heard = [replace(s, sensors=(20.0,)) for s in cycles(PLAN.groups()[1], 1000.0, Node())]
    silent = list(with_holes(heard, range(50, 58), sensors=(MISSING,)))
    recordings = []
    for name, samples in (("heard", heard), ("silent", silent)):
        with Journal.create(tmp_path / name, PLAN_TEXT, rig) as journal:
            write_group(journal, 1, samples)
        recordings.append(recording_from_journal(tmp_path / name))
    unknown = [np.isnan(recording["load_cell_n"].values) for recording in recordings]
    assert [int(there.sum()) for there in unknown] == [0, 8]
    assert recordings[1].drop_vars("load_cell_n").equals(recordings[0].drop_vars("load_cell_n"))
    assert group_is_whole(list(with_holes(heard, range(50, 150), sensors=(MISSING,))), PLAN.sample_hz)


def test_the_recording_follows_the_plan_whatever_the_order_of_measuring(tmp_path: Path) -> None:
    recording = recording_from_journal(written(tmp_path, groups=(2, 0, 1)))
    assert recording["kind"].values.tolist() == ["idle", "settle", "steady", "settle", "steady"]


def test_the_latest_finished_attempt_counts(tmp_path: Path) -> None:
    group = cycles(PLAN.groups()[1], 1000.0, Node())
    louder = [replace(s, drive_rad=2 * s.drive_rad) for s in group]
    path = tmp_path / "journal.sqlite"
    with Journal.create(path, PLAN_TEXT, RIG_TEXT) as journal:
        write_group(journal, 1, group)
        write_group(journal, 1, louder, attempt=1)
        write_group(journal, 1, group, attempt=2, finish=False)
    recording = recording_from_journal(path)
    assert float(np.abs(recording["drive_rad"]).max()) == pytest.approx(2 * DRIVE_RAD, rel=1e-3)


def test_a_run_that_resumes_after_the_computer_restarted_comes_after_the_first(tmp_path: Path) -> None:
    path = written(tmp_path, groups=(0, 1))
    with Journal.open(path, PLAN_TEXT, RIG_TEXT) as journal:
        write_group(journal, 2, cycles(PLAN.groups()[2], 5.0, Node()))
    assert np.diff(recording_from_journal(path)["time_s"].values).min() > 0


def test_rows_without_a_reading_are_left_out_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    group = with_holes(cycles(PLAN.groups()[2], 1000.0, Node()), (100, 200, 300), tendon_rad=(1.0, MISSING, 1.0, 1.0))
    with Journal.create(path, PLAN_TEXT, RIG_TEXT) as journal:
        write_group(journal, 2, list(group))
    recording = recording_from_journal(path)
    assert (recording.attrs["left_out_rows"], recording.sizes["sample"]) == (3, SETTLE + RECORD - 3)


HOLES = {
    "none": ((), True),
    "less than two rows in a hundred, apart": (range(20, 330, 60), True),
    "four rows in a hundred, apart": (range(20, 330, 25), False),
    "one short stretch": (range(100, 106), True),
    "much more than 50 ms in one piece": (range(100, 118), False),
}


@pytest.mark.parametrize(("missing", "whole"), HOLES.values(), ids=HOLES)
@pytest.mark.parametrize(
    "readings",
    [
        {"drive_rad": MISSING},
        {"tendon_current_a": (0.1, MISSING, 0.1, 0.1)},
        {"gyro_rad_s": (MISSING,) * 3, "acceleration_m_s2": (MISSING,) * 3, "imu_time_s": MISSING},
    ],
    ids=["drive", "tendon", "imu"],
)
def test_a_group_with_too_many_holes_is_not_whole(
    missing: range, whole: bool, readings: dict[str, object], tmp_path: Path
) -> None:
    samples = list(with_holes(cycles(PLAN.groups()[2], 1000.0, Node()), missing, **readings))
    path = tmp_path / "journal.sqlite"
    with Journal.create(path, PLAN_TEXT, RIG_TEXT) as journal:
        write_group(journal, 0, cycles(PLAN.groups()[0], 990.0, Node()))
        write_group(journal, 2, samples)
    left_out = recording_from_journal(path).attrs["left_out_groups"]
    assert (group_is_whole(samples[: SETTLE + RECORD], 200.0), left_out) == (whole, "" if whole else "2")


def test_a_group_in_which_cycles_did_not_run_is_not_whole() -> None:
    samples = cycles(PLAN.groups()[2], 1000.0, Node())
    assert not group_is_whole(samples[:100] + samples[115:], 200.0)


def test_a_group_whose_imu_froze_is_not_whole() -> None:
    samples = cycles(PLAN.groups()[2], 1000.0, Node())
    frozen = [
        replace(s, imu_time_s=samples[99].imu_time_s, gyro_rad_s=samples[99].gyro_rad_s) for s in samples[100:120]
    ]
    assert not group_is_whole(samples[:100] + frozen + samples[120:], 200.0)


def test_counts_are_summed_over_the_runs_that_wrote(tmp_path: Path) -> None:
    path = written(tmp_path)
    for number in (3, 4):
        with Journal.open(path, PLAN_TEXT, RIG_TEXT) as journal:
            journal.count({"bus_retries": 1})
            journal.count({"bus_retries": number})
    assert recording_from_journal(path).attrs["bus_retries"] == 7


def test_a_converted_journal_reads_like_any_recording(tmp_path: Path) -> None:
    path = written(tmp_path)
    written_to = convert(path, tmp_path / "recording.nc")
    assert load_recording(written_to).equals(recording_from_journal(path))


def test_a_journal_without_a_finished_group_gives_no_recording(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="holds no whole group of the plan yet; resume its run"):
        recording_from_journal(written(tmp_path, groups=()))
