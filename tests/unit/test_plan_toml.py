"""Rigs and plans as TOML: names, paths, and one helpful line for each fault."""

import re
import time
from pathlib import Path

import pytest
from pydantic import ValidationError
from tests.tables import rows
from tests.unit.plan_faults import refusal

from sinew.measure.errors import SpecError
from sinew.plan.plan import Plan, Pretension, Sweep
from sinew.plan.toml import (
    dump_plan,
    dump_rig,
    list_shipped,
    load_plan,
    load_rig,
    parse_plan,
    parse_rig,
    plan_faults,
    read_spec,
)

ROOT = Path(__file__).parents[2]
# With fixed values, so that a recalibration of the shipped rig does not move the lines that these tests break.
RIG_TEXT = dump_rig(
    load_rig("paper").with_values(
        {"tendons.base_radius": 0.0278, "drive.supply_voltage": 14.7, "silicone.length": 0.095}
    )
)
PLAN_TEXT = (ROOT / "plans" / "paper.toml").read_text(encoding="utf-8")


def test_shipped_rigs_and_plans_are_listed_by_name() -> None:
    assert list_shipped("rigs") == ["curved", "paper"]
    assert list_shipped("plans") == ["bent", "beyond", "current", "engine", "first", "paper", "quick", "short"]


@pytest.mark.parametrize("name", ["paper", "paper.toml", "rigs/paper.toml", ROOT / "rigs" / "paper.toml"])
def test_a_shipped_rig_is_found_by_name_and_by_path(name: str | Path, here: Path) -> None:
    assert load_rig(name) == parse_rig((ROOT / "rigs" / "paper.toml").read_text(encoding="utf-8"))


def test_a_file_comes_before_a_shipped_name(here: Path) -> None:
    Path("paper.toml").write_text(PLAN_TEXT.replace('name = "paper"', 'name = "mine"'), encoding="utf-8")
    assert load_plan("paper.toml").name == "mine"


@pytest.mark.parametrize("name", list_shipped("rigs"))
def test_a_rig_that_is_as_its_file_leaves_the_file_as_it_is(name: str) -> None:
    text = read_spec("rigs", name)
    assert dump_rig(load_rig(name), text) == text
    assert parse_rig(dump_rig(load_rig(name))) == load_rig(name)


@pytest.mark.parametrize("name", list_shipped("plans"))
def test_a_shipped_plan_has_no_fault_and_is_written_as_it_stands_but_for_remarks(name: str) -> None:
    text = read_spec("plans", name)
    assert plan_faults(text) == []
    assert dump_plan(load_plan(name)) == re.sub("  # .*", "", text)
    assert parse_plan(text) == load_plan(name)


def test_a_rig_that_is_changed_keeps_the_comments_of_its_file_and_the_lines_of_what_is_the_same() -> None:
    mine = RIG_TEXT.replace("[tendons]\ncount = 4\n", "# of steel\n[tendons]\ncount = 4  # two pairs\n\n# by hand\n")
    changed = parse_rig(mine).with_values({"tendons.pulley_radius": 0.013})
    text = dump_rig(changed, f"# made on Monday\n{mine}")
    assert parse_rig(text) == changed
    before, after = mine.splitlines(), text.splitlines()
    assert [line for line in before if line not in after] == [one for one in before if one.startswith("pulley_radius")]
    assert "made on Monday" not in text


def test_a_section_that_a_changed_rig_lacks_goes_from_its_file_and_a_new_one_comes() -> None:
    rig, curved = parse_rig(RIG_TEXT), load_rig("curved")
    assert rig.wiring is not None
    found = rig.model_copy(update={"wiring": rig.wiring.model_copy(update={"measured": ("baud",), "reads": "fast"})})
    for one, other in ((rig, curved), (rig, rig.model_copy(update={"space": None})), (rig, found)):
        assert parse_rig(dump_rig(other, dump_rig(one))) == other
        assert parse_rig(dump_rig(one, dump_rig(other))) == one


def test_a_unit_of_the_file_becomes_si_without_a_rounding_error() -> None:
    text = RIG_TEXT.replace("value = 27.8,", "value = 27.4,")
    assert parse_rig(text).tendons.base_radius.value == 0.0274


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    rows(r"""
        presliding_angle => presliding_angel => unknown rig key tendons.presliding_angel; did you mean presliding_angle?
        [bus] => [bus]\nlow_pass = 3 => unknown rig key bus.low_pass; did you mean imu.low_pass?
        [bus] => [bus]\nzzz = 3 => expected one of stamp_jitter, drive_delay
        [bus] => [buss] => unknown rig key buss; did you mean bus?
        count = 4\n => \n => rig key tendons.count is missing; expected a value
        [0, 16] => [0] => rig key limits.pretension_mm, entry 2 is missing; expected at least 2 entries
        [bus] => [section]\nhull_mm = [[0, 0], [9, 0], [9]]\n[bus] => section.hull_mm, entry 3, entry 2 is missing
        [bus]\nstamp_jitter = { => [bus]\nstamp_jitter = 3\nx = { => bus.stamp_jitter: found 3, expected { value, unit
        count = 4 => count = "four" => rig key tendons.count: found 'four', expected a valid integer
        count = 4 => count = 4.5 => rig key tendons.count: found 4.5, expected a valid integer
        unit = "mm" => unit = "kg" => rig key silicone.length: unit 'kg' cannot be turned into 'm'
        unit = "rpm" => unit = "rqm" => rig key drive.no_load_speed: unknown unit 'rqm'
        value = 14.7, => value = 24, => drive.supply_voltage: value 24 V is outside its bounds [10, 14.8]
        bounds = [90, 100] => bounds = [-1, 100] => rig key silicone.length: lower bound -1 mm must be above 0
        "paper", => "guess", => expected 'paper', 'data sheet', 'measured', 'calibrated' or 'assumed'
        value = 14.7, => value = nan, => drive.supply_voltage.value: found nan, expected a finite number
        [0, 16] => [16, 0] => rig key limits.pretension_mm: the first number, 16, must be below the second, 0
        count = 4 => count == 4 => is not valid TOML
        count = 4 => count = 4,25  # of them => found 4,25, decimals take a point: 4.25
        count = 4 => count = four  # of them => found 'four' there
    """),
)
def test_a_fault_in_a_rig_is_one_line_with_its_key(old: str, new: str, sentence: str) -> None:
    assert sentence in refusal(parse_rig, RIG_TEXT, *(one.replace(r"\n", "\n") for one in (old, new)))


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    rows("""
        [0, 1, 2, => [0, -1, 2, => plan key pretension.pretension_mm, entry 2: found -1, expected greater than or equal
        amplitude_deg = 20 => amplitude_deg = "20" => plan key sweep.amplitude_deg: found '20', expected a valid number
        1.5, 1.8 => 1.8, 1.5 => plan key sweep.frequency_hz: found 1.8 to 1.5, expected that it increases
        5.6, 6, => 5.6, inf, => found inf, expected a finite number
        repeats = 3 => repeats = 0 => found 0, expected greater than or equal to 1
        mode = "position" => mode = "velocity" => 'position', 'position-with-current-limit' or 'current'
        [3, 4.3] => [3, 4, 4.3] => expected at most 2 items, not 3
    """),
)
def test_a_fault_in_a_plan_is_one_line_with_its_key(old: str, new: str, sentence: str) -> None:
    assert sentence in refusal(parse_plan, PLAN_TEXT, old, new)


def test_a_plan_that_does_nothing_is_refused() -> None:
    assert "needs a [sweep], a [ring_down] or" in refusal(
        parse_plan, PLAN_TEXT, PLAN_TEXT[PLAN_TEXT.index("[sweep]") :], ""
    )


def test_of_several_faults_four_are_told_and_the_rest_counted() -> None:
    text = PLAN_TEXT.replace("settle_s = 3", "settle_s = -3").replace("periods = 5", "periods = 0")
    with pytest.raises(SpecError, match=r"sweep\.settle_s: found -3.*; plan key sweep\.periods: found 0") as caught:
        parse_plan(text)
    assert "more" not in str(caught.value)
    with pytest.raises(SpecError, match=r"entry 4: found -4, expected greater than 0; 4 more faults$"):
        parse_plan(PLAN_TEXT.replace(" 1.5,", " -1, -2, -3, -4, -5, -6, -7, -8,"))


def test_a_rig_in_place_of_a_plan_is_called_a_rig() -> None:
    with pytest.raises(SpecError, match="plan is a rig, expected a plan"):
        parse_plan(RIG_TEXT)


def test_a_name_that_nearly_matches_is_suggested() -> None:
    shipped = "bent, beyond, current, engine, first, paper, quick, short"
    with pytest.raises(SpecError, match=rf"no plan shrt: .*ships {shipped}; did you mean short\?"):
        load_plan("shrt")


def test_a_file_that_is_not_text_is_refused_with_its_path(tmp_path: Path) -> None:
    path = tmp_path / "junk.toml"
    path.write_bytes(b"\x89HDF\r\n\xff\xfe")
    with pytest.raises(SpecError, match=r"junk\.toml is not text"):
        load_plan(path)


def test_a_folder_in_place_of_a_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="is not a file; expected a rig as a TOML file"):
        load_rig(tmp_path)


LONG = 60_000
ATTACKS = {
    "a key of tens of thousands of parts": "a" + ".a" * (LONG // 2) + " = 1",
    "parts of both kinds": "a" + " . 'b'" * (LONG // 6) + " = 1",
    "a header of as many": "[a" + ".a" * (LONG // 2) + "]",
    "a part in an inline table": "x = {a" + ".a" * (LONG // 2) + " = 1}",
    "brackets": "x = " + "[" * LONG,
    "tables in tables": "x = " + "{a = " * (LONG // 5),
    "digits": "x = " + "1" * LONG,
    "a word and spaces": ("a" + " " * 1000) * (LONG // 1000),
    "unended quotes": '"a\n' * (LONG // 3),
    "keys of fifteen parts": "".join("a." * 14 + f"k{number} = 1\n" for number in range(LONG // 40)),
    "tables": "".join(f"[[k{number}]]\n" for number in range(LONG // 12)),
    "too much": "#" * 10_000_000,
}


@pytest.mark.parametrize("text", ATTACKS.values(), ids=ATTACKS.keys())
def test_no_text_keeps_the_reader_busy(text: str) -> None:
    began = time.process_time()
    with pytest.raises(SpecError):
        parse_plan(text)
    assert time.process_time() - began < 2.0  # 8,000 parts of a key took 1.3 s, and twice as many four times as long


def test_a_plan_of_thousands_of_pretensions_is_refused_with_a_sentence() -> None:
    text = PLAN_TEXT.replace(re.findall(r"pretension_mm = \[.*?\]", PLAN_TEXT, re.DOTALL)[0], "pretension_mm = {}")
    many = ", ".join(f"{number / 1000:g}" for number in range(5_000))
    with pytest.raises(SpecError, match=r"found 5000 pretensions, expected at most 500; .*split the plan$"):
        parse_plan(text.replace("{}", f"[{many}]"))


@pytest.mark.parametrize(
    "sweep",
    [
        Sweep(frequency_hz=(1e-9,), periods=100_000),
        Sweep(frequency_hz=(1e-320, 1.0)),
        Sweep(frequency_hz=(1.0,), settle_s=3600.0, repeats=10_000),
    ],
)
def test_a_plan_that_would_last_for_years_is_refused_before_anything_is_made_of_it(sweep: Sweep) -> None:
    with pytest.raises(ValidationError, match="samples in the whole campaign, expected at most"):
        Plan(name="long", pretension=Pretension(pretension_mm=(1.0, 2.0)), sweep=sweep)


PLACED = """\
name = "placed"

[pretension]
pretension_mm = [
  2, # a ] in a comment
  -1,
  8,
]

[sweep]
frequency_hz = [3, 4]
repeats = 2
"""


@pytest.mark.parametrize(
    ("before", "after", "lines"),
    [
        ("", "", [6]),
        ("-1", "6", []),
        ("repeats = 2", 'repeats = "many"', [6, 12]),
        ("repeats", "repets", [6, 12]),
        ("frequency_hz = [3, 4]", "", [6, 10]),
        ("[3, 4]", "[4, 3]", [6, 11]),
        ("[sweep]\nfrequency_hz", "[sweep]\nfrequency_hz = [1]\nfrequency_hz", [12]),
        ('name = "placed"', "name = placed", [1]),
        ("repeats = 2", "repeats =", [12]),
        ('"placed"', '"placed"\nsweep = { repeats = 2 }', [11]),
    ],
)
def test_the_faults_of_a_plan_are_at_their_lines(before: str, after: str, lines: list[int]) -> None:
    assert [fault.line for fault in plan_faults(PLACED.replace(before, after, 1))] == lines


def test_every_fault_of_a_list_is_told_with_what_stands_there() -> None:
    text = PLACED.replace("-1", "9").replace("[3, 4]", "[3, -4, 2, 900, 'x']")
    assert [fault.sentence for fault in plan_faults(text, load_rig("paper"))] == [
        "plan key sweep.frequency_hz, entry 2: found -4, expected greater than 0",
        "plan key sweep.frequency_hz, entry 5: found 'x', expected a valid number",
    ]


def test_limits_of_the_rig_are_told_at_their_lines() -> None:
    text = PLACED.replace("-1", "6").replace("[3, 4]", "[3, 30]").replace("8,", "99,")
    told = [(fault.line, fault.is_limit) for fault in plan_faults(text, load_rig("paper"))]
    assert told == [(4, True), (11, True)]


def test_a_fault_of_a_dotted_key_is_at_its_line() -> None:
    text = 'name = "dotted"\npretension.pretension_mm = [2]\nsweep.frequency_hz = [3]\nsweep.repeats = 0\n'
    assert [fault.line for fault in plan_faults(text)] == [4]


def test_a_section_that_is_missing_is_a_fault_of_the_whole_plan() -> None:
    (fault,) = plan_faults('name = "short"\n[sweep]\nfrequency_hz = [3]\n')
    assert fault.line is None
    assert fault.sentence.startswith("plan key pretension is missing")
