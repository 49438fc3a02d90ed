"""Free decays that others measured and let everybody use, read by the command: pendulums, rate gyros, an accelerometer.

Where they come from, their licences and their sources' numbers: `tests/data/decays/SOURCES.md`.
"""

import contextlib
import io
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import find_peaks
from tests.experiments.halves import Halves, halves_of

from sinew.analysis.decay.ring_down import analyse_ring_down
from sinew.apps.cli import main
from sinew.measure.arrays import Array
from sinew.measure.errors import SinewError

DECAYS = Path(__file__).resolve().parents[1] / "data" / "decays"

# file: its options, and the half period by eye [s], with which crests are looked for
RECORDS = {
    "jensen_rotary_pendulum.txt": ("--rate 1000 --response 1:deg", 0.3),
    "lant_seismometer.txt": ("--start 6", 4.4),
    "moore_bicycle_fork_gyro.csv": ("--response gyro_V", 0.8),
    "moore_bicycle_wheel_gyro.csv": ("--response angular_velocity:rad/s", 0.21),
    "tian_string_pendulum.txt": ("--time 1 --response 2:rad", 0.9),
    "choudhary_building_model.csv": ("--response Acceleration:g_0", 0.16),
}
each_record = pytest.mark.parametrize("name", RECORDS)


@cache
def analysed(name: str) -> dict[str, Any]:
    """Return the document of `sinew analyse FILE --kind ring-down`."""
    out, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
        status = main(["analyse", str(DECAYS / name), "--kind", "ring-down", *RECORDS[name][0].split(), "--json"])
    assert status == 0, said.getvalue()
    return dict(json.loads(out.getvalue()))


@cache
def columns(name: str) -> tuple[Array, Array]:
    """Return time [s] and response of a file, by numpy alone."""
    rows = []
    for line in (DECAYS / name).read_text(encoding="utf-8").splitlines():
        with contextlib.suppress(ValueError):  # a header
            rows.append([float(one) for one in line.replace(",", " ").split()])
    table = np.array(rows)
    return (np.arange(len(table)) / 1000.0, table[:, 0]) if table.shape[1] == 1 else (table[:, 0], table[:, 1])


@cache
def crests(name: str) -> tuple[Array, Array]:
    """Return times [s] and values of the maxima and minima, in turn, within the stretch that the answer names.

    They are those of the samples, of their running mean over a tenth of a half period where that has several samples,
    at least 0.7 half periods apart and 6 % of the range deep.
    """
    (t, x), half, found = columns(name), RECORDS[name][1], analysed(name)
    size = max(1, round(0.1 * half / float(np.median(np.diff(t)))))
    x, t = np.convolve(x, np.ones(size) / size, mode="valid"), t[(size - 1) // 2 :][: t.size - size + 1]
    inside = (t >= found["start_s"] - 0.1 * half) & (t <= found["stop_s"])
    x, t = x[inside], t[inside]
    apart = max(1, int(0.7 * half / float(np.median(np.diff(t)))))
    deep = {"distance": apart, "prominence": 0.06 * float(np.ptp(x))}
    index = np.sort(np.concatenate([find_peaks(x, **deep)[0], find_peaks(-x, **deep)[0]]))
    return t[index], x[index]


def counted(times_s: Array, values: Array) -> tuple[float, float]:
    """Return frequency [Hz] and damping ratio of crests, both means weighted by the amplitude, as the answer's are.

    Halves of the swings from crest to crest are the amplitudes a of the half cycles, of lengths h: the mean of ω is
    π Σ a/Σ a h and that of λ the fall of a over the area Σ a h between the middles of first and last.
    """
    size, half = 0.5 * np.abs(np.diff(values)), np.diff(times_s)
    omega = np.pi * size.sum() / float(size @ half)
    middle = 0.5 * (times_s[1:] + times_s[:-1])
    rate = (size[0] - size[-1]) / float(0.5 * (size[1:] + size[:-1]) @ np.diff(middle))
    return omega / (2.0 * np.pi), rate / float(np.hypot(omega, rate))


def holds(found: dict[str, Any], value: float, uncertain: float) -> bool:
    """Return whether a 90 % interval holds a counted value that is uncertain itself."""
    low, high = found["interval90"]
    return bool(low - uncertain <= value <= high + uncertain)


@each_record
def test_the_stated_frequency_is_that_of_the_counted_crests(name: str) -> None:
    times, values = crests(name)
    frequency, _ = counted(times, values)
    # a crest among noise and samples is known to a twentieth of a half cycle, at either end of the count
    assert holds(analysed(name)["frequency_hz"], frequency, 0.05 * np.sqrt(2.0) / (times.size - 1) * frequency)


@each_record
def test_the_stated_damping_is_that_of_the_counted_crests_within_ten_percent(name: str) -> None:
    _, damping = counted(*crests(name))
    assert holds(analysed(name)["damping_ratio"], damping, 0.1 * damping)


def test_the_crests_that_the_author_of_the_string_pendulum_marked_lie_in_both_intervals() -> None:
    marked = {
        0.2366: -1.44436, 1.1831: 1.36847, 2.0958: -1.33197, 3.0423: 1.28095, 3.9211: -1.25435, 4.8676: 1.20907,
        5.7465: -1.17145, 6.6254: 1.14072, 7.5380: -1.11472, 8.4507: 1.07742,
    }  # fmt: skip
    frequency, damping = counted(np.array(list(marked)), np.array(list(marked.values())))
    found = analysed("tian_string_pendulum.txt")
    assert holds(found["frequency_hz"], frequency, 0.0)
    assert holds(found["damping_ratio"], damping, 0.0)


def test_the_damping_of_the_building_model_by_its_authors_rule_lies_in_the_interval() -> None:
    decrement = np.log(1.0703 / 0.1203) / 13  # from the second to the fifteenth maximum of its samples
    assert holds(analysed("choudhary_building_model.csv")["damping_ratio"], decrement / (2.0 * np.pi), 0.0)


def test_the_period_of_the_bicycle_fork_is_its_authors_mean_over_trials_within_one_percent() -> None:
    assert analysed("moore_bicycle_fork_gyro.csv")["frequency_hz"]["value"] == pytest.approx(1 / 1.60185, rel=0.01)


def test_intervals_of_large_and_of_small_swings_meet_in_85_of_100_pairs_of_public_decays() -> None:
    pairs: list[Halves] = []
    for name in RECORDS:
        record = columns(name)
        with contextlib.suppress(SinewError):  # a half of less than three half cycles
            pairs += halves_of(*record, analyse_ring_down(*record, unit="1"), unit="1")
    assert len(pairs) >= 10
    assert np.mean([pair.meet for pair in pairs]) >= 0.85
