"""Moments of inertia of a rig's head and lever: those that a body can have, said where they are assumed."""

import numpy as np
import pytest

from sinew.measure.errors import SpecError
from sinew.plan.rig import RigSpec, moments_of
from sinew.plan.toml import load_rig
from sinew.predict.design import Design, design_rig
from sinew.twin.parameters import space_from_rig

PAPER = load_rig("paper")


def rig_with(part: str, name: str, value: float, origin: str = "assumed") -> RigSpec:
    """Return the paper's rig with another moment of inertia."""
    data = PAPER.model_dump()
    data[part][name] |= {"value": value, "origin": origin, "bounds": (value / 2, 2 * value)}
    return RigSpec.model_validate(data)


def test_the_papers_moments_are_those_of_its_file() -> None:
    found = moments_of(PAPER)
    assert found.head.tolist() == [0.00494, 0.0025, 0.0025]
    assert found.lever.tolist() == [0.0078, 0.0002, 0.0078]


@pytest.mark.parametrize(
    ("part", "name", "value"),
    [("inertia", "head", 0.25), ("space", "head_across", 1e-4), ("space", "lever_along", 0.1)],
)
def test_an_assumed_moment_that_no_body_has_becomes_the_nearest_possible_and_that_is_said(
    part: str, name: str, value: float
) -> None:
    found = moments_of(rig_with(part, name, value))
    for tensor in (found.head, found.lever):
        assert np.all(2 * tensor <= tensor.sum())
    assert any("no body has such moments" in sentence for sentence in found.assumptions)


@pytest.mark.parametrize(("part", "name", "value"), [("space", "head_across", 1e-4), ("space", "lever_along", 0.1)])
def test_a_measured_moment_that_no_body_has_is_refused(part: str, name: str, value: float) -> None:
    with pytest.raises(SpecError, match=rf"space.{name} is {value:g} kg m².*expected a measured value"):
        space_from_rig(rig_with(part, name, value, "measured"))


def test_a_designed_head_has_the_moments_of_a_cylinder_that_stands_on_its_plate() -> None:
    rig = design_rig(PAPER, Design(head_inertia=0.25, head_mass=20.33, head_height=0.3))
    radius = np.sqrt(2 * 0.25 / 20.0)  # of 20 kg, the lever's 0.33 kg apart
    assert moments_of(rig).head == pytest.approx([0.25, *2 * [20.0 * (3 * radius**2 + 0.6**2) / 12]])
    assert "cylinder" in moments_of(rig).assumptions[0]


def test_a_designed_head_takes_the_moment_across_that_is_given() -> None:
    rig = design_rig(PAPER, Design(head_inertia=0.25, head_across=0.7))
    assert moments_of(rig).head.tolist() == [0.25, 0.7, 0.7]


def test_a_rig_that_only_twists_takes_no_height_of_its_head() -> None:
    with pytest.raises(SpecError, match=r"without \[space\]"):
        design_rig(PAPER.model_copy(update={"space": None}), Design(head_height=0.1))
