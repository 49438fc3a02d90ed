"""The table of facts of the joint in space: a reason counts where it was tested; columns against the exact solution."""

from benchmarks import peers
from campaigns.facts import Row, column_rows, judged, page_of


def test_a_number_that_is_off_is_explained_only_by_a_reason_that_held() -> None:
    told = [judged("f", "1 Hz", "2 Hz", False, "masses", tested=held).verdict for held in (True, False)]
    assert told == ["explained", "NOT MET"]
    assert judged("f", "1 Hz", "2 Hz", False, tested=True).verdict == "NOT MET"


def test_columns_buckle_within_what_the_exact_solution_leaves() -> None:
    assert [row.verdict for row in column_rows()] == ["met"]


def test_the_page_counts_its_verdicts() -> None:
    rows = {"columns": [Row("a", "1", "1", "met"), Row("b", "1", "2", "explained", "mass")]}
    page = page_of(rows)
    assert "1 met, 1 explained, 0 not met." in page
    assert "| b | 1 | 2 | *explained*: mass |" in page


def test_a_peer_that_fails_says_what_it_raised() -> None:
    said = ["Traceback (most recent call last):", "TypeError: no hash", "For simplicity, JAX has removed frames."]
    assert [line for line in said if peers._RAISED.match(line)] == ["TypeError: no hash"]
