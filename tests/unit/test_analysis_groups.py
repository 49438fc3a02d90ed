"""Foreign sweeps, taken apart by their drive alone."""

import numpy as np
import pytest
from tests.unit.analysis_sweep import Joint

from sinew.analysis.signal.harmonics import split_by_drive
from sinew.analysis.sweep.resonance import estimate_resonance
from sinew.analysis.sweep.response import estimate_response
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.files.netcdf import provenance
from sinew.measure.recording import Segment, build_recording

JOINT = Joint(damping=0.1)
FREQUENCY_HZ = np.arange(2.0, 5.0, 0.15)


def one_segment(time_s, drive, torsion):
    samples = {"time_s": time_s, "drive_rad": drive, "torsion_rad": torsion}
    return build_recording(samples, [Segment("steady", 0.0, np.nan, np.nan, 0)], [time_s.size], provenance("import"))


def stepped(frequency_hz, *, periods=30, pause_s=0.0, noise=2e-3, jitter_s=0.5e-3, seed=0):
    """A stepped sine of 17.2° at 100 Hz as somebody else would record it: one stretch, each step with its transient."""
    random = np.random.default_rng(seed)
    time, drive, torsion = [], [], []
    clock, phase = 0.0, 0.0
    for f in frequency_hz:
        steps = np.arange(int(periods / f * 100)) / 100
        angle = phase + 2 * np.pi * f * steps
        free = 2 * np.pi * JOINT.natural_hz * (1j - JOINT.damping)
        time.append(clock + steps)
        drive.append(0.3 * np.sin(angle))
        torsion.append(0.3 * (JOINT.transfer(f) * np.exp(1j * angle)).imag + 0.15 * np.exp(free * steps).real)
        clock, phase = clock + steps.size / 100, phase + 2 * np.pi * f * steps.size / 100
        if pause_s:
            rest = np.arange(int(pause_s * 100)) / 100
            time.append(clock + rest)
            drive.append(0 * rest)
            torsion.append(0 * rest)
            clock, phase = clock + rest.size / 100, 0.0
    columns = [np.concatenate(c) for c in (time, drive, torsion)]
    size = columns[0].size
    columns[0] = columns[0] + jitter_s * random.uniform(-1, 1, size)
    return one_segment(
        columns[0], columns[1] + noise * random.normal(size=size), columns[2] + noise * random.normal(size=size)
    )


def steady(recording, name):
    return recording[name].values[recording["kind"].values == "steady"]


@pytest.mark.parametrize(
    "options", [{}, {"pause_s": 1.0}, {"noise": 0.015}, {"noise": 0.015, "pause_s": 0.7, "periods": 14}]
)
def test_every_step_of_a_stepped_sine_is_found_with_its_frequency(options) -> None:
    found = split_by_drive(stepped(FREQUENCY_HZ, **options))
    np.testing.assert_allclose(steady(found, "frequency_hz"), FREQUENCY_HZ, rtol=5e-4)


def test_a_foreign_stepped_sine_gives_the_joints_resonance() -> None:
    resonance = estimate_resonance(estimate_response(split_by_drive(stepped(FREQUENCY_HZ, periods=40))))
    assert resonance["resonance_hz"].item() == pytest.approx(JOINT.resonance_hz, rel=1e-3)


def test_a_frequency_that_comes_again_is_the_next_repeat() -> None:
    found = split_by_drive(stepped([2.5, 3.0, 3.5, 3.0, 2.5]))
    assert steady(found, "repeat").tolist() == [0, 0, 0, 1, 1]


def test_a_sweep_without_drive_is_refused() -> None:
    with pytest.raises(RecordingError, match="needs a drive signal"):
        split_by_drive(stepped([3.0]).drop_vars("drive_rad"))


T = np.arange(0, 60, 0.01)


@pytest.mark.parametrize(
    "drive",
    [
        np.sin(2 * np.pi * (T + T**2 / 30)),
        np.random.default_rng(0).normal(size=T.size),
        0 * T,
    ],
    ids=["chirp", "noise", "still"],
)
def test_a_drive_that_holds_no_frequency_is_refused(drive: np.ndarray) -> None:
    with pytest.raises(RecordingError, match="no group of constant drive frequency"):
        split_by_drive(one_segment(T, drive, drive))


def settled_for(recording) -> np.ndarray:
    """Return how long each settle segment before a steady one lasts [s]."""
    sizes, kinds = recording["row_size"].values, recording["kind"].values
    return sizes[kinds == "settle"] / 100


def test_a_given_settle_time_is_set_aside_at_the_start_of_each_frequency() -> None:
    settled = settled_for(split_by_drive(stepped(FREQUENCY_HZ), settle_s=3.0))
    # and up to a period and a bit more, for what follows is whole periods
    assert np.all((settled >= 2.9) & (settled <= 3.0 + 3.2 / FREQUENCY_HZ))


def test_a_settle_time_longer_than_the_group_is_refused() -> None:
    with pytest.raises(RecordingError, match="a settle time of 20 s leaves no whole period"):
        split_by_drive(stepped([3.0]), settle_s=20.0)


@pytest.mark.parametrize("settle_s", [-1.0, np.nan, np.inf])
def test_a_settle_time_that_is_none_is_refused(settle_s: float) -> None:
    with pytest.raises(SpecError, match="s to settle"):
        split_by_drive(stepped([3.0]), settle_s=settle_s)
