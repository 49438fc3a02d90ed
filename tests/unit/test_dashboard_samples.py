"""A run's samples in pieces: no extreme is lost, pieces join, and a clock that begins anew follows the one before."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinew.apps.dashboard.work import samples
from sinew.bench.record.journal import Journal, JournalReader
from sinew.bench.record.sample import Sample
from sinew.measure.recording import Segment
from sinew.plan.toml import dump_plan, dump_rig, load_plan, load_rig

RATE_HZ, SWING_HZ, SPIKE, BEGAN_S = 200.0, 3.0, 4321, 500.0
COUNT = int(400 * RATE_HZ)
DRIVE, TORSION = 1, 2


def sample(index: int, began: float = BEGAN_S) -> Sample:
    """A swing of the torsion by 10°, and of the lever by 20°, whose encoder once tells 90°."""
    time = index / RATE_HZ
    angle = 2 * math.pi * SWING_HZ * time
    drive = math.radians(90.0 if index == SPIKE else 20.0 * math.sin(angle))
    rate = math.radians(10.0) * 2 * math.pi * SWING_HZ * math.cos(angle)
    four = (0.1,) * 4
    now = began + time
    return Sample(now, now, 0.1, drive, 0.3, 0.2, four, four, four, (rate, 0.0, 0.0), (9.81, 0.0, 0.0), 0.01, 1e-4)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run of 400 s."""
    made = tmp_path_factory.mktemp("runs") / "one"
    made.mkdir()
    with Journal.create(made / "journal.sqlite", dump_plan(load_plan("short")), dump_rig(load_rig("paper"))) as journal:
        journal.begin_segment(0, 0, Segment("steady", 4.0, SWING_HZ, 20.0, 0))
        for index in range(COUNT):
            journal.append(sample(index))
    return made


def piece(folder: Path, level: int, number: int) -> dict[str, Any]:
    """Return a piece."""
    found = json.loads(samples.samples_piece(str(folder), level, number))
    return {key: np.array(found[key] or found["low"], dtype=float) for key in ("time", "low", "high")}


def span(level: int) -> float:
    return samples.PIECE_BINS * 2**level / samples.FINEST_HZ


@pytest.mark.parametrize("level", [0, 4, 7, 9, 10, 13])
def test_a_single_odd_sample_is_seen_at_every_width(folder: Path, level: int) -> None:
    at = SPIKE / RATE_HZ
    found = piece(folder, level, int(at // span(level)))
    highest = int(np.argmax(found["high"][DRIVE]))
    assert found["high"][DRIVE].max() == pytest.approx(90.0)
    assert 0 <= at - found["time"][highest] < 2**level / samples.FINEST_HZ + 1e-4


def test_pieces_hold_every_sample_once(folder: Path) -> None:
    times = np.concatenate([piece(folder, 2, number)["time"] for number in range(40)])
    assert np.allclose(times, np.arange(times.size) / RATE_HZ, atol=1e-4)
    assert times.size == int(40 * span(2) * RATE_HZ)


def test_the_torsion_goes_on_from_piece_to_piece(folder: Path) -> None:
    torsion = np.concatenate([piece(folder, 2, number)["low"][TORSION] for number in range(10, 60)])
    begin = 10 * span(2)
    expected = 10.0 * np.sin(2 * np.pi * SWING_HZ * (begin + np.arange(torsion.size) / RATE_HZ))
    assert np.abs(torsion - expected).max() < 0.3  # the leak leads by 1°
    assert np.abs(np.diff(torsion)).max() < 1.05 * np.abs(np.diff(expected)).max()


def test_a_long_piece_comes_little_by_little(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    samples._part.cache_clear()
    monkeypatch.setattr(samples, "monotonic", lambda: float(samples._part.cache_info().misses))  # a part takes a second
    shares = [json.loads(samples.samples_piece(str(folder), 10, 0))["share"] for _ in range(4)]
    assert shares == [0.25, 0.5, 0.75, 1.0]


def test_a_run_that_was_taken_up_again_goes_on_a_second_later(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    for opened, began in ((False, 900.0), (True, 40.0)):  # the clock of a computer that was begun anew
        words = (dump_plan(load_plan("short")), dump_rig(load_rig("paper")))
        with Journal.open(path, *words) if opened else Journal.create(path, *words) as journal:
            for index in range(200):
                journal.append(sample(index, began))
    with JournalReader(path) as journal:
        first = journal.first_samples()
    found = {key: np.hstack([piece(tmp_path, 2, number)[key] for number in (0, 1)]) for key in ("time", "low")}
    known = np.isfinite(found["low"][DRIVE])
    assert first == [1, 201]
    assert found["time"][known][[0, 199, 200, 399]] == pytest.approx([0.0, 0.995, 1.995, 2.99])
    assert np.isnan(found["low"][DRIVE]).sum() == 1  # where the line is broken


def test_a_spectrum_finds_a_swing_at_its_frequency(folder: Path) -> None:
    found = json.loads(samples.samples_spectrum(str(folder), 100.0, 110.0))
    amplitude = np.array(found["amplitude"][DRIVE])
    at = int(np.argmax(amplitude))
    assert found["frequency_hz"][at] == pytest.approx(SWING_HZ, abs=found["resolution_hz"])
    assert amplitude[at] == pytest.approx(20.0, rel=0.02)
