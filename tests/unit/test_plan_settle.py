"""How long a sweep waits before it records: fixed, or adaptive up to a longest time."""

import pytest

from sinew.measure.errors import SpecError
from sinew.plan.check import check_plan
from sinew.plan.toml import dump_plan, load_plan, load_rig, parse_plan

ADAPTIVE = dump_plan(load_plan("short")).replace(
    "settle_s = 3\n", 'settle_s = 3\nsettle = "adaptive"\nsettle_tolerance = 0.02\nsettle_most_s = 12\n'
)


def test_a_plan_that_says_nothing_waits_a_fixed_time() -> None:
    sweep = load_plan("short").sweep
    assert sweep is not None
    assert (sweep.settle, sweep.longest_settle_s) == ("fixed", 3.0)


def test_a_fixed_settle_leaves_the_text_of_a_plan_as_it_was() -> None:
    assert "settle_most_s" not in dump_plan(load_plan("short"))


def test_an_adaptive_settle_comes_back_from_its_file() -> None:
    assert parse_plan(dump_plan(parse_plan(ADAPTIVE))) == parse_plan(ADAPTIVE)


def test_an_adaptive_settle_is_written_with_all_its_numbers() -> None:
    text = dump_plan(parse_plan(ADAPTIVE))
    assert all(
        f"\n{line}\n" in text for line in ('settle = "adaptive"', "settle_tolerance = 0.02", "settle_most_s = 12")
    )


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("settle_most_s = 2", r"settle_most_s = 2 s is shorter than settle_s = 3 s; raise it"),
        ("settle_most_s = 0", r"sweep.settle_most_s"),
        ("settle_tolerance = 0.9", r"sweep.settle_tolerance"),
        ('settle = "until bored"', r"sweep.settle"),
    ],
)
def test_what_cannot_be_waited_for_is_refused(line: str, sentence: str) -> None:
    key = line.split(" = ")[0]
    text = "\n".join(line if row.startswith(f"{key} =") else row for row in ADAPTIVE.splitlines())
    with pytest.raises(SpecError, match=sentence):
        parse_plan(text)


def test_a_longest_time_below_a_fixed_settle_is_nobody_s_business() -> None:
    text = ADAPTIVE.replace('"adaptive"', '"fixed"').replace("settle_most_s = 12", "settle_most_s = 2")
    sweep = parse_plan(text).sweep
    assert sweep is not None
    assert sweep.longest_settle_s == 3.0


def test_a_preview_tells_how_long_an_adaptive_plan_can_take() -> None:
    plan = parse_plan(ADAPTIVE)
    preview = check_plan(plan, load_rig("paper"))
    assert preview.longest_s - preview.duration_s == pytest.approx(9.0 * 3 * 12)


def test_a_preview_of_a_fixed_settle_has_one_duration() -> None:
    preview = check_plan(load_plan("short"), load_rig("paper"))
    assert preview.longest_s == preview.duration_s


def test_a_longest_time_that_leaves_much_of_the_transient_is_warned_of() -> None:
    text = ADAPTIVE.replace("settle_s = 3\n", "settle_s = 0.1\n").replace("settle_most_s = 12", "settle_most_s = 0.2")
    sentences = [finding.sentence for finding in check_plan(parse_plan(text), load_rig("paper")).findings]
    assert any(sentence.startswith("sweep.settle_most_s = 0.2 s may leave") for sentence in sentences)
