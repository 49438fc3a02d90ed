"""The form of a plan: every field from the models, every fault at its field, every plan there and back."""

import pytest

from sinew.apps.dashboard.work.form import fields_of, form_of, plan_from_form
from sinew.plan.plan import Plan
from sinew.plan.toml import list_shipped, load_plan, parse_plan

SWEEP = {"name": "x", "pretension.pretension_mm": "0, 4, 8", "sweep.frequency_hz": "2, 3"}


def field(path: str) -> dict[str, object]:
    return next(row for row in fields_of() if row["path"] == path)


def made(**changes: object) -> Plan:
    text, errors = plan_from_form(SWEEP | {key.replace("__", "."): value for key, value in changes.items()})
    assert errors == {}
    assert text is not None
    return parse_plan(text)


def fault(path: str, **changes: object) -> str:
    text, errors = plan_from_form(SWEEP | {key.replace("__", "."): value for key, value in changes.items()})
    assert text is None
    return errors[path]


@pytest.mark.parametrize("name", list_shipped("plans"))
def test_a_plan_goes_into_the_form_and_comes_back(name: str) -> None:
    text, _ = plan_from_form(form_of(load_plan(name)))
    assert text is not None
    assert parse_plan(text) == load_plan(name)


def test_every_key_of_a_plan_is_a_field_with_words_on_what_it_is() -> None:
    paths = {row["path"] for row in fields_of()}
    parts = {name: info.annotation for name, info in Plan.model_fields.items()}
    assert parts.keys() - {"pretension"} <= paths
    assert [
        row["path"]
        for row in fields_of()
        if not row["help"] and row["path"] not in ("sweep.settle_tolerance", "sweep.settle_most_s")
    ] == []


def test_a_field_has_the_bounds_of_its_model() -> None:
    row = field("sweep.settle_tolerance")
    assert (row["ge"], row["le"], row["default"]) == (1e-4, 0.5, 0.01)


def test_a_list_has_the_bounds_of_each_of_its_numbers() -> None:
    assert field("sweep.frequency_hz")["gt"] == 0


def test_a_field_with_a_unit_has_it_in_its_title() -> None:
    assert field("sweep.amplitude_deg")["title"] == "Amplitude / °"


def test_a_choice_lists_what_can_be_chosen() -> None:
    assert field("track.held")["choices"] == ["command", "lever", "torsion"]


def test_a_list_is_read_from_commas_and_spaces() -> None:
    assert made(sweep__frequency_hz="2, 3 4;5").sweep == made(sweep__frequency_hz=[2, 3, 4, 5]).sweep


def test_a_range_holds_both_ends() -> None:
    sweep = made(sweep__frequency_hz="1:2:0.25, 2.6").sweep
    assert sweep is not None
    assert sweep.frequency_hz == (1.0, 1.25, 1.5, 1.75, 2.0, 2.6)


def test_a_range_of_tenths_gives_the_numbers_that_a_person_would_write() -> None:
    sweep = made(sweep__frequency_hz="1:2:0.1").sweep
    assert sweep is not None
    assert sweep.frequency_hz[3] == 1.3


def test_an_endless_range_is_refused() -> None:
    assert "more than 10000 numbers" in fault("sweep.frequency_hz", sweep__frequency_hz="1:2:1e-9")


@pytest.mark.parametrize("text", ["1:2", "2:1:0.1", "1:2:0", "1:2:-1", "a", "1, b", "nan", "1:inf:1"])
def test_what_is_no_list_of_numbers_is_said_at_its_field(text: str) -> None:
    assert fault("sweep.frequency_hz", sweep__frequency_hz=text).startswith("found ")


def test_a_number_beyond_its_bounds_is_said_at_its_field() -> None:
    assert fault("sweep.amplitude_deg", sweep__amplitude_deg=-1) == "found -1.0, expected greater than 0"


def test_half_a_repeat_is_refused() -> None:
    assert fault("sweep.repeats", sweep__repeats=2.5) == "found 2.5, expected a whole number"


def test_a_fault_of_the_whole_part_is_said_at_the_field_that_it_names() -> None:
    assert "more than once" in fault("pretension.pretension_mm", pretension__pretension_mm="0, 4, 4")


def test_a_plan_without_anything_to_do_is_refused_as_a_whole() -> None:
    assert "a plan needs a [sweep]" in fault("", sweep=False)


def test_an_unknown_field_is_refused() -> None:
    assert "no key sweep.colour" in fault("sweep.colour", sweep__colour="red")


def test_a_part_that_is_switched_off_leaves_its_fields_unread() -> None:
    assert made(ring_down=False, ring_down__frequency_hz="nonsense").ring_down is None


def test_several_faults_are_said_at_once() -> None:
    _, errors = plan_from_form(SWEEP | {"sweep.repeats": "x", "sweep.amplitude_deg": "-3", "name": ""})
    assert errors.keys() == {"sweep.repeats", "sweep.amplitude_deg", "name"}
