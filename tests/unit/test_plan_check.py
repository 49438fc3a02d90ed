"""What a check says of a plan before anything moves."""

import math
import re
from typing import Any

import numpy as np
import pytest

from sinew.analysis.sweep.resonance import find_peaks
from sinew.measure.errors import SpecError
from sinew.plan.check import Preview, check_plan, drive_reach, drive_reaches, refuse_beyond_limits, stages_of
from sinew.plan.plan import Plan
from sinew.plan.toml import load_plan, load_rig
from sinew.predict.design import Design, design_rig

RIG = load_rig("paper").with_values({"drive.supply_voltage": 14.7, "silicone.loss_factor": 0.1})


def plan_with(**changes: Any) -> Plan:
    data = load_plan("short").model_dump()
    for dotted, value in changes.items():
        section, _, key = dotted.rpartition("__")
        (data[section] if section else data)[key] = value
    return Plan.model_validate(data)


def sentences(preview: Preview, severity: str) -> str:
    return "\n".join(f.sentence for f in preview.findings if f.severity == severity)


def test_the_papers_plan_breaks_no_limit_of_the_papers_rig() -> None:
    preview = check_plan(load_plan("paper"), load_rig("paper"))
    refuse_beyond_limits(preview)
    assert not [word for word in ("[wiring]", "fall over") if word in sentences(preview, "warn")]
    assert re.search(f"20° at 6 Hz.* reaches {preview.drive_amplitude_deg[-1]:.1f}°", sentences(preview, "note"))


def test_the_duration_is_the_sum_of_rests_settles_periods_and_decays() -> None:
    plan = Plan.model_validate(
        {
            "name": "x",
            "pretension": {"pretension_mm": (0.0, 5.0), "rest_s": 2.0},
            "sweep": {"frequency_hz": (2.0, 4.0), "settle_s": 3.0, "periods": 4, "repeats": 3},
            "ring_down": {"frequency_hz": (2.0, 2.0), "drive_s": 3.0, "record_s": 5.0, "repeats": 2},
        }
    )
    assert check_plan(plan, RIG).duration_s == pytest.approx(2 * (2 + 3 * (3 + 2 + 3 + 1) + 2 * (3 + 5)))


REFUSALS = {
    "pretension": ({"pretension__pretension_mm": (0.0, 18.0)}, "a pretension of 18 mm, the rig allows 0 to 16 mm"),
    "amplitude": ({"sweep__amplitude_deg": 50.0}, "sweep asks for 50°, the rig allows 45°"),
    "ring-down amplitude": ({"ring_down__amplitude_deg": 50.0}, "ring_down asks for 50°, the rig allows 45°"),
    "frequency": ({"sweep__frequency_hz": (2.0, 12.0), "sample_hz": 500.0}, "asks for 12 Hz, the rig allows 10 Hz"),
    "sample rate": ({"sample_hz": 100.0}, "a tenth of the Nyquist frequency is 5 Hz; raise sample_hz to 120"),
}


@pytest.mark.parametrize(("changes", "sentence"), REFUSALS.values(), ids=REFUSALS.keys())
def test_a_plan_beyond_a_limit_is_refused_in_a_sentence(changes: dict[str, Any], sentence: str) -> None:
    assert sentence in sentences(check_plan(plan_with(**changes), RIG), "refuse")


def test_a_short_decay_and_a_single_repeat_are_told() -> None:
    preview = check_plan(plan_with(ring_down__record_s=1.0), RIG)
    assert "ring_down.record_s = 1 s holds 3.0 periods at 3 Hz" in sentences(preview, "warn")
    assert "gives no standard deviation" in sentences(preview, "note")


@pytest.mark.parametrize(
    ("limit", "severity", "sentence"),
    [
        ({"voltage_v": (10.0, 14.0)}, "refuse", "drive.supply_voltage is 14.7 V, the rig allows 10 to 14 V"),
        ({"drive_current_a": 0.5}, "refuse", "the rig allows 0.5 A"),
        ({"tendon_current_a": 2.0}, "warn", "limits.tendon_current_a is 2 A, a XH430-W350 stalls at 1.3 A"),
    ],
)
def test_a_limit_of_the_rig_is_named_where_the_short_plan_breaks_it(
    limit: dict[str, Any], severity: str, sentence: str
) -> None:
    data = RIG.model_dump()
    data["limits"] |= limit
    assert sentence in sentences(check_plan(load_plan("short"), type(RIG).model_validate(data)), severity)


AMPERE_AND_A_HALF_N = 1.5 * RIG.tendons.torque_constant.value / RIG.tendons.pulley_radius.value


@pytest.mark.parametrize(
    ("known", "severity", "sentence"),
    [
        ({"tension_n": (10.0, 100.0, 230.0)}, "refuse", "each tendon pulls 230 N at 12 mm, the rig allows 200 N"),
        (
            {"tension_n": (10.0, 20.0, AMPERE_AND_A_HALF_N)},
            "refuse",
            "each tendon motor draws 1.50 A at 12 mm, the rig allows 1.3 A",
        ),
        ({"tension_n": (0.0, 20.0, 40.0)}, "warn", "tendons are slack at 0 mm"),
        ({"torsion_deg": (81.0, 50.0, 30.0)}, "refuse", "the head twists by 81° at 0 mm, the rig allows 80°"),
    ],
)
def test_tension_and_torsion_are_judged_where_the_caller_knows_them(
    known: dict[str, Any], severity: str, sentence: str
) -> None:
    assert sentence in sentences(check_plan(load_plan("short"), RIG, **known), severity)


def test_a_drive_that_reaches_no_frequency_is_said_to() -> None:
    preview = check_plan(plan_with(sweep__frequency_hz=(4.0, 5.0, 6.0)), RIG)
    assert "it reaches 20° (within 5%) at none of its frequencies" in sentences(preview, "note")


def test_the_nominal_amplitude_is_reached_up_to_the_frequency_that_is_told() -> None:
    preview = check_plan(load_plan("paper"), RIG)
    reached = [f for f, a in zip(preview.frequency_hz, preview.drive_amplitude_deg, strict=True) if a >= 19]
    assert preview.full_amplitude_hz == max(reached)


def test_a_settle_time_that_is_short_against_the_damping_is_warned_of() -> None:
    decay = 0.1 / 2 * math.sqrt(0.29 / 0.095 / 12.74e-3)
    expected = f"may leave {math.exp(-decay):.0%} of the start transient"
    assert expected in sentences(check_plan(plan_with(sweep__settle_s=1.0), RIG), "warn")


def test_the_guides_friction_shortens_the_settling_that_is_needed() -> None:
    plan = plan_with(sweep__settle_s=1.0)
    bare = sentences(check_plan(plan, RIG), "warn")
    guided = sentences(check_plan(plan, RIG, tension_n=(15.0, 50.0, 90.0)), "warn")
    left = [int(re.search(r"may leave (\d+)%", text)[1]) for text in (bare, guided)]  # type: ignore[index]
    assert left[1] < left[0]


def test_frequencies_too_few_for_a_resonance_are_warned_of_in_the_words_of_the_analysis() -> None:
    few, enough = (2.5, 3.2, 4.0), (2.5, 2.8, 3.2, 3.6, 4.0, 4.4)
    unmeasured = find_peaks(np.array(few), np.ones((1, 3), dtype=complex), *np.full((2, 1, 3), 0.01))[0]
    assert unmeasured.reason in sentences(check_plan(plan_with(sweep__frequency_hz=few), RIG), "warn")
    assert "resonance" not in sentences(check_plan(plan_with(sweep__frequency_hz=enough), RIG), "warn")


def test_a_frequency_that_the_rig_forbids_is_no_reason_to_sample_faster() -> None:
    told = check_plan(plan_with(sweep__frequency_hz=(3.0, 900.0)), RIG).refusals
    assert [one for one in told if "900 Hz" in one and "the rig allows" in one]
    assert not [one for one in told if "sample_hz" in one]


def test_a_rig_with_another_servos_numbers_is_warned_of_with_both() -> None:
    data = load_rig("paper").model_dump()
    data["wiring"]["tendon_model"] = "XL330-M288"
    told = sentences(check_plan(load_plan("short"), type(RIG).model_validate(data)), "warn")
    sheet = 0.52 / 1.47  # the maker's page: stall torque and current at 5 V
    assert f"tendons.torque_constant is 2.62 N*m/A, that of the XL330-M288 is {sheet:.4g}" in told
    assert "drive.supply_voltage is 13.27 V, that of the XL330-M288 is 5;" in told


def test_a_refused_plan_raises_its_first_refusal_and_counts_the_others() -> None:
    preview = check_plan(plan_with(sweep__amplitude_deg=50.0, ring_down__amplitude_deg=50.0), RIG)
    with pytest.raises(SpecError, match=r"^sweep asks for 50°.*\(and 1 more refusal; see sinew check\)$"):
        refuse_beyond_limits(preview)


def test_the_drive_asked_of_many_groups_at_once_says_what_it_says_of_each() -> None:
    rig, command, hertz = load_rig("paper"), np.radians([2.0, 20.0, 60.0]), np.array([0.5, 3.0, 7.0])
    head = np.array([0.0, 2.0 * np.exp(-1.5j), 0.3 * np.exp(-3.0j)])
    each = [drive_reach(rig, *asked) for asked in zip(command.tolist(), hertz.tolist(), head.tolist(), strict=True)]
    assert drive_reaches([rig] * 3, command, hertz, head) == each


@pytest.mark.parametrize("name", ["first", "quick", "short", "current", "paper"])
def test_the_stages_of_a_plan_follow_each_other_and_last_as_long_as_the_bench_takes(name: str) -> None:
    plan = load_plan(name)
    stages = stages_of(plan)
    ends = [stage.start_s + stage.duration_s for stage in stages]
    assert [stage.start_s for stage in stages[1:]] == pytest.approx(ends[:-1])
    assert ends[-1] == pytest.approx(check_plan(plan, load_rig("paper")).bench_s)


HEAVY = design_rig(RIG, Design(head_mass=6.33, head_height=0.25))


def test_a_head_that_falls_over_at_first_contact_is_warned_of_with_its_mass() -> None:
    warned = sentences(check_plan(plan_with(), HEAVY), "warn")
    assert "the head has 6.33 kg; motors that hold currents let it fall over; hold it upright" in warned


def test_a_head_that_falls_over_while_motors_hold_currents_is_refused_a_plan_by_current() -> None:
    by_current = plan_with(pretension__mode="current")
    assert "set pretension.mode to position" in sentences(check_plan(by_current, HEAVY), "refuse")
