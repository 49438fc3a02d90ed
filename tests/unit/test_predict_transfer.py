"""The joint as a linear system: state spaces, the joint's closed forms, the files that other programs read."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy import io, signal
from tests.contracts.commands import command_lines, refused
from tests.unit.prony import complex_stiffness

from sinew.apps.cli import main
from sinew.mechanics.silicone import prony_shares
from sinew.plan.plan import Group
from sinew.plan.toml import load_rig
from sinew.predict.linear import LinearJoint, StateSpace, linear_joints, write_transfer
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters

PRETENSIONS = [0.0, 6.0, 12.0]
FREQUENCIES = np.geomspace(0.2, 20, 60)


@cache
def joints() -> tuple[LinearJoint, ...]:
    return linear_joints(load_rig("paper"), PRETENSIONS)


def stiffness(index: int) -> tuple[float, float, float]:
    """Return the closed forms of silicone GJ/(Lλ), tendons 4 T r²/ℓ and guides 4 μ T/φ_s at rest [N m/rad]."""
    rig = load_rig("paper")
    group = Group("steady", PRETENSIONS[index], 1.0, 1.0, 0, 1.0, 1.0)
    p, shortening = lane_parameters([group], rig)
    span = float(p.free_span[0] - shortening[0])
    tension = float(p.stiffness[0]) * (span - float(p.cable_end[0]))
    silicone = rig.silicone.torsional_rigidity.value / (rig.silicone.length.value - float(shortening[0]))
    tendons, all_tension = rig.tendons, 4 * tension
    geometric = all_tension * tendons.base_radius.value * tendons.head_radius.value / span
    return silicone, geometric, all_tension * tendons.guide_friction.value / tendons.presliding_angle.value


def two_masses() -> StateSpace:
    """Return two masses of 1 kg, each on a spring of 1 N/m to the wall and one of 2 N/m between; force on the first."""
    a = np.array([[0, 1, 0, 0], [-3, -0.1, 2, 0], [0, 0, 0, 1], [2, 0, -3, -0.1]], dtype=float)
    b, c = np.array([[0.0], [1.0], [0.0], [0.0]]), np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]])
    return StateSpace(a, b, c, np.zeros((2, 1)), ("x", "v", "y", "w"), ("force",), ("first", "second"))


def test_poles_of_two_masses_have_the_frequencies_and_dampings_of_their_modes() -> None:
    # In phase the middle spring rests: ω = 1. Against each other it counts twice: ω = sqrt(5). d/m = 2 D ω = 0.1.
    slow, _, fast, _ = two_masses().poles()
    assert (2 * np.pi * slow.frequency_hz, slow.damping_ratio) == pytest.approx((1.0, 0.05))
    assert (2 * np.pi * fast.frequency_hz, fast.damping_ratio) == pytest.approx((np.sqrt(5), 0.05 / np.sqrt(5)))


def test_the_zero_at_the_driven_mass_is_the_other_mass_by_itself_and_the_far_one_has_none() -> None:
    near, far = (two_masses().channel(output, "force") for output in ("first", "second"))
    assert [2 * np.pi * zero.frequency_hz for zero in near.zeros] == pytest.approx([np.sqrt(3)] * 2)
    assert len(far.zeros) == 0
    assert (near.gain, far.gain) == pytest.approx((1.0, 2.0))
    assert (near.static_gain, far.static_gain) == pytest.approx((3 / 5, 2 / 5))


def test_a_response_is_that_of_scipys_zeros_poles_and_gain() -> None:
    for system in (joints()[1].drive, joints()[1].lever):
        for i, source in enumerate(system.inputs):
            for o, output in enumerate(system.outputs):
                channel = system.channel(output, source)
                zeros, poles = [z.s for z in channel.zeros], [p.s for p in system.poles()]
                _, expected = signal.freqs_zpk(zeros, poles, channel.gain, 2 * np.pi * FREQUENCIES)
                found = system.response(FREQUENCIES)[:, o, i]
                assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("index", range(3))
def test_a_steady_torque_meets_silicone_tendons_and_guides_by_their_closed_forms(index: int) -> None:
    for system in (joints()[index].lever, joints()[index].drive):
        static = system.channel("torsion_rad", "torque_n_m").static_gain
        assert 1 / static == pytest.approx(sum(stiffness(index)), rel=1e-9)


@pytest.mark.parametrize("index", range(3))
def test_the_lever_turns_the_head_as_the_loss_factors_closed_form_says(index: int) -> None:
    rig = load_rig("paper")
    silicone, tendons, guides = stiffness(index)
    omega, inertia = 2 * np.pi * FREQUENCIES, rig.inertia.head.value + rig.inertia.lever.value
    dynamic = silicone * complex_stiffness(prony_shares(rig.silicone.loss_factor.value), FREQUENCIES) + tendons + guides
    expected = rig.inertia.lever.value * omega**2 / (dynamic - inertia * omega**2)
    found = joints()[index].lever.response(FREQUENCIES)[:, 0, 0]
    assert found == pytest.approx(expected, rel=1e-9)


def test_command_to_torsion_is_command_to_lever_times_lever_to_torsion() -> None:
    for joint in joints():
        drive, lever = joint.drive.response(FREQUENCIES), joint.lever.response(FREQUENCIES)
        assert drive[:, 0, 0] == pytest.approx(drive[:, 1, 0] * lever[:, 0, 0], rel=1e-9)


def test_a_held_command_turns_the_lever_all_the_way_and_the_head_not() -> None:
    drive = joints()[0].drive
    assert drive.channel("lever_rad", "command_rad").static_gain == pytest.approx(1.0)
    assert drive.channel("torsion_rad", "command_rad").static_gain == pytest.approx(0.0, abs=1e-12)


def test_a_lever_that_creeps_is_a_lever_that_slides_with_a_damper_of_the_regularised_friction() -> None:
    rig = load_rig("paper")
    sliding, creeping = (linear_joints(rig, [4.0], gear=gear)[0].drive for gear in ("sliding", "creeping"))
    inertia, drive = rig.inertia, rig.drive
    a, b, c = inertia.head.value + inertia.lever.value, inertia.lever.value, inertia.lever.value + drive.armature.value
    damper = drive.friction.value / 0.05
    added = sliding.a.copy()
    added[sliding.states.index("lever_rate_rad_s"), sliding.states.index("lever_rate_rad_s")] -= (
        a * damper / (a * c - b * b)
    )
    added[sliding.states.index("torsion_rate_rad_s"), sliding.states.index("lever_rate_rad_s")] += (
        b * damper / (a * c - b * b)
    )
    assert creeping.a == pytest.approx(added, rel=1e-12, abs=1e-9)


def test_without_losses_in_the_silicone_its_memory_is_not_a_state() -> None:
    (joint,) = linear_joints(load_rig("paper"), [0.0], effects=Effects().without("silicone_loss"))
    assert joint.lever.states == ("torsion_rad_less_lever", "torsion_rate_rad_s_less_lever")
    assert joint.lever.poles()[0].damping_ratio == pytest.approx(0.0, abs=1e-12)


def test_a_file_for_matlab_holds_the_matrices_in_cells_by_pretension(tmp_path: Path) -> None:
    (file,) = write_transfer(joints(), {}, tmp_path / "joint.mat")
    content = io.loadmat(file)
    assert content["pretension_mm"].ravel() == pytest.approx(PRETENSIONS)
    for name in ("drive", "lever"):
        struct = content[name][0, 0]
        assert [str(cell[0]) for cell in struct["inputs"].ravel()] == list(getattr(joints()[0], name).inputs)
        for i, joint in enumerate(joints()):
            for key in "ABCD":
                assert struct[key][i, 0] == pytest.approx(getattr(getattr(joint, name), key.lower()), rel=1e-15)


def test_a_folder_gets_both_files_and_the_numbers_come_back_as_they_were(tmp_path: Path) -> None:
    document = {"joints": [joint.to_dict() for joint in joints()]}
    files = write_transfer(joints(), document, tmp_path / "both")
    assert [file.name for file in files] == ["transfer.json", "transfer.mat"]
    assert json.loads(files[0].read_text(encoding="utf-8")) == document


def test_python_control_finds_the_same_poles_and_zeros() -> None:
    control = pytest.importorskip("control", reason="python-control is not installed: pip install control")
    system = joints()[0].lever
    document = joints()[0].lever.to_dict()
    theirs = control.ss(*(document[key] for key in "abcd"), inputs=document["inputs"], outputs=document["outputs"])
    response = theirs(2j * np.pi * FREQUENCIES)
    assert np.sort_complex(theirs.poles()) == pytest.approx(np.sort_complex([p.s for p in system.poles()]))
    assert np.moveaxis(response, -1, 0) == pytest.approx(system.response(FREQUENCIES), rel=1e-9)


def test_the_command_prints_one_document_with_a_joint_for_each_pretension(capsys: pytest.CaptureFixture[str]) -> None:
    status = main(["model", "paper", "--to", "control", "--pretension-mm", "0, 4", "--json"])
    document = json.loads(capsys.readouterr().out)
    assert status == 0
    assert [joint["pretension_mm"] for joint in document["joints"]] == [0, 4]
    assert {"a", "b", "c", "d", "states", "inputs", "outputs", "poles", "channels"} <= set(
        document["joints"][0]["drive"]
    )
    assert {pole["imag_per_s"] > 0 for pole in document["joints"][0]["lever"]["poles"]} == {True, False}


def test_the_command_prints_a_table_and_what_was_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["model", "paper", "--to", "matlab", "--pretension-mm", "0", "--out", str(tmp_path / "joint.mat")])
    out = capsys.readouterr().out
    assert "poles that swing" in out
    assert "the duty limit is not in it" in out
    assert (tmp_path / "joint.mat").exists()


@command_lines("""
    --pretension-mm a => found 'a', expected a number (0 to 100
    --pretension-mm -1 => cables cannot push
    --gear worm => 'worm', expected one of sliding, creeping
    --mode velocity => 'velocity', expected one of
    --without gravity => unknown effect 'gravity'
    --out joint.txt => ends with .json, or a folder
""")
def test_what_cannot_be_meant_is_refused_in_one_line(
    arguments: tuple[str, ...], sentence: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in refused(capsys, "model", "paper", "--to", "control", *arguments)
    assert list(here.iterdir()) == []
