"""Guide friction: what every law must keep, and that all who ask of a law hear the same."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sinew.identify.joint.motion import make_coordinates, numbers_of
from sinew.mechanics.guides import GUIDE_LAWS, Dahl, GuideFriction
from sinew.mechanics.parameters import POSITION
from sinew.mechanics.tendons import as_one_tendon
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig, parse_rig
from sinew.solve.programs import configure
from sinew.solve.rest import free_swing, held_at, swing_loss, swing_stiffness
from sinew.twin.parameters import from_rig

configure()

TENSION = 3.0
each_law = pytest.mark.parametrize("law", [law(0.7, 0.2) for law in GUIDE_LAWS.values()], ids=list(GUIDE_LAWS))


def slipping_rig(law: str = "maxwell-slip") -> RigSpec:
    return parse_rig(dump_rig(load_rig("paper")).replace('guide_law = "dahl"', f'guide_law = "{law}"'))


def cycle(law: GuideFriction, amplitude: float) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Return phase, torsion and bristles of the third cycle of a swing φ = a cos t."""
    t = np.linspace(4 * np.pi, 6 * np.pi, 4001)
    found = solve_ivp(
        lambda t, z: np.array(law.rates(-amplitude * math.sin(t), tuple(z))),
        (0.0, t[-1]),
        np.zeros(len(law.spread)),
        t_eval=t,
        rtol=1e-8,
        atol=1e-10,
        max_step=0.02,
    )
    return t, amplitude * np.cos(t), list(found.y)


@each_law
@pytest.mark.parametrize("turns", [5.0, 15.0])
def test_its_loop_and_loss_are_those_that_its_bristles_settle_to(law: GuideFriction, turns: float) -> None:
    amplitude = turns * law.reach
    t, torsion, bristles = cycle(law, amplitude)
    torque = law.torque(TENSION, tuple(bristles))
    rising = t >= 5 * np.pi
    assert np.abs(law.greatest_torque(TENSION) * law.loop(torsion[rising], amplitude) - torque[rising]).max() < 1e-4
    work = np.trapezoid(torque * -amplitude * np.sin(t), t)
    assert law.loss(TENSION, amplitude) == pytest.approx(work, rel=1e-5)


@each_law
def test_what_it_takes_up_is_stored_or_lost_at_every_moment(law: GuideFriction) -> None:
    t, _, bristles = cycle(law, 2.5 * law.reach)
    speed = -2.5 * law.reach * np.sin(t)
    taken = np.trapezoid(law.torque(TENSION, tuple(bristles)) * speed, t)
    lost = np.trapezoid(law.power(TENSION, speed, tuple(bristles)), t)
    stored = law.stored(TENSION, tuple(bristles))
    assert taken == pytest.approx(lost + stored[-1] - stored[0], rel=1e-5)
    assert (law.power(TENSION, speed, tuple(bristles)) >= 0).all()


@each_law
def test_held_guides_are_a_spring_without_loss(law: GuideFriction) -> None:
    spring, loss = law.fundamental(TENSION, np.array([0.0, 1e-4]) * law.reach)
    assert spring == pytest.approx([law.stiffness(TENSION)] * 2, rel=1e-3)
    assert (loss < 1e-3 * spring).all()


@each_law
def test_slipping_guides_take_four_times_torque_and_swing(law: GuideFriction) -> None:
    assert law.loss(TENSION, 1e4 * law.reach) == pytest.approx(4 * 0.7 * TENSION * 1e4 * law.reach, rel=1e-3)


def test_springs_that_slide_lose_less_than_dahls_bristle_where_nothing_slips_yet() -> None:
    dahl, slip = (law(0.7, 0.2) for law in GUIDE_LAWS.values())
    assert slip.loss(TENSION, 0.04) < 0.01 * dahl.loss(TENSION, 0.04)


SWING = 0.3  # rad; of the four springs only the first slides


@pytest.mark.slow
@pytest.mark.parametrize("name", list(GUIDE_LAWS))
def test_a_joint_that_is_tuned_has_the_spring_and_the_loss_that_its_guides_settle_to(name: str) -> None:
    rig = slipping_rig(name)
    guides, at = rig.tendons.guides, jnp.asarray(0.005)
    swing = 5 * guides.reach  # all springs slide, and settle within three cycles
    held, tension = held_at(at, as_one_tendon(from_rig(rig)))
    bare = held._replace(guides=held.guides.scaled(0.0))
    t, _, bristles = cycle(guides, swing)
    stiffness = guides.torque(float(tension), tuple(bristles)) / swing
    for of, wave in ((swing_stiffness, np.cos(t)), (swing_loss, -np.sin(t))):
        found = [float(of(at, jnp.asarray(swing), jnp.asarray(20.0), p)) for p in (held, bare)]
        assert found[0] - found[1] == pytest.approx(np.trapezoid(stiffness * wave, t) / np.pi, rel=0.01)


@pytest.mark.slow
def test_identification_damps_a_joint_by_the_loop_of_its_rigs_own_guides() -> None:
    rig = slipping_rig()
    numbers = numbers_of(rig)
    found = free_swing(numbers.p, numbers.contact, 4.0, POSITION, SWING)
    inertia = rig.inertia.head.value + rig.inertia.lever.value
    stored = 0.5 * inertia * (2 * np.pi * float(found.natural_frequency_hz) * SWING) ** 2
    lost = float(found.guide_friction_share * found.damping_ratio) * 4 * np.pi * stored
    guides, total = rig.tendons.guides, 4 * float(found.tension_n)
    assert lost == pytest.approx(guides.loss(total, SWING), rel=0.1)  # the tension grows as the head turns
    assert lost < 0.8 * Dahl(guides.level, guides.reach).loss(total, SWING)


def test_a_calibration_scales_the_law_of_its_own_rig() -> None:
    rig = slipping_rig()
    free = make_coordinates(rig, ["tendons.guide_friction"])
    x = np.array([0.3])
    expected = float(free.values(x)[0] / free.origin[0]) * rig.tendons.guides.loss(TENSION, SWING)
    assert expected != pytest.approx(rig.tendons.guides.loss(TENSION, SWING), rel=0.05)
    for guides in (free.fitted_rig(x).tendons.guides, free.numbers(x).p.guides):
        assert float(guides.loss(TENSION, SWING)) == pytest.approx(expected)


def test_an_unknown_law_is_refused_with_those_there_are() -> None:
    from sinew.measure.errors import SpecError

    with pytest.raises(SpecError, match="maxwell-slip"):
        parse_rig(dump_rig(load_rig("paper")).replace('guide_law = "dahl"', 'guide_law = "lugre"'))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("frequency_hz", [2.6, 3.6])
def test_time_integration_and_harmonic_balance_agree_on_springs_that_slide(frequency_hz: float) -> None:
    from sinew.predict.joint import RESOLUTION, joint_problem
    from sinew.solve.curves import predict
    from sinew.solve.march import integrate
    from sinew.twin.simulate import lane_parameters

    rig = slipping_rig()
    group = Group("steady", 6.0, frequency_hz, 20.0, 0, 8.0, 10.0)
    p, rest = lane_parameters([group], rig)
    assert not isinstance(p.guides, Dahl)
    (track,) = integrate(p, rest, [int(12 / 0.005)], 0.005, steps=8)
    swung = track.torsion[-round(200 * 5 / frequency_hz) :]
    prediction = predict(joint_problem(rig, [6.0], 20.0, (2.0, 4.5)), (2.0, 4.5), RESOLUTION)
    branch = prediction.branches[0]
    told = np.interp(frequency_hz, branch.frequency_hz, branch.amplitude)
    assert told == pytest.approx(0.5 * np.ptp(swung), rel=5e-3)


@pytest.mark.slow
def test_springs_that_do_not_slide_yet_leave_a_small_swing_stable() -> None:
    from sinew.predict.joint import RESOLUTION, joint_problem
    from sinew.solve.curves import predict

    branch = predict(joint_problem(slipping_rig(), [6.0], 0.05, (2.5, 4.0)), (2.5, 4.0), RESOLUTION).branches[0]
    assert branch.complete
    assert branch.stable.all()


@pytest.mark.slow
def test_guides_that_slide_early_stay_within_their_bristles_in_a_wide_swing() -> None:
    from sinew.twin.simulate import lane_parameters, simulate_tracks

    rig = slipping_rig().with_values({"tendons.presliding_angle": 0.03})
    group = Group("steady", 2.0, 3.0, 30.0, 0, 1.0, 2.0)
    (track,) = simulate_tracks(lane_parameters([group], rig), [group], 200.0)
    assert np.isfinite(track.torsion).all()
    assert 0.1 < np.ptp(track.torsion) < 4.0
