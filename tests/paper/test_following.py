"""What following a gait takes, by the emulated bench's own registers and by the map of the twin's campaign."""

from functools import cache

import pytest
from campaigns.following import Followed, campaign_map, follow
from campaigns.tracking import expected_at

from sinew.plan.toml import load_rig

pytestmark = [pytest.mark.slow, pytest.mark.long]


@cache
def followed() -> Followed:
    rig = load_rig("paper")
    return follow(expected_at((0.0, 3.0, 6.0, 9.0, 12.0)), campaign_map(rig, 4), rig, up=True, seed=4)


def test_the_energy_that_the_registers_tell_is_the_maps_within_a_tenth() -> None:
    # Two ways to the same number: bytes of a motion that never stands still, and steady swings of the twin.
    drive, holding = followed().measured_j
    by_map, _ = followed().tuned
    assert drive == pytest.approx(by_map.drive.value, rel=0.1)
    assert holding == pytest.approx(by_map.holding.value, rel=0.15)


def test_only_a_pretension_that_follows_lets_the_drive_make_the_motion() -> None:
    assert followed().tuned[1] == 1.0
    assert max(reached for _, reached in followed().fixed.values()) < 0.7


def test_no_pretension_is_cheaper_for_the_drive_than_the_cheapest_at_each_frequency() -> None:
    least = followed().cheapest[0].drive.value
    assert all(least < 1.02 * found.drive.value for found, _ in followed().fixed.values())
