"""Which model a record supports: held-out prediction, information criterion, residuals."""

import numpy as np
import pytest
from tests.unit.identify_signals import OMEGA, chirp, dry_decay, duffing_sweep, motion, noisy, viscous

from sinew.identify.comparison import Comparison, compare, compare_laws
from sinew.identify.fit import fit
from sinew.identify.held_out import fit_and_predict, split_record
from sinew.identify.model import MODELS
from sinew.identify.record import Record, make_record
from sinew.identify.residual_tests import ask_residuals
from sinew.measure.errors import RecordingError, SpecError

DECAY = np.arange(0, 6, 0.01)


def viscous_decay(damping_ratio: float, seed: int) -> Record:
    x = motion(viscous(damping_ratio), lambda t: 0.0, DECAY, (0.5, 0.0))[0]
    return make_record(DECAY, noisy(x, 0.003, seed), output_unit="rad")


def dry(seed: int) -> Record:
    return make_record(DECAY, noisy(dry_decay(DECAY, 0.5, 0.0, 0.8, 0.02), 0.003, seed), output_unit="rad")


def laws(record: Record) -> Comparison:
    return compare(split_record(record, None, None), [MODELS[name] for name in ("linear", "loss-factor", "coulomb")])


def test_dry_friction_is_found_in_nine_of_ten_decays() -> None:
    assert sum(laws(dry(seed)).best.model.name == "coulomb" for seed in range(10)) >= 9


def test_viscous_damping_is_found_in_nine_of_ten_strongly_damped_decays() -> None:
    found = [laws(viscous_decay(0.17, seed)) for seed in range(10)]
    assert sum(one.best.model.name == "linear" and one.decided for one in found) >= 9


def test_a_weakly_damped_decay_cannot_tell_viscous_damping_from_a_loss_factor() -> None:
    assert "cannot tell viscous damping from a constant loss factor" in laws(viscous_decay(0.02, 1)).verdict


def test_the_cubic_spring_of_the_sweep_is_found_among_the_stiffness_laws() -> None:
    split = split_record(duffing_sweep(), None, None)
    found = compare(split, [MODELS[name] for name in ("linear", "cubic", "cubic-quadratic")])
    assert found.best.model.name == "cubic"


def test_auto_chooses_stiffness_and_damping_of_a_decay() -> None:
    assert compare_laws(split_record(dry(3), None, None)).best.model.name == "coulomb"


def test_held_out_samples_do_not_move_the_fit() -> None:
    record = viscous_decay(0.1, 0)
    split = split_record(record, (0, 400), (400, 600))
    spoilt = make_record(DECAY, np.where(DECAY < 4, record.output, 1.0), output_unit="rad")
    one, other = (fit_and_predict(part, "linear").fit for part in (split, split_record(spoilt, (0, 400), (400, 600))))
    assert one.damping_ratio.value == other.damping_ratio.value


def test_a_range_beyond_the_record_is_refused() -> None:
    with pytest.raises(SpecError, match="600"):
        split_record(viscous_decay(0.1, 0), (0, 400), (400, 601))


def test_a_range_of_a_few_samples_is_refused() -> None:
    with pytest.raises(RecordingError, match="holds 10 samples"):
        split_record(viscous_decay(0.1, 0), (0, 10), None)


def test_residuals_of_the_right_model_are_white_in_nine_of_ten_records() -> None:
    asked = [
        ask_residuals(r, fit(r, "linear").residuals()[0], OMEGA) for r in (viscous_decay(0.1, s) for s in range(10))
    ]
    assert sum(one.white_p > 0.01 for one in asked) >= 9


def test_residuals_of_a_linear_spring_grow_with_the_amplitude_of_a_cubic_one() -> None:
    time = np.arange(0, 30, 0.01)
    phase = chirp(1, 6, 30)
    r = motion(viscous(0.05, cubic=470.0), lambda t: 15 * np.sin(phase(t)), time)[0]
    record = make_record(time, noisy(r, 0.002, 1), 15 * np.sin(phase(time)), excitation="force")
    asked = ask_residuals(record, fit(record, "linear").residuals()[0], OMEGA)
    assert "residuals grow with amplitude" in asked.sentences()
