"""The command `sinew predict`: its JSON document and its refusals."""

import json

import pytest
from tests.contracts.commands import command_lines, refused

from sinew.apps.cli import main

OSCILLATOR = "inertia_kg_m2=12.74e-3,frequency_hz=3,damping_ratio=0.05,cubic_n_m_rad3=6"
BRANCH = {"pretension_mm", "frequency_hz", "amplitude_deg", "phase_deg", "stable", "folds", "peak", "phase_90"}


def test_an_oscillator_becomes_one_branch_with_folds_peak_and_phase(capsys: pytest.CaptureFixture[str]) -> None:
    status = main(
        ["predict", "--oscillator", OSCILLATOR, "--torque-n-m", "0.45", "--from-hz", "1", "--to-hz", "6", "--json"]
    )
    document = json.loads(capsys.readouterr().out)
    (branch,) = document["branches"]
    assert status == 0
    assert {"branches", "harmonics", "error_estimate", "wall_s"} <= set(document)
    assert set(branch) >= BRANCH
    assert [round(fold["frequency_hz"], 6) for fold in branch["folds"]] == [3.818697, 3.521591]
    assert branch["peak"]["amplitude_deg"] == pytest.approx(max(branch["amplitude_deg"]), rel=1e-3)
    largest = max(zip(branch["fundamental_deg"], branch["frequency_hz"], strict=True))
    assert branch["fundamental_peak"]["amplitude_deg"] == pytest.approx(largest[0], rel=1e-3)
    assert branch["fundamental_peak"]["frequency_hz"] == pytest.approx(largest[1], rel=5e-3)
    assert len(branch["frequency_hz"]) == len(branch["phase_deg"]) == len(branch["stable"])


def test_without_json_there_is_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    main(["predict", "--oscillator", OSCILLATOR, "--base-deg", "2"])
    out = capsys.readouterr().out
    assert all(head in out for head in ("peak (Eq. 6)", "peak of the fundamental", "90° of phase"))


@command_lines(f"""
    => expected a RIG, FIT.json, --oscillator, or options of a joint
    paper --oscillator {OSCILLATOR} => and this is an oscillator
    --oscillator {OSCILLATOR} => --torque-n-m or --base-deg
    --oscillator mass=1 --torque-n-m 1 => mass=1
    --oscillator frequency_hz=3 --torque-n-m 1 => lacks inertia_kg_m2
    --oscillator frequency_hz=x --torque-n-m 1 => found 'x', expected a number
    --oscillator {OSCILLATOR} --torque-n-m 1 --from-hz 4 --to-hz 2 => from 4 to 2 Hz
    paper --torque-n-m 1 => --torque is for a fit (FIT.json) or an oscillator (--oscillator), and this is a rig
    paper --pretension-mm -1 => cables cannot push
    paper --mode velocity => 'velocity', expected one of
""")
def test_what_cannot_be_meant_is_refused_in_one_line(
    arguments: tuple[str, ...], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in refused(capsys, "predict", *arguments)
