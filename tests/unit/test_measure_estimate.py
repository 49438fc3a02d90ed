import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.measure.estimate import (
    Estimate,
    fixed,
    interval,
    number,
    pair,
    parenthesised,
    shown,
    shown_interval,
    span,
    typeset,
)

VALUE = st.floats(-1e5, 1e5).filter(lambda x: x == 0 or abs(x) > 1e-5)
HALF = st.floats(1e-5, 1e3)


def decimals(text: str) -> int:
    return len(text.partition(".")[2])


@pytest.mark.parametrize(
    ("value", "half", "said"),
    [
        (2.7123, 0.0123, "2.712 ± 0.012"),
        (2.7123, 0.0354, "2.712 ± 0.035"),
        (2.7123, 0.0355, "2.71 ± 0.04"),
        (2.7123, 0.0961, "2.71 ± 0.10"),
        (56789.0, 1234.0, "56800 ± 1200"),
        (-0.001, 0.2, "0.00 ± 0.20"),
        (1.23e-5, 2e-7, "(1.230 ± 0.020)e-05"),
        (8.40327, 6.6e-5, "8.40327 ± 0.00007"),
        (1.4, 2.3e-6, "1.4000000 ± 0.0000023"),
    ],
)
def test_the_digits_of_a_value_follow_its_uncertainty(value: float, half: float, said: str) -> None:
    assert pair(value, half) == said


@pytest.mark.parametrize(("value", "std"), [(2.7123, 0.0123), (1.4, 2.3e-6), (56789.0, 1234.0), (1.23e-5, 2e-7)])
def test_text_and_brackets_say_the_uncertainty_that_json_holds(value: float, std: float) -> None:
    one = Estimate.normal(value, std)
    digits, brackets = parenthesised(value, std).removesuffix(")").split("(")[0], one.shown()
    said = float(brackets.split("±")[1].split(")")[0]) * (10.0 ** int(brackets.partition("e")[2] or 0))
    assert one.to_json()["std"] == std
    assert said == pytest.approx(std, rel=0.1)  # one digit from 3.55 on rounds by a tenth
    assert digits in brackets


@pytest.mark.parametrize("half", [0.0, 4.9e-17, 1e-14])
def test_an_uncertainty_of_the_size_of_round_off_is_none(half: float) -> None:
    # a double holds 3 to 4.4e-16
    said = {pair(3.0, half), parenthesised(3.0, half), Estimate.normal(3.0, half).shown()}
    assert said == {"3"}


def test_a_number_without_uncertainty_has_four_digits_and_keeps_whole_ones() -> None:
    assert [number(x) for x in (math.pi, 3.0, 12345.6, 4e-7)] == ["3.142", "3", "12346", "4.000e-07"]


@pytest.mark.parametrize("unknown", [None, math.nan])
def test_what_is_not_known_is_a_dash_wherever_it_stands(unknown: float | None) -> None:
    assert {number(unknown), fixed(unknown, 2), pair(unknown, 1.0), interval(unknown, 0.0, 1.0), shown(None)} == {"–"}
    assert pair(2.5, unknown) == "2.5"
    assert interval(2.5, unknown, unknown) == "2.5"


def test_an_interval_that_is_open_says_which_end_is() -> None:
    assert interval(1.0, -math.inf, 2.0) == "1.0 (-∞ to 2.0)"
    assert interval(1.0, None, 2.0) == "1.0 (– to 2.0)"


def test_an_estimate_and_its_json_read_the_same() -> None:
    one = Estimate.normal(4.294, 0.0123)
    assert shown(one.to_json(), "Hz") == one.shown("Hz") == "4.294 ± 0.012 Hz"
    assert shown_interval(one.to_json(), "Hz") == one.shown_interval("Hz") == "4.294 Hz (4.274 to 4.314)"


def test_a_page_sets_the_sign_as_a_minus_and_leaves_other_hyphens() -> None:
    assert typeset("-3 to -2e-05, ring-down 3-4 (-∞)") == "−3 to −2e-05, ring-down 3-4 (−∞)"


@given(VALUE, HALF)
def test_a_pair_read_back_is_the_value_within_a_tenth_of_its_uncertainty(value: float, half: float) -> None:
    text = pair(value, half)
    found = re.fullmatch(r"\(?(-?[\d.]+) ± ([\d.]+)(?:\)e([+-]\d+))?", text)
    assert found is not None
    scale = 10.0 ** int(found[3] or 0)
    read, uncertainty = float(found[1]) * scale, float(found[2]) * scale
    assert abs(read - value) <= 0.16 * half
    assert 0.85 * half <= uncertainty <= 1.16 * half
    assert decimals(found[1]) == decimals(found[2])


@given(VALUE, HALF)
def test_the_ends_of_an_interval_lie_around_its_value_as_read(value: float, half: float) -> None:
    text = interval(value, value - half, value + half, "Hz")
    ends = [float(x) for x in re.findall(r"-?\d[\d.]*(?:e[+-]\d+)?", text)]
    assert ends[1] < ends[2]
    assert ends[1] <= ends[0] <= ends[2]
    assert span(value - half, value + half) == text.partition("(")[2].rstrip(")")
