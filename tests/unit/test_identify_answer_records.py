"""Which parts of a recording the answers are fitted to."""

import pytest
import xarray as xr
from tests.unit.identify_campaigns import RIG, whole_campaign

from sinew.paper.hardening import CAPPED, records_by_repeat
from sinew.paper.questions import joint_selection


@pytest.fixture(scope="module")
def whole() -> xr.Dataset:
    """A campaign on the twin with all effects."""
    return whole_campaign()


def test_records_are_thinned_and_keep_the_largest_motion(whole: xr.Dataset) -> None:
    records = records_by_repeat(whole, RIG)
    assert list(records) == [3.0, 10.0]
    assert {len(some) for repeats in records.values() for some in repeats.values()} == {min(CAPPED, 8)}
    assert all(record.excitation == "lever" for record in records[3.0][0])


def test_the_part_that_the_joint_is_fitted_to_keeps_every_ring_down_with_its_settling(whole: xr.Dataset) -> None:
    few = joint_selection(whole)
    kinds = list(few["kind"].values)
    assert kinds.count("ring-down") == 4
    assert kinds.count("steady") == 8
    assert kinds.count("settle") == 12
    assert int(few["row_size"].sum()) == few.sizes["sample"]
