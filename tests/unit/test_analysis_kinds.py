"""The kind of a record is found: made records of every kind (more: `tests.experiments.kinds`), and those of others."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from tests.experiments.kinds import MANNERS, record, run_trial

import sinew as sn
from sinew.analysis.kinds import find_kind

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
real = pytest.mark.skipif(not DATA.is_dir(), reason="no folder ../shared/data with recordings by others")


def read(table: pd.DataFrame, **more: Any) -> Any:
    return sn.read(table, time="t", response="x", drive="u" if "u" in table else None, **more)


@pytest.mark.parametrize("manner", MANNERS, ids=lambda manner: manner.__name__)
def test_the_kind_of_a_record_is_found(manner: Any) -> None:
    index = list(MANNERS).index(manner)
    assert [run_trial((index, seed)).found for seed in (0, 1, 2)] == [MANNERS[manner]] * 3


@pytest.mark.slow
def test_of_a_hundred_records_none_is_taken_for_another_kind_and_few_are_refused() -> None:
    rows = [run_trial((index, seed)) for index in range(len(MANNERS)) for seed in range(100, 110)]
    assert [row for row in rows if row.found not in (row.kind, "")] == []
    assert sum(not row.found for row in rows) <= 5


RING_DOWNS = [
    *sorted((DATA / "silicone_beam_dragonskin10").glob("*.csv")),
    *sorted((DATA / "torsion_spring_pendulum").glob("*.csv")),
    *sorted((DATA / "rotary_pendulum_swing").glob("pendulum*.txt")),
]


def decay_of(path: Path) -> pd.DataFrame:
    if path.suffix == ".txt":
        angle = np.loadtxt(path, skiprows=2)
        return pd.DataFrame({"t": np.arange(angle.size) / 1000, "x": angle})
    table = pd.read_csv(path)
    if "angle_deg" in table:
        return pd.DataFrame({"t": table["host_time_s"], "x": table["angle_deg"]})
    return pd.DataFrame({"t": table["t_s"], "x": table[[f"Tip-{k}_x_m" for k in (1, 2, 3)]].mean(axis=1)})


@real
@pytest.mark.parametrize("path", RING_DOWNS, ids=lambda path: path.stem)
def test_a_decay_that_others_measured_is_taken_for_one(path: Path) -> None:
    assert find_kind(read(decay_of(path))).kind == "ring-down"


@real
def test_a_walking_trunk_is_no_kind_of_record_and_says_which_there_are() -> None:
    with np.load(DATA / "qmt_walking_imu" / "walking.npz") as walk:
        gyro = next(walk[name] for name in walk.files if name.endswith("gyr"))
        table = pd.DataFrame({"t": walk["t"], "x": gyro[:, 0]})
    with pytest.raises(sn.RecordingError, match="sweep, broadband or impact"):
        find_kind(read(table))


def test_a_response_that_goes_on_swinging_without_a_drive_is_refused() -> None:
    t = np.arange(0, 30, 0.01)
    x = np.sin(2 * np.pi * 3 * t) + 0.01 * np.random.default_rng(1).standard_normal(t.size)
    with pytest.raises(sn.RecordingError, match="the swings of the response do not fall"):
        find_kind(read(pd.DataFrame({"t": t, "x": x})))


def test_auto_answers_as_the_kind_would_and_says_why() -> None:
    table = record(next(manner for manner in MANNERS if MANNERS[manner] == "sweep"), 1)
    said, found = (sn.analyse(read(table, kind=kind)) for kind in ("sweep", "auto"))
    document = found.to_dict()
    assert document.pop("kind_reason").startswith("the drive holds")
    assert document == said.to_dict()
    assert found.notes[0].startswith("taken for a sweep of steady stretches: the drive holds")


def test_a_record_of_which_two_kinds_are_possible_is_refused_with_both() -> None:
    # a sine that is held for a third of the time and runs away from there
    t = np.arange(0, 60, 0.01)
    frequency = np.where(t < 20, 3.0, 3.0 + 0.15 * (t - 20))
    drive = np.sin(2 * np.pi * np.cumsum(frequency) / 100)
    with pytest.raises(sn.RecordingError, match="its kind can be sweep or broadband"):
        find_kind(read(pd.DataFrame({"t": t, "x": np.roll(drive, 5), "u": drive})))


def test_a_word_that_is_no_kind_is_refused() -> None:
    with pytest.raises(sn.SpecError, match="expected one of auto, ring-down, sweep, broadband, impact"):
        sn.analyse(read(record(next(iter(MANNERS)), 0)), kind="swep")  # type: ignore[arg-type]
