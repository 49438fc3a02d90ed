"""Answers on a bent joint: the twist that tendons give, and that they say what it hangs on."""

import pytest

from sinew.measure.estimate import Estimate
from sinew.paper.bent import answer_bent
from sinew.plan.toml import load_rig


@pytest.mark.slow
def test_a_bent_joint_keeps_its_resonance_tilts_across_and_twists_at_resonance_only() -> None:
    answers = {one.name: one for one in answer_bent(load_rig("paper"), azimuth_deg=90, draws=3)}
    assert answers["bent-resonance"].verdict == "it hardly moves"
    assert abs(answers["bent-resonance"].numbers["relative_shift"].value) < 0.03
    # Half of the sine of 30°, as of a rod that is twisted slowly, but for the head's inertia.
    assert answers["bent-coupling"].numbers["tilt_across_per_torsion"].value == pytest.approx(0.25, rel=0.08)
    engine = answers["spinal-engine"].rows[-1]
    # Of another program, the lever locked, for 1.4 mm of cable: about 1°.
    assert engine["locked_twist_deg"] == pytest.approx(1.0, rel=0.3)
    twist = engine["twist_deg"]
    assert isinstance(twist, Estimate)
    assert twist.value < engine["locked_twist_deg"]
    slow = answers["spinal-engine"].numbers["twist_per_tilt_slow"]
    assert slow.value < 2e-3
