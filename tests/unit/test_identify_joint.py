from functools import cache

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import CubicSpline

from sinew.identify.identified import identified_joint
from sinew.identify.joint.fit import JointFit, fit_joint
from sinew.identify.joint.motion import (
    Swing,
    lever_read_again,
    line_through,
    make_sieve,
    numbers_of,
    places_of,
    simulate_swings,
    steps_per_sample,
    swings_of,
)
from sinew.measure.errors import RecordingError, SpecError
from sinew.mechanics.parameters import POSITION, POSITION_LIMITED
from sinew.plan.plan import Group, Plan, Pretension, RingDown, Sweep
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.solve.rest import free_swing
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters, rest_tension, simulate, simulate_tracks

QUIET = Effects().without("sensor_noise", "stamp_jitter", "repeatability")
SHARES = {
    "silicone.torsional_rigidity": 0.85,
    "silicone.diameter": 1.06,
    "silicone.loss_factor": 1.3,
    "tendons.head_radius": 1.1,
    "tendons.base_radius": 1.1,
    "tendons.first_contact_tension": 0.8,
    "tendons.guide_friction": 1.2,
    "tendons.presliding_angle": 0.8,
    "imu.residual_delay": 2.0,
}


def hidden_rig() -> RigSpec:
    rig = load_rig("paper")
    there = dict(rig.parameters())
    lever = {"inertia.lever": 1.05 * rig.inertia.lever.value}
    lever["inertia.head"] = rig.inertia.head.value + rig.inertia.lever.value - lever["inertia.lever"]
    return rig.with_values({name: share * there[name].value for name, share in SHARES.items()} | lever)


def small_plan(*pretension_mm: float) -> Plan:
    return Plan(
        name="small",
        pretension=Pretension(pretension_mm=pretension_mm, rest_s=0.1),
        sweep=Sweep(frequency_hz=(2.7, 3.2, 4.0), settle_s=0.8, periods=3, repeats=1),
        ring_down=RingDown(frequency_hz=(3.0, 4.0), amplitude_deg=10, drive_s=0.8, record_s=0.8, repeats=1),
    )


@cache
def quiet_recording() -> xr.Dataset:
    return simulate(small_plan(1, 5, 10), hidden_rig(), effects=QUIET)


@cache
def quiet_fit() -> JointFit:
    return fit_joint([quiet_recording()], load_rig("paper"))


@pytest.mark.slow
def test_a_recording_without_noise_gives_the_hidden_rig_back_from_a_wrong_start() -> None:
    found = quiet_fit()
    truth = dict(hidden_rig().parameters())
    off = {name: one.value / truth[name].value - 1 for name, one in found.parameters.items()}
    assert found.converged
    assert max(map(abs, off.values())) < 0.01, off


@pytest.mark.slow
def test_the_fitted_rig_moves_what_is_tied_along() -> None:
    rig = quiet_fit().fitted_rig
    assert rig.tendons.base_radius.value == rig.tendons.head_radius.value
    assert rig.inertia.head.value + rig.inertia.lever.value == pytest.approx(12.74e-3, rel=1e-12)


@pytest.mark.slow
def test_a_rig_whose_silicone_loses_nothing_leaves_a_residual() -> None:
    data = load_rig("paper").model_dump()
    data["silicone"]["loss_factor"] |= {"value": 0.0, "bounds": (0.0, 0.3)}
    free = [name for name in quiet_fit().parameters if name != "silicone.loss_factor"]
    wrong = fit_joint([quiet_recording()], RigSpec.model_validate(data), free=free)
    assert wrong.rmse["gyro_rad_s"] > 5 * quiet_fit().rmse["gyro_rad_s"]


@pytest.mark.slow
def test_frequency_and_damping_of_the_balance_are_those_of_a_free_decay_that_loses_little() -> None:
    # Known otherwise: the twin's own decay, the lever locked to the head, by its turning points. The balance is that of
    # a steady swing, whose friction loops are closed, so it is met where little is lost in a cycle.
    there, pretension = hidden_rig(), 5.0
    friction = 0.2 * there.tendons.guide_friction.value
    rig = there.with_values({"silicone.loss_factor": 0.02, "tendons.guide_friction": friction})
    decay = Group("ring-down", pretension, 3.2, 20.0, 0, 6 / 3.2, 1.5)
    lanes = lane_parameters([decay], rig, effects=Effects().without("drive_recoil", "repeatability"))
    torsion = simulate_tracks(lanes, [decay], 2000.0)[0].torsion[3750:]
    turning = np.flatnonzero(np.diff(np.sign(np.diff(torsion)))) + 1
    swing = 0.5 * np.abs(np.diff(torsion[turning]))
    frequency = 2000.0 / (turning[4] - turning[2])
    decrement = np.log(swing[2] / swing[4]) / (2 * np.pi)
    numbers = numbers_of(rig)
    found = free_swing(numbers.p, numbers.contact, pretension, POSITION, float(np.sqrt(swing[2] * swing[4])))
    assert float(found.damping_ratio) == pytest.approx(decrement, rel=0.05)
    assert float(found.natural_frequency_hz) == pytest.approx(frequency, rel=0.005)


@pytest.mark.slow
def test_one_pretension_without_currents_leaves_the_diameter_open_and_says_so() -> None:
    # The diameter acts through the axial stiffness alone: how fast tension grows with pretension. Neither is seen here.
    recording = simulate(small_plan(4), hidden_rig(), seed=1001).drop_vars("tendon_current_a")
    found = fit_joint([recording], load_rig("paper"))
    assert any("silicone.diameter" in sentence for sentence in found.unidentifiable)
    assert quiet_fit().unidentifiable == ()


@pytest.mark.slow
def test_the_document_has_the_keys_of_every_identification() -> None:
    document = identified_joint(quiet_fit()).to_dict()
    assert {"model", "parameters", "natural_frequency_hz", "damping_ratio", "rmse", "unit", "converged"} <= set(
        document
    )
    assert {"message", "unidentifiable", "compared"} <= set(document)
    assert document["parameters"]["silicone.loss_factor"]["value"] == quiet_fit().fitted_rig.silicone.loss_factor.value


def test_a_parameter_of_the_drive_cannot_be_free() -> None:
    with pytest.raises(SpecError, match="no part in the motion"):
        fit_joint([quiet_recording()], load_rig("paper"), free=["drive.friction"])


def test_an_unknown_parameter_is_refused_by_name() -> None:
    with pytest.raises(SpecError, match=r"tendons\.radius"):
        fit_joint([quiet_recording()], load_rig("paper"), free=["tendons.radius"])


def test_a_recording_without_a_gyroscope_is_refused() -> None:
    blind = quiet_recording().drop_vars("drive_rad")
    with pytest.raises(RecordingError, match="drive_rad"):
        fit_joint([blind], load_rig("paper"))


@pytest.mark.slow
def test_the_shares_of_the_damping_add_up_to_all_of_it() -> None:
    found = quiet_fit()
    names = ("silicone_share", "guide_friction_share", "viscous_share")
    for pretension in found.pretension_mm:
        assert sum(found.at_pretension(name, pretension).value for name in names) == pytest.approx(1, abs=1e-12)


@pytest.mark.slow
def test_the_prediction_of_a_segment_lies_on_its_measurement() -> None:
    for segment in quiet_fit().segments:
        kept = segment.residual[segment.selected]
        assert np.sqrt(np.mean(kept**2)) < 0.01 * np.sqrt(np.mean(segment.measured**2))


# What its intervals hold


def test_jitter_of_the_stamps_moves_the_time_between_samples_by_what_a_line_through_them_does() -> None:
    rng, size = np.random.default_rng(1), 1200
    off = []
    for _ in range(200):
        stamps = np.arange(size) * 5e-3 + 1e-4 * rng.standard_normal(size)
        off.append(line_through(np.delete(stamps, slice(400, 403)))[0] - 5e-3)
    expected = 1e-4 * np.sqrt(12 / size**3)  # of a slope through independent errors
    assert np.std(off) == pytest.approx(expected, rel=0.2)
    assert np.abs(off).max() < 5 * expected


def with_one_more_sample(recording: xr.Dataset, row: int) -> xr.Dataset:
    """Return a recording with a sample half way between a row and the next, of the same segment, on the cubic."""
    wider = recording.isel(sample=np.insert(np.arange(recording.sizes["sample"]), row + 1, row)).copy(deep=True)
    around = recording.isel(sample=slice(row - 20, row + 20))
    time = around["time_s"].values
    wider["time_s"][row + 1] = 0.5 * (time[20] + time[21])
    for name in ("drive_rad", "gyro_rad_s"):
        wider[name][row + 1] = CubicSpline(time, around[name].values)(0.5 * (time[20] + time[21]))
    wider["row_size"][int(np.searchsorted(np.cumsum(recording["row_size"]), row, side="right"))] += 1
    return wider


def test_two_half_steps_of_a_bench_leave_the_motion_as_it_was() -> None:
    recording = quiet_recording()
    settle = int(recording["row_size"].values[0]) + 60
    plain, halved = (
        swings_of([one], load_rig("paper"))[0] for one in (recording, with_one_more_sample(recording, settle))
    )
    time = plain.lever.x[20:-20]
    assert plain.size == halved.size
    assert halved.present.all()
    assert halved.lever.x.size == plain.lever.x.size + 1
    assert halved.gyro == pytest.approx(plain.gyro, abs=1e-9)
    assert halved.lever(time) == pytest.approx(plain.lever(time), abs=1e-9)


def test_a_sample_that_came_late_is_where_it_was_taken_and_jitter_leaves_the_others_on_their_line() -> None:
    stamps = np.arange(400) * 5e-3 + 1e-4 * np.random.default_rng(4).standard_normal(400)
    stamps[[200, 201]] = 200.9 * 5e-3, 201.45 * 5e-3
    places = places_of(stamps, 5e-3, 1e-4)
    assert places[[200, 201]] == pytest.approx([200.9, 201.45], abs=5e-3)
    assert np.array_equal(np.delete(places, [200, 201]), np.delete(np.arange(400.0), [200, 201]))


def test_a_swing_that_begins_in_motion_is_simulated_in_motion() -> None:
    numbers, time = numbers_of(load_rig("paper")), 5e-3 * np.arange(12)
    still = CubicSpline(time, np.zeros(12))
    swing = Swing(
        0, 0, "steady", 3.0, 3.0, 0, POSITION, 5e-3, still, np.zeros(12), np.ones(12, bool), 0, False, np.nan, np.nan
    )
    steps = steps_per_sample(numbers, 5e-3)
    turned, pushed = simulate_swings([swing] * 2, numbers, np.array([[0, 0, 0.2, 0], [0, 0, 0, 2.0]]), steps)
    assert turned.values[-1, 0] < -1.0
    assert pushed.values[6, 0] > 1.0


def test_a_lever_that_is_read_again_errs_alike_in_every_period_and_oppositely_in_each_half() -> None:
    lsb, period, count = 2 * np.pi / 4096, 80, 400
    angle = lsb * np.round(np.radians(20) * np.sin(2 * np.pi * np.arange(count) / period) / lsb)
    time = np.arange(count) * 5e-3
    still = np.zeros(count)
    swing = Swing(
        0, 0, "steady", 4.0, 2.5, 0, POSITION, 5e-3, CubicSpline(time, angle, bc_type="natural"), still, still == 0, 0,
        True, np.nan, np.nan,
    )  # fmt: skip
    again = lever_read_again(swing, make_sieve(swing, 3), lsb, np.random.default_rng(2))
    error = again.lever(time) - angle
    inside = error[period : 4 * period]  # the low-pass reaches beyond the ends
    own = angle - np.radians(20) * np.sin(2 * np.pi * np.arange(count) / period)
    assert np.abs(inside).max() <= 0.5 * lsb * (1 + 1e-9)
    assert inside.std() == pytest.approx(lsb / np.sqrt(12), rel=0.15)
    assert inside[period:] == pytest.approx(inside[:-period], abs=0.05 * lsb)
    assert inside[period // 2 :] == pytest.approx(-inside[: -period // 2], abs=0.05 * lsb)
    assert abs(np.corrcoef(inside, own[period : 4 * period])[0, 1]) < 0.5


def test_a_deviation_of_the_pretension_is_more_of_it() -> None:
    time, numbers = 5e-3 * np.arange(12), numbers_of(load_rig("paper"))
    lever = CubicSpline(time, 0.3 * np.sin(20.0 * time))
    here, there = (
        Swing(
            0, 0, "steady", mm, 3.0, 0, POSITION, 5e-3, lever, np.zeros(12), np.ones(12, bool), 0, True, np.nan, np.nan
        )
        for mm in (3.0, 4.0)
    )
    steps = steps_per_sample(numbers, 5e-3)
    moved, set_so = simulate_swings(
        [here, there], numbers, np.array([[1e-3, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]), steps
    )
    assert moved.values == pytest.approx(set_so.values, rel=1e-9)


def test_motors_with_a_limit_yield_at_what_a_bench_told_them_whatever_the_joint_holds_at_rest() -> None:
    """Those of the twin yield 5 N above what they hold at rest."""
    time, rig = 5e-3 * np.arange(12), load_rig("paper")
    still = CubicSpline(time, np.zeros(12))
    asked = (0, 0, "steady", 4.0, 3.0, 0, POSITION_LIMITED, 5e-3, still, np.zeros(12), np.ones(12, bool), 0, False)
    told, of_twin = (Swing(*asked, np.nan, np.nan, limit_a) for limit_a in (0.16, np.nan))
    twisted = np.array([[0.0, 0.0, 1.0, 0.0]] * 2)  # by 57°, which pulls 22 N more where nothing yields
    for contact in (8.0, 9.0):
        other = rig.with_values({"tendons.first_contact_tension": contact})
        numbers = numbers_of(other)
        seen = simulate_swings([told, of_twin], numbers, twisted, steps_per_sample(numbers, 5e-3))
        rest = other.tendons.current(rest_tension([4.0], other)[0])
        assert seen[0].values[0, 1] == pytest.approx(0.16, rel=1e-9)
        assert seen[1].values[0, 1] == pytest.approx(rest + other.tendons.current(5.0), rel=1e-6)


def test_a_swing_has_the_limit_that_its_recording_says_its_motors_had() -> None:
    plain = quiet_recording()
    limited = plain.assign_attrs(tendon_limit_a='{"1": 0.11, "5": 0.19, "10": 0.35}')
    found = {swing.pretension_mm: swing.limit_a for swing in swings_of([limited], load_rig("paper"))}
    assert found == {1.0: 0.11, 5.0: 0.19, 10.0: 0.35}
    assert all(np.isnan(swing.limit_a) for swing in swings_of([plain], load_rig("paper")))


@pytest.mark.slow
def test_the_scatter_over_repeats_is_estimated_from_them() -> None:
    """A rig that states a fifth of its scatter: with six settings the rig's word counts four of ten."""
    rig = load_rig("paper")
    plan = small_plan(2, 6, 10)
    sweep = plan.sweep.model_copy(update={"repeats": 2})  # type: ignore[union-attr]
    recording = simulate(plan.model_copy(update={"sweep": sweep}), rig, seed=3)
    stated = rig.with_values({"repeatability.pretension": 2e-5})
    found = fit_joint([recording], stated)
    assert found.repeats == 2
    assert 2.5 * 2e-5 < found.repeatability[0] < 2e-4
