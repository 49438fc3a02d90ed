"""The budget of the repository's size: what is counted, what is refused, and that it only falls."""

import ast
import tomllib

import pytest
from tools.check_budget import above, lowered, words_in

BUDGET = {"lines": {"src": 10, "src/plan": 4}, "counts": {"commands": 3, "dict[str, Any]": 2}, "words": {"told": 1}}


def test_a_count_above_its_budget_is_refused_with_its_room_and_what_to_do() -> None:
    assert above(BUDGET, BUDGET | {"lines": {"src": 9, "src/plan": 6}}) == [
        "src/plan has 6 lines and a budget of 4: remove 2, or show which room shrinks by as many"
    ]


def test_lowering_writes_the_smaller_of_budget_and_count_and_keeps_the_rest_of_the_file() -> None:
    text = """line-length = 99

# why
[tool.sinew.budget.lines]
src = 10 # all
"src/plan" = 4

[tool.sinew.budget.counts]
"dict[str, Any]" = 2

[tool.other]
src = 10
"""
    counts = {"lines": {"src": 9, "src/plan": 5}, "counts": {"dict[str, Any]": 1}}
    written = lowered(text, counts)
    assert written == text.replace("src = 10 # all", "src = 9 # all").replace('Any]" = 2', 'Any]" = 1')
    assert tomllib.loads(written)["tool"]["other"]["src"] == 10


@pytest.mark.parametrize(
    ("source", "times"),
    [
        ("told = 1", 1),
        ("class ToldBy(Told): x: WhoTold", 3),
        ("def f(was_told): return was_told.TOLD_BY", 3),
        ("from rooms.told_by import a as told", 2),
        ("f(told=f'{told}')", 2),
        ("stolen, retold, toldest = 'told', 1, 2  # told", 0),
    ],
)
def test_a_word_counts_wherever_it_is_a_whole_part_of_a_name_and_not_in_prose(source: str, times: int) -> None:
    assert words_in(ast.walk(ast.parse(source)))["told"] == times
