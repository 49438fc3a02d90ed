"""Whatever rig or plan can exist, its TOML text gives it back, number for number."""

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.plan.check import check_plan
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_plan, dump_rig, load_rig, parse_plan, parse_rig

RIG = load_rig("paper")
NAMES = [name for name, _ in RIG.parameters()]
TEXTS = st.text(min_size=1, max_size=40)
FRACTIONS = st.floats(0, 1, allow_nan=False)
POSITIVE = st.floats(1e-300, 1e300)
FREQUENCIES = st.floats(1e-2, 1e300)
RATES = st.floats(1e-300, 1e-4)  # so that no campaign of the longest groups has too many samples


@st.composite
def rigs(draw: st.DrawFn) -> RigSpec:
    data: dict[str, Any] = RIG.model_dump()
    for dotted in NAMES:
        section, key = dotted.split(".")
        row = data[section][key]
        low, high = row["bounds"]
        a, b = sorted((draw(FRACTIONS), draw(FRACTIONS)))
        row["bounds"] = (low + a * (high - low), max(low + a * (high - low), low + b * (high - low)))
        row["value"] = draw(st.floats(*row["bounds"]))
        row["origin"] = draw(st.sampled_from(["paper", "data sheet", "calibrated", "assumed"]))
        row["note"] = draw(st.sampled_from(["", "a", 'two\nlines "quoted" \\ é\x7f', "[x] = # no"]))
    data["name"] = draw(TEXTS)
    return RigSpec.model_validate(data)


@st.composite
def plans(draw: st.DrawFn) -> Plan:
    sweep = {
        "frequency_hz": tuple(sorted(draw(st.sets(FREQUENCIES, min_size=1, max_size=60)))),
        "amplitude_deg": draw(POSITIVE),
        "settle_s": draw(st.floats(0, 3600)),
        "periods": draw(st.integers(1, 10**5)),
        "repeats": draw(st.integers(1, 40)),  # times 60 frequencies and 40 pretensions: within the most groups
    }
    ring_down = {"frequency_hz": (draw(FREQUENCIES), draw(FREQUENCIES)), "record_s": draw(st.floats(1e-300, 3600))}
    has_sweep, has_ring_down = draw(st.sampled_from([(True, True), (True, False), (False, True)]))
    return Plan.model_validate(
        {
            "name": draw(TEXTS),
            "sample_hz": draw(RATES),
            "pretension": {
                "pretension_mm": tuple(draw(st.lists(st.floats(0, 1e300), min_size=1, max_size=40, unique=True))),
                "mode": draw(st.sampled_from(["position", "position-with-current-limit", "current"])),
            },
            "sweep": sweep if has_sweep else None,
            "ring_down": ring_down if has_ring_down else None,
        }
    )


@settings(max_examples=60, deadline=None)
@given(rigs())
def test_a_rig_comes_back_from_its_text_number_for_number(rig: RigSpec) -> None:
    assert parse_rig(dump_rig(rig)) == rig


@settings(max_examples=100, deadline=None)
@given(plans())
def test_a_plan_comes_back_from_its_text_number_for_number(plan: Plan) -> None:
    assert parse_plan(dump_plan(plan)) == plan


@settings(max_examples=25, deadline=None)
@given(st.floats(1.0, 45.0), st.floats(0.5, 9.0))
def test_a_larger_command_never_gives_a_smaller_amplitude(amplitude_deg: float, frequency_hz: float) -> None:
    def reach(deg: float) -> float:
        sweep = {"frequency_hz": (frequency_hz,), "amplitude_deg": deg}
        plan = Plan.model_validate({"name": "x", "pretension": {"pretension_mm": (0.0,)}, "sweep": sweep})
        return check_plan(plan, RIG).drive_amplitude_deg[0]

    assert reach(amplitude_deg * 1.1) >= reach(amplitude_deg) * (1 - 1e-9)
