"""What holds for the time stamps of any logger."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.measure.timing import diagnose_times, straighten_times

STEPS = st.floats(1e-4, 0.5)
SAMPLES = st.integers(100, 600)


@given(STEPS, SAMPLES, st.floats(0.05, 0.95), st.integers(3, 2000))
@settings(max_examples=80, deadline=None)
def test_a_gap_of_any_length_anywhere_is_found_with_its_length(
    step: float, samples: int, where: float, missing: int
) -> None:
    index = np.arange(samples)
    after = int(where * samples)
    index[after + 1 :] += missing
    assert [(gap.after, gap.missing) for gap in diagnose_times(step * index).gaps] == [(after, missing)]


@given(STEPS, SAMPLES, st.floats(0.1, 0.8), st.integers(5, 20))
@settings(max_examples=80, deadline=None)
def test_samples_that_were_stamped_late_are_never_missing(
    step: float, samples: int, where: float, waiting: int
) -> None:
    stamps = step * np.arange(samples)
    first = int(where * samples)
    last = min(first + waiting, samples - 1)
    stamps[first : last + 1] = stamps[last]
    assert diagnose_times(stamps).gaps == ()


@given(st.integers(0, 2**32 - 1), STEPS, st.integers(200, 600), st.integers(4, 12))
@settings(max_examples=60, deadline=None)
def test_straightened_time_always_increases(seed: int, step: float, samples: int, buffer: int) -> None:
    late = np.random.default_rng(seed).integers(0, buffer, samples) * step
    stamps = np.maximum.accumulate(step * np.arange(samples) + late)
    assert (np.diff(straighten_times(stamps, gaps="split").time_s) > 0).all()


@given(st.integers(0, 2**32 - 1), st.floats(-100, 100), st.floats(1e-3, 1e3))
@settings(max_examples=40, deadline=None)
def test_the_pattern_does_not_depend_on_the_origin_or_the_unit_of_time(seed: int, origin: float, unit: float) -> None:
    stamps = np.cumsum(np.random.default_rng(seed).uniform(0.002, 0.018, 300))
    assert diagnose_times(origin + unit * stamps).pattern == diagnose_times(stamps).pattern
