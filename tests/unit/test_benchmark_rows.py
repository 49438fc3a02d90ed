"""Rows of the benchmarks' table."""

from benchmarks.table import Row


def test_a_row_says_how_many_times_as_much_the_peer_takes() -> None:
    assert Row("a sum", 0.5, "another", 2.0).text().split() == ["a", "sum", "0.5", "s", "another", "2", "s", "4.00"]


def test_a_peer_that_did_not_run_has_no_number() -> None:
    row = Row("a sum", 0.5, "another", None, note="skipped: not installed")
    assert row.text().split() == ["a", "sum", "0.5", "s", "another", "skipped:", "not", "installed"]
