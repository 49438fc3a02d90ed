"""The comparison of two records of the same numbers: it bites where it must, and only there."""

import numpy as np
import pytest
from campaigns.same_numbers import FLOOR, VOLATILE, difference, relative_difference

BEFORE = {
    "predict": {
        "rig": "paper",
        "branches": [{"pretension_mm": 0.0, "peak": None}, {"pretension_mm": 4.0, "peak": 3.1}],
        "wall_s": 2.5,
    },
    "results.nc:gain:values": np.array([1.0, np.nan, 3.0, 1e-14]),
}


def changed(**branch: object) -> dict[str, object]:
    """Return the documents with other values in the second branch."""
    predict = BEFORE["predict"]
    first, second = predict["branches"]  # type: ignore[call-overload]
    return BEFORE | {"predict": predict | {"branches": [first, second | branch]}}  # type: ignore[operator]


def test_the_same_documents_do_not_differ() -> None:
    told = difference(BEFORE, changed())
    assert (told.is_none, told.numbers, told.greatest) == (True, 7, 0.0)


def test_a_number_that_moved_is_told_with_its_path_and_how_far() -> None:
    told = difference(BEFORE, changed(peak=3.1 * (1 + 1e-7)))
    assert (len(told.moved), told.where) == (1, "predict/branches[1]/peak")
    assert told.greatest == pytest.approx(1e-7, rel=1e-3)


def test_a_number_that_moved_within_the_tolerance_is_no_difference() -> None:
    told = difference(BEFORE, changed(peak=3.1 * (1 + 1e-10)))
    assert told.is_none
    assert told.greatest > 0


def test_a_lost_key_is_a_difference_and_an_added_one_is_not() -> None:
    more = changed(fold_hz=2.0)
    assert difference(more, BEFORE).lost == ["predict/branches[]/fold_hz"]
    told = difference(BEFORE, more)
    assert (told.is_none, told.added) == (True, ["predict/branches[]/fold_hz"])


def test_a_lost_document_is_a_difference() -> None:
    told = difference(BEFORE, {"predict": BEFORE["predict"]})
    assert (told.is_none, told.lost) == (False, ["results.nc:gain:values"])


def test_a_key_that_one_row_alone_has_lost_is_a_difference() -> None:
    after = changed()
    after["predict"]["branches"][1].pop("peak")  # type: ignore[index]
    assert difference(BEFORE, after).lost == ["predict/branches[]/peak: 1 fewer"]


@pytest.mark.parametrize("length", [1, 3])
def test_a_list_of_another_length_is_a_difference(length: int) -> None:
    assert not difference({"a": [1.0, 2.0]}, {"a": [1.0, 2.0, 3.0][:length]}).is_none


@pytest.mark.parametrize("now", [None, "3.1", True, float("nan")])
def test_a_number_that_became_something_else_is_a_difference(now: object) -> None:
    assert not difference(BEFORE, changed(peak=now)).is_none


def test_a_changed_word_is_a_difference() -> None:
    assert difference({"verdict": "rises"}, {"verdict": "falls"}).changed == ["verdict: 'rises' -> 'falls'"]


def test_nan_is_the_same_as_nan_and_nothing_else() -> None:
    assert relative_difference(np.nan, np.nan, 1.0) == 0.0
    assert relative_difference(np.nan, 1.0, 1.0) == relative_difference(1.0, np.nan, 1.0) == np.inf


def test_what_is_nearly_zero_is_measured_against_its_array() -> None:
    assert difference({"a": [1.0, 1e-15]}, {"a": [1.0, -3e-15]}).is_none
    assert not difference({"a": [1.0, 1e-15]}, {"a": [1.0, 2e-9 * FLOOR]}).is_none
    assert not difference({"a": 1e-15}, {"a": -3e-15}).is_none


def test_rows_of_one_list_are_one_array() -> None:
    assert difference({"a": [{"x": 1.0}, {"x": 1e-15}]}, {"a": [{"x": 1.0}, {"x": 0.0}]}).is_none


@pytest.mark.parametrize("key", VOLATILE)
def test_of_a_volatile_key_the_value_is_left_out_and_the_loss_is_not(key: str) -> None:
    before = {"a": {key: 1.0, "b": [{key: {"c": "d"}}]}}
    assert difference(before, {"a": {key: "x", "b": [{key: 2.0}]}}).is_none
    assert difference(before, {"a": {key: 1.0, "b": []}}).lost == [f"a/b[]/{key}"]


def test_of_what_ran_in_real_time_the_keys_alone_are_compared() -> None:
    keys_only = ["run"]
    assert difference({"run": {"ms": 1.0}}, {"run": {"ms": 2.0}}, keys_only=keys_only).is_none
    assert not difference({"run": {"ms": 1.0}}, {"run": {}}, keys_only=keys_only).is_none
