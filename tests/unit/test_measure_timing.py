"""Time stamps as loggers leave them: what is kept, straightened, split and refused."""

import re

import numpy as np
import pytest
from numpy.typing import NDArray

from sinew.measure.errors import TimeError
from sinew.measure.timing import diagnose_times, mend_stamps, mend_values, straighten_times

EVEN = np.arange(1000) * 0.01
SWAPPED = np.r_[:300, 301, 300, 302:1000]


def through_a_serial_buffer(true: NDArray[np.float64], period: float, quick: float) -> NDArray[np.float64]:
    """Stamp samples as a host does that reads its buffer every `period` seconds, `quick` seconds a sample."""
    read_at = np.ceil(true / period) * period
    waiting = np.zeros(true.size)
    for i in range(1, true.size):
        waiting[i] = waiting[i - 1] + 1 if read_at[i] == read_at[i - 1] else 0
    return np.asarray(read_at + quick * waiting)


def after_a_hiccup(stamps: NDArray[np.float64], first: int, last: int, quick: float = 0.0) -> NDArray[np.float64]:
    """Stamp samples `first` to `last` only when sample `last` came, `quick` seconds apart."""
    late = stamps.copy()
    late[first : last + 1] = stamps[last] - quick * np.arange(last - first, -1, -1)
    return late


@pytest.mark.parametrize("begin", [0.0, 1.7e9], ids=["from zero", "since 1970"])
def test_even_stamps_are_called_even(begin: float) -> None:
    assert diagnose_times(begin + EVEN).pattern == "even"


def test_slightly_jittering_stamps_are_kept_as_they_are_and_their_jitter_is_measured() -> None:
    timeline = straighten_times(stamps := EVEN + np.random.default_rng(1).normal(0, 5e-4, EVEN.size))
    assert np.array_equal(timeline.time_s, stamps)
    assert timeline.diagnosis.jitter_s == pytest.approx(5e-4, rel=0.1)


def test_one_missing_sample_is_no_gap() -> None:
    assert diagnose_times(np.delete(EVEN, 400)).gaps == ()


@pytest.mark.parametrize("missing", [3, 10, 60, 500])
def test_missing_samples_are_counted_where_they_are_missing(missing: int) -> None:
    (gap,) = diagnose_times(np.delete(EVEN, slice(300, 300 + missing))).gaps
    assert (gap.after, gap.missing) == (299, missing)


def test_several_gaps_are_found_one_by_one() -> None:
    gaps = diagnose_times(np.delete(EVEN, np.r_[300:310, 320:350, 700:705])).gaps
    assert [(gap.after, gap.missing) for gap in gaps] == [(299, 10), (309, 30), (659, 5)]


def test_a_gap_is_refused_with_place_length_and_ways_out() -> None:
    said = (
        r"gap of 0.11 s after data row 350 \(from 2.99 s to 3.1 s, about 10 samples of 10 ms missing\); select .*"
        r"\(--start, --stop\), or split the record at its gaps \(--gaps split\)"
    )
    with pytest.raises(TimeError, match=said):
        straighten_times(np.delete(EVEN, slice(300, 310)), rows=51)


def test_a_record_is_split_at_its_gap_when_asked() -> None:
    timeline = straighten_times(np.delete(EVEN, slice(300, 310)), gaps="split")
    assert timeline.pieces == (slice(0, 300), slice(300, 990))


def test_a_piece_too_short_to_use_is_left_out_and_mentioned() -> None:
    timeline = straighten_times(np.delete(EVEN, slice(5, 60)), gaps="split")
    assert (timeline.pieces, "5 samples in shorter pieces left out" in timeline.notes[1]) == ((slice(5, 945),), True)


@pytest.mark.parametrize("quick", [0.0, 3e-4])
def test_the_step_behind_serial_bursts_is_recovered(quick: float) -> None:
    stamps = through_a_serial_buffer(np.arange(3000) / 260, 0.05, quick)
    found = diagnose_times(stamps)
    assert (found.pattern, found.step_s) == ("bursty", pytest.approx(1 / 260, rel=2e-4))


def test_bursty_stamps_are_replaced_by_the_true_time_up_to_a_constant_delay() -> None:
    true = np.arange(3000) / 260
    timeline = straighten_times(through_a_serial_buffer(true, 0.05, 0.0))
    assert np.ptp(timeline.time_s - true) < 0.2 / 260
    assert "replaced by the straight line" in timeline.notes[-1]


def test_stamps_rounded_to_few_digits_are_replaced_by_the_line() -> None:
    true = np.arange(2000) / 1000
    time = straighten_times(np.floor(true * 100) / 100).time_s
    assert np.ptp(time - true) < 0.5 / 1000


@pytest.mark.parametrize("quick", [0.0, 5e-4])
def test_a_pause_whose_samples_come_later_is_no_gap_and_the_line_replaces_the_stamps(quick: float) -> None:
    timeline = straighten_times(after_a_hiccup(EVEN, 400, 412, quick))
    assert np.ptp(timeline.time_s - EVEN) < 0.002
    assert timeline.diagnosis.gaps == ()


def test_a_record_that_ends_while_late_stamps_catch_up_has_no_gap() -> None:
    stamps = np.r_[EVEN[:980], 9.95 + 1e-4 * np.arange(15)]
    assert diagnose_times(stamps).gaps == ()


def test_a_gap_beside_a_pause_without_loss_is_found_alone() -> None:
    stamps = np.delete(after_a_hiccup(EVEN, 400, 412, 5e-4), slice(420, 450))
    assert [(gap.after, gap.missing) for gap in diagnose_times(stamps).gaps] == [(419, 30)]


@pytest.mark.parametrize("missing", [20, 40, 400])
def test_missing_samples_among_serial_bursts_are_found(missing: int) -> None:
    stamps = np.delete(through_a_serial_buffer(np.arange(4000) / 260, 0.05, 3e-4), slice(1500, 1500 + missing))
    (gap,) = diagnose_times(stamps).gaps
    assert gap.missing == pytest.approx(missing, abs=1)


@pytest.mark.parametrize(
    "steps",
    [
        np.random.default_rng(3).uniform(0.002, 0.018, 1000),
        np.random.default_rng(4).exponential(0.01, 1000),
        np.linspace(0.005, 0.02, 1000),
        np.repeat([0.01, 0.03], 500),
    ],
    ids=["uniform", "exponential", "ever slower", "two rates"],
)
def test_irregular_but_honest_stamps_are_kept(steps: NDArray[np.float64]) -> None:
    stamps = np.cumsum(steps)
    assert np.array_equal(straighten_times(stamps).time_s, stamps)


def test_a_gap_stands_out_from_irregular_stamps() -> None:
    steps = np.random.default_rng(5).uniform(0.002, 0.018, 1000)
    steps[500] = 0.3
    assert [gap.after for gap in diagnose_times(np.cumsum(steps)).gaps] == [499]


MENDS = {  # stamps, places that stay, their times, the note
    "over again": (np.insert(EVEN, 500, EVEN[498]), np.delete(np.arange(1001), 500), EVEN, r"row 501 .* row 499 over"),
    "written twice": (np.insert(EVEN, 500, EVEN[499]), np.delete(np.arange(1001), 500), EVEN, r"row 501 .*twice"),
    "copied": (np.where(np.arange(1000) == 501, EVEN[500], EVEN), np.arange(1000), EVEN, r"row 502 .*gets 5\.01 s"),
    "swapped": (EVEN[SWAPPED], SWAPPED, EVEN, r"row 302 stood after a later one"),
    "set back": (EVEN - 3.0 * (np.arange(1000) >= 700), np.arange(1000), EVEN, r"set back by 3 s at data row 701"),
    "stands still": (np.r_[EVEN, np.full(50, 9.99)], np.arange(1000), EVEN, r"still from data row 1000 on: 50 rows"),
}


@pytest.mark.parametrize(("stamps", "places", "times", "said"), MENDS.values(), ids=MENDS)
def test_rows_that_are_no_measurement_are_mended_by_their_neighbours_with_one_note(
    stamps: NDArray[np.float64], places: NDArray[np.int64], times: NDArray[np.float64], said: str
) -> None:
    taken, time, notes = mend_stamps(stamps, np.arange(stamps.size) + 1)
    assert taken.tolist() == places.tolist()
    assert time == pytest.approx(times)
    assert len(notes) == 1
    assert re.search(said, notes[0])


@pytest.mark.parametrize(
    "stamps",
    [np.r_[EVEN, 9.99 - 0.001 * np.arange(1, 300)], np.r_[EVEN, 9.1 + 0.001 * np.arange(300)]],
    ids=["runs backwards", "counts its digits anew"],
)
def test_a_time_that_its_neighbours_do_not_decide_stays_and_is_refused(stamps: NDArray[np.float64]) -> None:
    _, time, _ = mend_stamps(stamps, np.arange(stamps.size) + 1)
    with pytest.raises(TimeError, match="backwards at data row 1001"):
        diagnose_times(time)


T = np.arange(1200) / 100
TURNING = 20 * np.exp(-0.3 * T) * np.cos(2 * np.pi * 3 * T)


@pytest.mark.parametrize(
    ("name", "unit", "true", "turn"),
    [
        ("heading_deg", "rad", np.radians(3 * TURNING), 2 * np.pi),
        ("yaw", "1", 3 * TURNING + 350.5, 360.0),
        ("present_position", "1", np.rint(30 * TURNING) + 4090, 4096.0),
        ("ticks", "1", np.rint(5 * TURNING) + 1020, 1024.0),
    ],
)
def test_turns_of_an_angle_or_a_counter_are_made_whole(
    name: str, unit: str, true: NDArray[np.float64], turn: float
) -> None:
    mended, (note,) = mend_values(name, true % turn, unit, np.arange(T.size))
    assert np.ptp(mended - true) < 1e-9
    assert "turns, unwrapped" in note


@pytest.mark.parametrize(("word", "rows"), [(-999.0, [100, 300, 700]), (85.0, [5, 50, 400])])
def test_samples_that_stand_alone_at_one_word_of_the_driver_are_left_out(word: float, rows: list[int]) -> None:
    alone = [row for row in rows if row != 6]
    mended, (note,) = mend_values(
        "x", np.where(np.isin(np.arange(1200), alone), word, TURNING), "m", np.arange(1, 1201)
    )
    assert np.flatnonzero(np.isnan(mended)).tolist() == rows
    assert f"{len(rows)} samples of 'x' stand alone at {word:g}" in note


@pytest.mark.parametrize(
    "values",
    [TURNING, 700 * TURNING, np.round(TURNING), np.where(T % 3 < 0.5, 180.0, 0.0), 1e300 * TURNING],
    ids=["a swing", "many turns", "whole degrees", "a square wave", "beyond any sensor"],
)
def test_what_only_moves_far_is_not_mended(values: NDArray[np.float64]) -> None:
    mended, notes = mend_values("angle", values, "1", np.arange(values.size))
    assert notes == []
    assert mended is values or np.array_equal(mended, values)


def test_a_repeated_stamp_without_a_clock_is_not_called_a_row_written_twice() -> None:
    stamps = np.cumsum(np.random.default_rng(4).exponential(0.01, 1000))
    with pytest.raises(TimeError, match="no regular clock shows which is right"):
        diagnose_times(np.insert(stamps, 500, stamps[500]))


def test_time_that_goes_backwards_is_refused_with_the_row() -> None:
    with pytest.raises(TimeError, match=r"backwards at data row 1001 \(from 9.99 s to 0 s\)"):
        diagnose_times(np.r_[EVEN, EVEN])


def test_time_that_stands_still_is_refused() -> None:
    with pytest.raises(TimeError, match="all 100 time stamps are 3 s"):
        diagnose_times(np.full(100, 3.0))


def test_too_few_samples_are_refused_with_the_number_needed() -> None:
    with pytest.raises(TimeError, match="found 7 samples, expected at least 8"):
        diagnose_times(EVEN[:7])


def test_a_record_of_which_gaps_leave_only_crumbs_is_refused() -> None:
    with pytest.raises(TimeError, match="no piece of at least 8 samples"):
        straighten_times(np.delete(EVEN[:60], slice(5, 53)), gaps="split")


def test_stamps_with_too_few_digits_are_spread_over_their_last_one() -> None:
    true = np.cumsum(np.random.default_rng(3).choice([0.006, 0.03], 300, p=[0.7, 0.3]))
    timeline = straighten_times(np.round(true, 2), gaps="bridge")
    assert np.abs(timeline.time_s - true).max() <= 0.0101
    assert (np.diff(timeline.time_s) > 0).all()
    assert "too few digits" in timeline.notes[-1]
