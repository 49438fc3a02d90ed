"""Time stamps as loggers leave them: what is kept, straightened, split and refused."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sinew.measure.errors import TimeError
from sinew.measure.timing import diagnose_times, straighten_times

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


def test_slightly_jittering_stamps_are_kept_as_they_are_and_their_jitter_is_measured() -> None:
    timeline = straighten_times(stamps := EVEN + np.random.default_rng(1).normal(0, 5e-4, EVEN.size))
    assert np.array_equal(timeline.time_s, stamps)
    assert timeline.diagnosis.jitter_s == pytest.approx(5e-4, rel=0.1)


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


def test_a_record_of_which_gaps_leave_only_crumbs_is_refused() -> None:
    with pytest.raises(TimeError, match="no piece of at least 8 samples"):
        straighten_times(np.delete(EVEN[:60], slice(5, 53)), gaps="split")


def test_stamps_with_too_few_digits_are_spread_over_their_last_one() -> None:
    true = np.cumsum(np.random.default_rng(3).choice([0.006, 0.03], 300, p=[0.7, 0.3]))
    timeline = straighten_times(np.round(true, 2), gaps="bridge")
    assert np.abs(timeline.time_s - true).max() <= 0.0101
    assert (np.diff(timeline.time_s) > 0).all()
    assert "too few digits" in timeline.notes[-1]
