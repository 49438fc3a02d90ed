"""The wiring of a rig: what fits together, and one helpful line for what does not."""

import re

import pytest
from pydantic import ValidationError
from tests.tables import rows
from tests.unit.plan_faults import refusal

from sinew.plan.rig import Wiring
from sinew.plan.toml import dump_rig, load_rig, parse_rig

PAPER = load_rig("paper")
TEXT = dump_rig(PAPER)
WITHOUT = TEXT[: TEXT.index("[wiring]")]


def without_window_and_travel(text: str) -> str:
    return re.sub(r"(tendon_travel_mm|drive_window_deg) = .*\n", "", text)


def test_a_rig_file_from_before_there_was_a_wiring_still_loads() -> None:
    assert parse_rig(without_window_and_travel(WITHOUT)) == PAPER


def test_a_rig_without_wiring_has_a_motor_for_every_tendon() -> None:
    three = parse_rig(WITHOUT.replace("count = 4", "count = 3"))
    assert (three.wiring.tendon_ids, three.wiring.drive_id, three.wiring.tendon_pull) == ((1, 2, 3), 4, (1, 1, 1))


def test_a_rig_of_three_tendons_keeps_its_wiring_when_its_values_change() -> None:
    three = parse_rig(WITHOUT.replace("count = 4", "count = 3"))
    assert three.with_values({"silicone.length": 0.096}).wiring == three.wiring


def test_a_wiring_comes_back_from_its_text() -> None:
    wiring = Wiring(
        baud=4_000_000,
        tendon_ids=(9, 7, 3, 1),
        drive_id=0,
        imu_id=252,
        tendon_pull=(-1, 1, -1, 1),
        drive_sign=-1,
        drive_zero_counts=-17,
        imu_axes=("+z", "+x", "+y"),
        latency_ms=1.5,
    )
    rig = PAPER.model_copy(update={"wiring": wiring})
    assert parse_rig(dump_rig(rig)).wiring == wiring
    three = parse_rig(WITHOUT.replace("count = 4", "count = 3"))
    found = three.model_copy(update={"wiring": three.wiring.model_copy(update={"baud": 4_000_000})})
    assert parse_rig(dump_rig(found, WITHOUT)) == found  # into a file that has none


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    rows("""
        tendon_ids = [1, 2, 3, 4] => tendon_ids = [1, 2, 2, 4] => wiring: id 2 stands for two devices
        imu_id = 200 => imu_id = 5 => wiring: id 5 stands for two devices
        drive_id = 5 => drive_id = 254 => wiring.drive_id: found 254, expected less than or equal
        tendon_pull = [1, 1, 1, 1] => tendon_pull = [1, 1, 1] => 3 signs for 4 tendon_ids
        drive_sign = 1 => drive_sign = 2 => wiring.drive_sign: found 2, expected 1 or -1
        count = 4 => count = 3 => wiring.tendon_ids has 4 ids and tendons.count is 3
        ["+x", "+y" => ["x", "+y" => wiring.imu_axes, entry 1: found 'x', expected '+x', '-x'
        ["+x", "+y" => ["+x", "-x" => imu_axes +x, -x, +z are no right-handed frame
        ["+x", "+y" => ["-x", "+y" => imu_axes -x, +y, +z are no right-handed frame
        drive_id = 5 => drive_ids = 5 => unknown rig key wiring.drive_ids; did you mean drive_id?
        drive_model = "XM430 => drive_model = "XL320 => wiring.drive_model: no servo 'XL320-W350' is known
        tendon_model = "XH430 => tendon_model = "MX28 => wiring.tendon_model: no servo 'MX28-W350' is known
        latency_ms = 4 => latency_ms = 0 => wiring.latency_ms: found 0, expected greater than 0
        [-20, 40] => [40, -20] => limits.tendon_travel_mm: the first number, 40
    """),
)
def test_a_fault_in_a_wiring_is_one_line_with_its_key(old: str, new: str, sentence: str) -> None:
    assert sentence in refusal(parse_rig, TEXT, old, new)


def test_half_of_the_48_ways_to_name_signed_axes_are_right_handed() -> None:
    letters = [(a, b, c) for a in "xyz" for b in "xyz" for c in "xyz" if len({a, b, c}) == 3]
    signs = [(a, b, c) for a in "+-" for b in "+-" for c in "+-"]
    right = 0
    for letter in letters:
        for sign in signs:
            try:
                Wiring.model_validate({"imu_axes": tuple(s + x for s, x in zip(sign, letter, strict=True))})
                right += 1
            except ValidationError:
                pass
    assert right == 24
