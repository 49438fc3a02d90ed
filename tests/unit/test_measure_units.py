"""Units that people write in headers and on the command line."""

import math
import time

import pytest

from sinew.measure.errors import UnitError
from sinew.measure.files.names import role_of, unit_in_name, unit_suffix
from sinew.measure.units import canonical_unit, convert, local_time, number_list, one_number, with_unit

DEGREE = math.pi / 180


FACTORS = {
    "rad": {"deg": DEGREE, "°": DEGREE, "degrees": DEGREE, "rad": 1, "mrad": 1e-3, "rev": 2 * math.pi},
    "m": {"mm": 1e-3, "um": 1e-6, "in": 0.0254},
    "s": {"s": 1, "ms": 1e-3, "us": 1e-6, "µs": 1e-6},
    "V": {"V": 1, "mV": 1e-3},
    "A": {"A": 1, "mA": 1e-3},
    "N": {"N": 1, "kN": 1e3},
    "N*m": {"N*m": 1, "Nm": 1, "N m": 1, "N·m": 1, "mNm": 1e-3},
    "J": {"J": 1},
    "N*m/rad": {"N*m/rad": 1},
    "N*m*s/rad": {"N*m*s/rad": 1},
    "N/m": {"N/mm": 1e3},
    "rad/s": {"deg/s": DEGREE, "°/s": DEGREE, "dps": DEGREE, "rpm": 2 * math.pi / 60},
    "rad/s2": {"deg/s^2": DEGREE},
    "m/s2": {"m/s2": 1, "m/s^2": 1, "m/s²": 1, "g_0": 9.80665},
    "Hz": {"Hz": 1, "kHz": 1e3},
    "1/s": {"1/s": 1},
    "kg": {"kg": 1, "gram": 1e-3},
    "kg*m2": {"kg*m^2": 1},
    "1": {"%": 0.01, "counts": 1, "1": 1, "": 1},
}


@pytest.mark.parametrize(
    ("written", "unit", "factor"),
    [(one, unit, factor) for unit, spelt in FACTORS.items() for one, factor in spelt.items()],
)
def test_a_written_unit_becomes_a_readable_one_in_si_and_radians(written: str, unit: str, factor: float) -> None:
    assert canonical_unit(written) == (unit, pytest.approx(factor, rel=1e-12))


@pytest.mark.parametrize("written", ["hello there", "xyz", "9**9**9", "m**9999", "2*m", "(", "m)", "**", "🙂"])
def test_what_is_no_unit_is_refused_with_examples_of_units(written: str) -> None:
    with pytest.raises(UnitError, match=r"unknown unit .* write it like deg, rad"):
        canonical_unit(written)


@pytest.mark.parametrize("written", ["g", "G", "mg"])
def test_a_unit_that_may_be_mass_or_acceleration_is_refused_with_both_ways_out(written: str) -> None:
    with pytest.raises(UnitError, match=r"ambiguous; write '.*_0'"):
        canonical_unit(written)


@pytest.mark.parametrize("written", ["degC", "°C", "dB"])
def test_a_unit_that_is_no_plain_factor_is_refused(written: str) -> None:
    with pytest.raises(UnitError, match="does not start at zero"):
        canonical_unit(written)


def test_a_conversion_between_dimensions_is_refused_naming_both() -> None:
    with pytest.raises(UnitError, match="'mm' cannot be turned into 's'"):
        convert("mm", "s")


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("host_time_s", "s"),
        ("t_ms", "ms"),
        ("angle_deg", "deg"),
        ("Tip-1_x_m", "m"),
        ("tip_MM", "mm"),
        ("X1_V", "V"),
        ("gyro_x_rad_s", "rad/s"),
        ("acceleration_z_m_s2", "m/s2"),
        ("torque_n_m", "N*m"),
        ("angle (deg)", "deg"),
        ("x [mm]", "mm"),
        ("torque [N m]", "N m"),
        ("x (raw)", None),
        ("x (copy) y", None),
        ("angle_a", None),
        ("t", None),
        ("s", None),
    ],
)
def test_a_column_name_states_a_unit_only_where_that_is_clear(column: str, unit: str | None) -> None:
    assert unit_in_name(column) == unit


TIMES = {
    "ms": ["t/ms", "Zeit / ms", "Time, ms", "t in ms", "time.ms", "TIME:ms", "Time(ms)", "msec", "elapsed_millis"],
    "us": ["stamp_us", "micros()"],
    "ns": ["timestamp_ns", "time_nanosec"],
    "min": ["t (min)"],
    None: ["__time", "X_Value", "Time from start"],
}


@pytest.mark.parametrize(("unit", "name"), [(unit, name) for unit, names in TIMES.items() for name in names])
def test_every_usual_way_to_write_the_unit_of_a_time_is_read(unit: str | None, name: str) -> None:
    assert (unit_in_name(name), role_of(name)) == (unit, "time")


ROLES = {
    "drive": [("Kraft in N", "N"), ("goalPosition", None), ("set point", None)],
    "response": [("Gyroscope x (rad/s)", "rad/s"), ("/joint/angle", None), ("angle_min", None)],
    "none": [("input_volts", None), ("servo_id", None)],
    "": [("a/m/s2", "m/s2"), ("time_of_flight_mm", "mm"), ("inputs", None)],
}


@pytest.mark.parametrize(("role", "name"), [(role, name) for role, names in ROLES.items() for name in names])
def test_whole_words_say_what_a_column_is(role: str, name: tuple[str, str | None]) -> None:
    assert (role_of(name[0]), unit_in_name(name[0])) == (role, name[1])


@pytest.mark.parametrize("unit", ["rad", "rad/s", "m", "m/s2", "N*m", "V", "s"])
def test_a_name_that_is_given_a_suffix_states_that_unit_again(unit: str) -> None:
    assert unit_in_name(f"x_{unit_suffix(unit)}") == unit


@pytest.mark.parametrize("text", ["1,5; 2,5", "1,5 2,5", "0,4, 8"])
def test_a_comma_between_digits_is_refused_next_to_another_separator(text: str) -> None:
    with pytest.raises(ValueError, match=r"write '[\d.]+.*' for decimals, '\d, \d.*' for a list"):
        number_list(text)


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("2,5", [2, 5]),
        (" [0,6] ", [0, 6]),
        ("2, 5", [2, 5]),
        ("0,4,8,12", [0, 4, 8, 12]),
        ("3.2,3.6", [3.2, 3.6]),
        ("2; 5", [2, 5]),
        ("2.5", [2.5]),
    ],
)
def test_a_list_is_read_where_its_commas_can_only_separate(text: str, numbers: list[float]) -> None:
    assert number_list(text) == numbers


def test_one_number_with_a_decimal_comma_is_told_to_take_a_point() -> None:
    with pytest.raises(ValueError, match=r"found '2,5', expected one number; decimals take a point: 2\.5"):
        one_number("2,5")


def test_a_time_is_shown_in_the_zone_of_the_computer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Europe/Berlin")
    time.tzset()
    try:
        assert local_time("2026-07-01T12:05:10.123+00:00") == "2026-07-01 14:05+02:00"
        assert local_time("2026-01-01T12:05:10") == "2026-01-01 13:05+01:00"
        assert local_time("–") == "–"
    finally:
        monkeypatch.undo()
        time.tzset()


def test_a_column_has_its_unit_behind_a_stroke_in_brackets_where_the_unit_is_made_of_several() -> None:
    heads = [with_unit("force", unit) for unit in ("N", "N*m", "m/s2", "1", "")]
    assert heads == ["force/N", "force/(N*m)", "force/(m/s2)", "force", "force"]
