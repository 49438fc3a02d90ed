"""`sinew identify` on bad input: refused in one line, or a result whose message names what is wrong."""

from pathlib import Path

import numpy as np
import pytest
from tests.contracts.commands import command_lines
from tests.contracts.identify_sweep import (
    COLUMNS,
    PHASE,
    TIME,
    identified,
    push,
    unidentified,
    write,
)
from tests.unit.identify_signals import OMEGA, motion, noisy, viscous


def test_a_constant_input_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write(tmp_path / "a.csv", t=TIME, u=np.ones_like(TIME), y=np.sin(OMEGA * TIME))
    assert "input is constant" in unidentified(capsys, file, *COLUMNS)


@pytest.mark.slow
def test_swapped_columns_are_named(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    swapped = ("--time", "t", "--input", "y:V", "--output", "u:V", "--excitation", "force", "--model", "linear")
    assert "swapped" in identified(capsys, sweep, *swapped)["message"]


def test_sampling_too_slow_for_the_resonance_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(0, 20, 1 / 7)
    file = write(tmp_path / "a.csv", t=t, u=np.cos(OMEGA * t), y=np.sin(OMEGA * t))
    assert "too slow" in unidentified(capsys, file, *COLUMNS)


def test_a_record_of_one_period_is_refused_as_too_short(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(0, 0.45, 0.01)
    file = write(tmp_path / "a.csv", t=t, y=np.exp(-t) * np.cos(OMEGA * t))
    assert "too short" in unidentified(capsys, file, "--time", "t", "--output", "y", "--excitation", "none")


@pytest.mark.slow
def test_a_lever_taken_for_a_force_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lever = lambda t: 0.3 * np.sin(PHASE(t))  # noqa: E731
    h = 1e-4
    r = motion(viscous(0.1), lambda t: -0.6 * (lever(t + h) - 2 * lever(t) + lever(t - h)) / h**2, TIME)[0]
    file = write(tmp_path / "a.csv", t=TIME, u=lever(TIME), y=noisy(r, 0.002, 3))
    columns = ("--time", "t", "--input", "u:rad", "--output", "y:rad", "--excitation", "torque", "--model", "linear")
    assert "excitation torque looks wrong: as lever" in identified(capsys, file, *columns)["message"]


@command_lines("""
    --model quartic => linear
    --model tendon => recording of a rig
    --excitation wind => force
    --rig paper => --rig is for
    --pretension 4 => --pretension is for
    --train 5 => A:B
    --train 0:8 => at least 16
    --train 900:400 => A < B
    --train 0:99999 => 1600
    --train 0:800 --test 1500:1700 => 1600
""")
def test_an_option_that_cannot_be_meant_is_refused_with_what_was_expected(
    sweep: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], sentence: str
) -> None:
    assert sentence in unidentified(capsys, sweep, *COLUMNS, *arguments)


def test_the_rate_may_stand_beside_the_stamps_it_agrees_with(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert identified(capsys, sweep, *COLUMNS, "--rate", "100", "--model", "linear")["converged"]
    assert "--rate is 50 Hz" in unidentified(capsys, sweep, *COLUMNS, "--rate", "50", "--model", "linear")


def damaged(folder: Path, kind: str) -> Path:
    """A file or folder that holds no usable record."""
    path = folder / "a.csv"
    rows = [f"{t:.2f},{np.sin(OMEGA * t):.5f},{np.cos(OMEGA * t):.5f}" for t in np.arange(0, 4, 0.01)]
    if kind == "folder":
        path.mkdir()
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "bytes":
        path.write_bytes(bytes(range(256)) * 40)
    elif kind == "ten rows":
        rows = rows[:10]
    if not path.exists() and kind != "absent":
        path.write_text("\n".join(["t,u,y", *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("folder", "folder"),
        ("empty", "empty"),
        ("bytes", "binary"),
        ("absent", "cannot read"),
        ("ten rows", "10 samples"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, words: str
) -> None:
    said = unidentified(capsys, damaged(tmp_path, kind), *COLUMNS)
    assert words in said
    assert said.count("\n") == 1


@command_lines("""
    --time t --input uu:V --output y:V --excitation force => no column 'uu', did you mean
    --time t --input u:V --output y:V => --excitation
    --time t --output y:V --excitation force => no input is given
    --time t --input u:V --output y:V --excitation none => leave the
    --time t --excitation none => --output COL is missing (output=) and u or y may be it; there are t, u, y
    --time t --input u:V --output y:V --excitation force --gaps bridge => what the input did in a gap is not known
    --time t --input u:V --output y:V --excitation force --gaps split --train 0:99 => leave one of them out
    --time t --output y --gaps bridge --train 0:99 => leave one of them out
    --time t --output y --run 2 => has no run '2'; it holds 1
    --time t:mm --input u:V --output y:V --excitation force => 'mm'
    --time t --input u:furlongg --output y:V --excitation force => furlongg
    --time t --input 'u:N*m' --output y:rad --excitation lever => no motion
    --time t --input u:N --output y:mm --excitation base => force or torque
    --rate -5 --input u:V --output y:V --excitation force => --rate is -5
""")
def test_a_question_that_cannot_be_answered_is_refused_in_one_line(
    sweep: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], sentence: str
) -> None:
    assert sentence in unidentified(capsys, sweep, *arguments)


def test_a_training_range_of_one_period_is_refused_as_too_short(
    sweep: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "too short" in unidentified(capsys, sweep, *COLUMNS, "--train", "0:40")


def test_an_input_in_the_unit_of_a_motion_is_no_force(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    response = noisy(motion(viscous(0.1), push, TIME)[0], 0.002, 1)
    file = write(tmp_path / "a.csv", t=TIME, u=push(TIME), y=response)
    columns = ("--time", "t", "--input", "u:mm", "--output", "y:mm", "--excitation", "force", "--model", "linear")
    assert "the input is in m, which is no force" in identified(capsys, file, *columns)["message"]


def test_one_column_for_both_is_refused(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    columns = ("--time", "t", "--input", "u:V", "--output", "u:V", "--excitation", "force")
    assert "the same numbers" in unidentified(capsys, sweep, *columns)


def test_a_gap_is_refused_with_what_this_command_can_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.concatenate([TIME[:300], TIME[500:]])
    file = write(tmp_path / "a.csv", t=t, u=push(t), y=np.sin(OMEGA * t))
    said = unidentified(capsys, file, *COLUMNS)
    assert "gap of 2.01 s" in said
    assert "--gaps split" in said


@pytest.mark.parametrize(
    "options", [("--gaps", "split"), ("--start", "5"), ("--train", "300:800", "--test", "800:1000")]
)
def test_a_gap_that_is_not_in_the_part_that_is_fitted_does_no_harm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...]
) -> None:
    t = np.concatenate([TIME[:300], TIME[500:]])
    response = noisy(motion(viscous(0.1), push, TIME)[0], 0.002, 1)
    file = write(tmp_path / "a.csv", t=t, u=push(t), y=np.concatenate([response[:300], response[500:]]))
    assert identified(capsys, file, *COLUMNS, "--model", "linear", *options)["model"] == "linear"


def test_stamps_that_were_straightened_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    response = noisy(motion(viscous(0.1), push, TIME)[0], 0.002, 1)
    late = 0.05 * np.ceil(TIME / 0.05)  # five samples wait for one another
    file = write(tmp_path / "a.csv", t=late, u=push(TIME), y=response)
    assert "time stamps replaced" in identified(capsys, file, *COLUMNS, "--model", "linear")["message"]


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("")
    assert "cannot write" in unidentified(capsys, sweep, *COLUMNS, "--out", tmp_path / "out" / "deeper")


@pytest.mark.parametrize(("missing", "said"), [(slice(100, 112), None), (slice(100, 140), "longer than half a period")])
def test_a_gap_of_a_free_decay_is_bridged_where_it_is_shorter_than_half_a_period(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], missing: slice, said: str | None
) -> None:
    t = np.arange(0, 4, 0.01)
    noise = np.random.default_rng(4).normal(0, 0.1, t.size)
    kept = np.delete(np.arange(t.size), missing)
    swing = 20 * np.exp(-0.6 * t) * np.cos(6 * np.pi * t) + noise
    file = write(tmp_path / "a.csv", t=t[kept], x_deg=swing[kept])
    options = ("--model", "linear", "--start", "0", "--gaps", "bridge")
    if said is not None:
        assert said in unidentified(capsys, file, *options)
        return
    found = identified(capsys, file, *options)
    assert found["natural_frequency_hz"]["value"] == pytest.approx(np.hypot(6 * np.pi, 0.6) / (2 * np.pi), rel=3e-4)
    assert found["damping_ratio"]["value"] == pytest.approx(0.6 / np.hypot(6 * np.pi, 0.6), rel=1e-2)
