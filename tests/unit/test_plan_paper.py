"""The shipped rig and plan against the paper's text and the data sheets."""

import math

import pytest

from sinew.plan.toml import load_plan, load_rig


@pytest.fixture(scope="module")
def rig():  # type: ignore[no-untyped-def]
    return load_rig("paper")


@pytest.fixture(scope="module")
def plan():  # type: ignore[no-untyped-def]
    return load_plan("paper")


def test_head_and_lever_together_have_the_inertia_of_equation_4(rig) -> None:  # type: ignore[no-untyped-def]
    assert rig.inertia.head.value + rig.inertia.lever.value == pytest.approx(12.74e-3, abs=1e-6)


def test_the_bare_silicone_has_the_stiffness_of_equation_5(rig) -> None:  # type: ignore[no-untyped-def]
    stiffness = rig.silicone.torsional_rigidity.value / rig.silicone.length.value
    assert stiffness == pytest.approx(3.052, abs=1e-3)


def test_the_bare_silicone_resonates_at_2_46_hz(rig) -> None:  # type: ignore[no-untyped-def]
    stiffness = rig.silicone.torsional_rigidity.value / rig.silicone.length.value
    assert math.sqrt(stiffness / 12.74e-3) / (2 * math.pi) == pytest.approx(2.46, abs=0.01)


def test_the_drives_no_load_speed_is_passed_by_20_degrees_at_2_20_hz_and_12_v(rig) -> None:  # type: ignore[no-untyped-def]
    assert rig.drive.no_load_speed.value / (2 * math.pi * math.radians(20)) == pytest.approx(2.20, abs=0.005)


def test_the_position_gain_is_the_default_register_over_the_duty_range(rig) -> None:  # type: ignore[no-untyped-def]
    per_count = 800 / 128 / 885
    assert rig.drive.position_gain.value == pytest.approx(per_count * 4096 / (2 * math.pi), rel=1e-4)


def test_the_servo_stiffness_follows_from_the_tendon_motors_default_gain(rig) -> None:  # type: ignore[no-untyped-def]
    torque_per_rad = 900 / 128 / 885 * 3.4 * 4096 / (2 * math.pi)
    along_the_cable = torque_per_rad / rig.tendons.pulley_radius.value**2
    assert rig.tendons.servo_stiffness.value == pytest.approx(along_the_cable, rel=0.005)


def test_the_gyroscopes_filter_and_residual_delay_add_up_to_the_data_sheets_5_9_ms(rig) -> None:  # type: ignore[no-untyped-def]
    butterworth = math.sqrt(2) / (2 * math.pi * rig.imu.low_pass.value)
    assert butterworth + rig.imu.residual_delay.value == pytest.approx(5.9e-3, abs=1e-6)


def test_both_current_registers_count_2_69_ma(rig) -> None:  # type: ignore[no-untyped-def]
    assert (rig.drive.current_lsb.value, rig.tendons.current_lsb.value) == (0.00269, 0.00269)


def test_base_and_head_guides_lie_on_equal_circles(rig) -> None:  # type: ignore[no-untyped-def]
    assert rig.tendons.base_radius.value == rig.tendons.head_radius.value


def test_every_parameter_says_where_it_is_from(rig) -> None:  # type: ignore[no-untyped-def]
    assert [name for name, parameter in rig.parameters() if not parameter.note] == []


def test_the_plan_visits_0_to_12_mm_by_1_mm(plan) -> None:  # type: ignore[no-untyped-def]
    assert plan.pretension.pretension_mm == tuple(range(13))


def test_the_sweep_has_at_least_28_frequencies_from_1_5_to_6_hz(plan) -> None:  # type: ignore[no-untyped-def]
    frequencies = plan.sweep.frequency_hz
    assert len(frequencies) >= 28
    assert (frequencies[0], frequencies[-1]) == (1.5, 6.0)


def test_the_sweep_is_densest_over_the_papers_resonances(plan) -> None:  # type: ignore[no-untyped-def]
    steps = {
        round(b - a, 6)
        for a, b in zip(plan.sweep.frequency_hz, plan.sweep.frequency_hz[1:], strict=False)
        if 2.7 <= a < 4.6
    }
    assert steps == {0.1}


def test_the_sweep_has_the_papers_settings(plan) -> None:  # type: ignore[no-untyped-def]
    sweep = plan.sweep
    assert (sweep.amplitude_deg, sweep.settle_s, sweep.periods, sweep.repeats) == (20, 3, 5, 3)


def test_ring_downs_stop_the_drive_at_a_zero_crossing(plan) -> None:  # type: ignore[no-untyped-def]
    turns = [g.settle_s * g.frequency_hz for g in plan.groups() if g.kind == "ring-down"]
    assert max(abs(turn - round(turn)) for turn in turns) < 1e-9
