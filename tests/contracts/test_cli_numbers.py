"""Numbers and words on the command line that nobody can mean: refused in one line, before anything is computed."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
import typer

from sinew.apps.cli import app, main
from sinew.apps.console import NumbersCommand
from sinew.predict.validity import Check, doubt_broken_curves

PREDICT = ("predict", "paper", "--pretension-mm", "4")
OSCILLATOR = ("predict", "--oscillator", "inertia_kg_m2=0.01,frequency_hz=3,damping_ratio=0.05", "--torque-n-m", "0.1")
TRANSFER = ("model", "paper", "--to", "control", "--pretension-mm", "4")
COMPARE = ("predict", "paper", "paper", "--pretension-mm", "4")
TUNE = ("tune", "paper", "--resonance-hz", "3.2")
TRACK = ("track", "paper", "--emulate", "--pretension-mm", "4", "--out", "track")
DESIGN = ("design", "--stride-hz", "0.7:1.1", "--yaw-deg", "7")
CIRCLE = ("joint", "paper", "--section", "circle", "--outer-mm", "60")
RING = ("joint", "paper", "--section", "annulus", "--outer-mm", "60", "--inner-mm", "30")
ELLIPSE = ("joint", "paper", "--section", "ellipse", "--width-mm", "60", "--height-mm", "50")
STAR = ("joint", "paper", "--section", "star", "--outer-mm", "60", "--inner-mm", "30", "--star-points", "5")
RUN = ("run", "short", "--port", "nowhere", "--out", "run")
EMULATE = ("emulate", "--for", "1")

NEVER = ("nan", "inf", "-1", "1e9", "")
ASKED: list[tuple[tuple[str, ...], str, tuple[str, ...]]] = [
    *((PREDICT, option, NEVER) for option in ("--pretension-mm", "--amplitude-deg", "--to-hz", "--from-hz", "--bands")),
    (PREDICT, "--pretension-mm", ("400", "16.01", "4,,8", "4,nan", "1,5; 2,5", "0, -0.1")),
    (PREDICT, "--from-hz", ("0", "6")),
    *((PREDICT, option, NEVER) for option in ("--seed", "--length-mm", "--head-mass-kg")),
    (PREDICT, "--bend-deg", (*NEVER, "61")),
    ((*PREDICT, "--bend-deg", "20"), "--azimuth-deg", ("nan", "inf", "1e9", "")),
    *((OSCILLATOR, option, ("nan", "inf", "")) for option in ("--torque-n-m", "--from-hz", "--to-hz")),
    (OSCILLATOR, "--oscillator", ("inertia_kg_m2=nan,frequency_hz=3,damping_ratio=0.05", "")),
    *((TRANSFER, option, NEVER) for option in ("--pretension-mm", "--amplitude-deg", "--from-hz", "--to-hz")),
    (TRANSFER, "--pretension-mm", ("400",)),
    *((COMPARE, option, NEVER) for option in ("--pretension-mm", "--amplitude-deg", "--from-hz", "--to-hz")),
    (COMPARE, "--pretension-mm", ("400",)),
    *((TUNE, option, NEVER) for option in ("--resonance-hz", "--amplitude-deg", "--yaw-deg", "--seed")),
    (TUNE, "--bands", ("nan", "inf", "-1", "")),
    *((TRACK, option, NEVER) for option in ("--pretension-mm", "--amplitude-deg", "--duration-s", "--start-hz")),
    (TRACK, "--follow-hz", (*NEVER, "nan:3", "3:inf", "-1:3", "1e9:3", "3:")),
    (DESIGN, "--stride-hz", (*NEVER, "nan:1", "0.7:inf", "-1:1", "1:0.5", "0.7:1e9")),
    *((DESIGN, option, NEVER) for option in ("--yaw-deg", "--inertia-kg-m2", "--envelope-mm", "--starts", "--exact")),
    *((DESIGN, option, NEVER) for option in ("--torso-kg", "--torso-centre-mm")),
    (DESIGN, "--envelope-mm", ("nanx200", "200xinf", "-1x200", "1e9x200", "200x")),
    *((DESIGN, option, NEVER) for option in ("--proposals", "--seed")),
    *((CIRCLE, option, NEVER) for option in ("--outer-mm", "--length-mm", "--shear-modulus-kpa", "--loss-factor")),
    *((CIRCLE, option, NEVER) for option in ("--tendons", "--tendon-circle-mm", "--first-contact-n")),
    *((CIRCLE, option, NEVER) for option in ("--head-inertia-kg-m2", "--lever-inertia-kg-m2", "--head-mass-kg")),
    *((RING, option, NEVER) for option in ("--outer-mm", "--inner-mm")),
    *((ELLIPSE, option, NEVER) for option in ("--width-mm", "--height-mm")),
    (STAR, "--star-points", NEVER),
    (("simulate", "short", "--out", "x.nc"), "--seed", NEVER),
    (("reproduce", "--plan", "short", "--out", "out"), "--seed", NEVER),
    (EMULATE, "--for", ("nan", "inf", "-1", "")),
    (EMULATE, "--slack", NEVER),
    (RUN, "--wait", NEVER),
    *((command, "--out", ("",)) for command in (PREDICT, TRANSFER, COMPARE, DESIGN, CIRCLE)),
]


@pytest.mark.parametrize(
    ("command", "option", "value"),
    [
        pytest.param(command, option, value, id=f"{command[0]} {option} {value!r}")
        for command, option, values in ASKED
        for value in values
    ],
)
def test_what_nobody_can_mean_is_refused_in_one_line(
    command: tuple[str, ...], option: str, value: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = list(command)
    if option in words:
        words[words.index(option) + 1] = value
    else:
        words += [option, value]
    assert main(words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert said.err.startswith("sinew: ")
    assert list(here.iterdir()) == []


def test_two_numbers_with_a_comma_are_a_list_where_an_option_takes_a_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["model", "paper", "--to", "control", "--pretension-mm", "0,6", "--json"]) == 0
    assert [joint["pretension_mm"] for joint in json.loads(capsys.readouterr().out)["joints"]] == [0, 6]


@pytest.mark.slow
def test_modes_takes_two_pretensions_and_two_bends_with_commas(capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["--pretension-mm", "0,6", "--bend-deg", "0,10", "--bands", "0"]
    assert main(["modes", "paper", *asked, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["poses"]
    assert {(row["pretension_mm"], row["bend_deg"]) for row in rows} == {(0, 0), (0, 10), (6, 0), (6, 10)}


def test_an_oscillator_refuses_two_levels_of_its_drive(capsys: pytest.CaptureFixture[str]) -> None:
    words = list(OSCILLATOR)
    words[-1] = "1,2"
    assert main(words) == 2
    assert "--torque-n-m holds 2 levels, expected one" in capsys.readouterr().err


def test_every_command_refuses_a_number_that_is_none() -> None:
    assert all(isinstance(one, NumbersCommand) for one in typer.main.get_group(app).commands.values())


def test_an_option_that_ends_with_its_equals_sign_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["predict", "paper", "--pretension-mm="]) == 2
    assert "found nothing after --pretension-mm" in capsys.readouterr().err


# What a prediction says of its limits


def validity(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, dict[str, Any]]:
    assert main(["predict", "paper", "--json", *words]) == 0
    return {row["check"]: row for row in json.loads(capsys.readouterr().out)["validity"]}


@pytest.mark.slow
def test_no_assumption_is_said_to_hold_beside_a_value_over_its_limit(capsys: pytest.CaptureFixture[str]) -> None:
    rows = validity(capsys, "--pretension-mm", "4", "--from-hz", "2.8", "--to-hz", "3.8")
    known = {name: row for name, row in rows.items() if row["holds"] and row["value"] is not None}
    assert [name for name, row in known.items() if name != "slenderness" and row["value"] > row["limit"]] == []


@pytest.mark.slow
def test_a_command_beyond_the_rigs_drive_is_said_not_to_hold(capsys: pytest.CaptureFixture[str]) -> None:
    rows = validity(capsys, "--pretension-mm", "4", "--amplitude-deg", "46", "--from-hz", "5.5", "--to-hz", "11")
    assert not rows["drive_amplitude_deg"]["holds"]
    assert not rows["drive_hz"]["holds"]
    assert "the rig allows 45°" in rows["drive_amplitude_deg"]["sentence"]


@pytest.mark.parametrize("value", [201.0, math.nan])
def test_a_check_that_claims_to_hold_over_its_limit_cannot_be_made(value: float) -> None:
    with pytest.raises(AssertionError, match="said to hold"):
        Check("tension_n", value, 200.0, True, "")


def test_what_hangs_on_the_swing_does_not_hold_where_its_curve_broke_off() -> None:
    checks = [Check("torsion_deg", 0.0, 80.0, True, "it twists by 0°"), Check("slenderness", 1.7, 1.0, True, "long")]
    torsion, slender = doubt_broken_curves(checks, [12.0])
    assert not torsion.holds
    assert "the curve at 12 mm broke off" in torsion.sentence
    assert slender.holds
