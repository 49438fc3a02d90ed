"""Rigs and plans as TOML files, number for number there and back."""

import difflib
import json
import math
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar, get_args

import tomlkit
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Table

from sinew.measure.errors import SpecError
from sinew.measure.validation import write_text
from sinew.plan.check import setting_findings
from sinew.plan.parameter import Parameter, converted
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec

# The rigs and plans that ship with Sinew are found, and where a name becomes a text.

Shelf = Literal["rigs", "plans"]


def list_shipped(shelf: Shelf) -> list[str]:
    """Return the names of the rigs or plans that ship with Sinew, in alphabetical order."""
    entries = files("sinew").joinpath(shelf).iterdir()
    return sorted(entry.name.removesuffix(".toml") for entry in entries if entry.name.endswith(".toml"))


def read_spec(shelf: Shelf, path_or_name: str | Path) -> str:
    """Return the text of a rig or plan: of the file at a path, else of the shipped one of that name.

    path_or_name: `paper`, `paper.toml`, `rigs/paper.toml`, or the path of a file. A file that exists comes first; a
        folder is passed over, such as `sinew reproduce --out paper` leaves.
    Raises SpecError where there is neither, or where the file is not UTF-8 text.
    """
    path = Path(path_or_name)
    if path.is_file():
        return _read(path)
    what = shelf.removesuffix("s")
    name, shipped = path.name.removesuffix(".toml"), list_shipped(shelf)
    if str(path.parent) in (".", shelf) and name in shipped:
        return files("sinew").joinpath(shelf, f"{name}.toml").read_text(encoding="utf-8")
    if path.exists():
        raise SpecError(f"{path} is not a file; expected a {what} as a TOML file")
    close = difflib.get_close_matches(name, shipped, n=1)
    advice = f"; did you mean {close[0]}?" if close else ""
    raise SpecError(f"no {what} {path_or_name}: found no such file, and Sinew ships {', '.join(shipped)}{advice}")


def read_posterior(rig: str) -> dict[str, dict[str, Any]] | None:
    """Return what the paper's numbers leave of each calibrated parameter of a shipped rig; None where it is not known.

    By dotted name `{"unit", "prior90": [low, high], "median", "posterior90": [low, high], "ratio", ...}`, SI, as
    `sinew calibrate --paper --posterior` writes it beside the rig.
    """
    path = files("sinew").joinpath("rigs", f"{rig}-posterior.json")
    return dict(json.loads(path.read_text(encoding="utf-8"))["parameters"]) if path.is_file() else None


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise SpecError(f"{path} is not text (byte {error.start}); expected TOML in UTF-8") from error
    except OSError as error:
        raise SpecError(f"cannot read {path}: {error.strerror or error}") from error


# A failed validation becomes one sentence a fault: the location as pydantic has it, what was found, what was expected.

_PLAIN = {int: "a whole number", float: "a number", str: "a text"}
_PREFIX = re.compile(r"^(Input|String|Tuple|List|Value) should (be |have )?")
_MOST_TOLD, _MOST_FAULTS = 4, 100

_Location = tuple[int | str, ...]
_Spec = TypeVar("_Spec", RigSpec, Plan)


def complaint(error: ValidationError, model: type[BaseModel], what: str) -> str:
    """Return one line on the faults of a rig or plan. what: "rig" or "plan"."""
    lines = [sentence for _, sentence in _faults(error, model, what)]
    most = len(lines) if len(lines) <= _MOST_TOLD + 1 else _MOST_TOLD
    return "; ".join([*lines[:most], *([f"{len(lines) - most} more faults"] if most < len(lines) else [])])


def _faults(error: ValidationError, model: type[BaseModel], what: str) -> list[tuple[_Location, str]]:
    """Return (location, sentence) of each fault, unknown keys first: what is meant by a misspelt one is not missing."""
    expected = dict(_expected(model))
    found = error.errors(include_url=False)
    unknown = [one["loc"] for one in found if one["type"] == "extra_forbidden"]
    meant = {loc: _meant(loc, expected) for loc in unknown[:_MOST_FAULTS]}
    lines = []
    for loc in unknown:
        parent = ".".join(map(str, loc[:-1]))
        keys = [key.removeprefix(f"{parent}.") for key in expected if key.rpartition(".")[0] == parent]
        near = (meant.get(loc) or "").removeprefix(f"{parent}.")
        advice = f"did you mean {near}?" if near else f"expected one of {', '.join(keys)}"
        lines.append((loc, f"unknown {what} key {'.'.join(map(str, loc))}; {advice}"))
    for one in found:
        is_meant = one["type"] == "missing" and ".".join(map(str, one["loc"])) in meant.values()
        if one["type"] != "extra_forbidden" and not is_meant:
            lines.append((one["loc"], " ".join(_sentence(one, what, expected).split())))
    return lines


def _sentence(fault: ErrorDetails, what: str, expected: Mapping[str, str]) -> str:
    loc = fault["loc"]
    key = "".join(f", entry {part + 1}" if isinstance(part, int) else f".{part}" for part in loc).removeprefix(".")
    where = f"{what} key {key}" if key else what
    known = expected.get(key)
    if fault["type"] == "value_error":
        return f"{where}: {str(fault['msg']).removeprefix('Value error, ')}"
    if fault["type"] == "missing":
        entries = f"at least {loc[-1] + 1} entries" if isinstance(loc[-1], int) else "a value"
        return f"{where} is missing; expected {known or entries}"
    found = fault["input"]
    shown = "a section" if isinstance(found, dict) else repr(list(found) if isinstance(found, tuple) else found)
    wanted = (
        known
        if fault["type"] == "model_type" and known
        else _PREFIX.sub("", str(fault["msg"])).replace(" after validation", "")
    )
    return f"{where}: found {shown if len(shown) <= 60 else f'{shown[:57]}...'}, expected {wanted}"


def _expected(model: type[BaseModel], before: str = "") -> Iterator[tuple[str, str]]:
    """Yield (dotted name, what is expected there) of every key and section."""
    for name, field in model.model_fields.items():
        dotted, kinds = f"{before}{name}", (field.annotation, *get_args(field.annotation))
        inner = next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)), None)
        if inner is None:
            yield dotted, _PLAIN.get(kinds[0], "a value")
            continue
        keys = ", ".join(inner.model_fields)
        yield dotted, "{ value, unit, origin, bounds }" if inner is Parameter else f"a section [{dotted}] with {keys}"
        yield from _expected(inner, f"{dotted}.")


def _meant(location: _Location, expected: Iterable[str]) -> str | None:
    """Return the key of the same section that a key resembles, else one of its name in another section."""
    *parents, name = map(str, location)
    own = {key.rpartition(".")[2]: key for key in expected if key.rpartition(".")[0] == ".".join(parents)}
    close = difflib.get_close_matches(name, own, n=1)
    elsewhere = (key for key in expected if key.rpartition(".")[2] == name)
    return own[close[0]] if close else next(elsewhere, None)


MOST_CHARACTERS = 256 * 1024
"""A longer text is no rig and no plan: the longest that Sinew writes, with a calibration, has a tenth of it."""

_MOST_PARTS = 16
# The parser's time grows with the square of the parts of a dotted key. This finds one that has too many, wherever it
# stands; it looks at no character more than a few times, so no text makes it slow.
_DEEP = re.compile(
    r"""(?<![\w\-\\])(?:(?:[\w\-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+)"""
    rf"{{{_MOST_PARTS}}}"
)

_RIG_HEADER = """\
# A test bed. Each parameter has a value in its unit, an origin (paper, data sheet, measured, calibrated or assumed),
# the bounds of what is physically thinkable, and a note. Any unit of the right dimension may stand here.
"""
_PLAN_HEADER = """\
# A campaign: pretensions to visit; at each of them a sweep, ring-downs, or both.
"""

_FILE_UNITS = {"m": "mm", "m^2": "mm^2", "m^4": "mm^4", "m^6": "mm^6", "m/s^2": "g_0", "s": "ms"} | {
    "drive.no_load_speed": "rpm",
    "drive.current_lsb": "mA",
    "tendons.current_lsb": "mA",
    "imu.gyro_range": "deg/s",
    "imu.gyro_lsb": "deg/s",
    "imu.gyro_noise": "deg/s",
    "imu.gyro_bias": "deg/s",
}
"""Units that read better in a file than those that the model keeps, by that unit or by the name of a parameter."""

_FILE_REMARKS = {
    "space.rest_bend_deg": "at which the silicone was cast",
    "space.rest_azimuth_deg": "of that bend, from y towards z",
    "space.routing": "chord: tendons straight from plate to plate; channel: they follow the silicone",
    "pose.azimuth_deg": "from y of the base towards z; the lever at rest lies along y",
    "limits.tendon_travel_mm": "of a tendon motor about its first contact, as length of cable; pulling is positive",
    "limits.drive_window_deg": "of the lever about its zero, either way",
    "limits.safe_state": "release: let the tension go, then torque off; hold: stay, with little current",
    "wiring.baud": "of the bus",
    "wiring.tendon_ids": "of the motors, in the order of the tendons",
    "wiring.tendon_pull": "1 where more counts of the encoder pull, -1 where they let go",
    "wiring.drive_sign": "1 where more counts turn the lever positively against the head, else -1",
    "wiring.drive_zero_counts": "encoder reading with the lever in its middle",
    "wiring.imu_axes": "axes of the chip that point along x, y and z of the head",
    "calibration.pretension_mm": "of the recordings",
    "calibration.std": "in SI, in the order of the parameters",
    "calibration.correlation": "lower triangle",
    "wiring.measured": "keys of the wiring that were found on this bench",
    "wiring.latency_ms": "of port, driver and operating system, on top of the time on the wire",
}
"""What a key that is no parameter, and has no note therefore, means; it stands behind it in the file."""

_UNSAID = (
    "wiring.measured",
    "sweep.drive",
    "ring_down.drive",
)
"""Keys that a file leaves out while they keep their default: the texts in older recordings stay as they are written."""


def load_rig(path_or_name: str | Path) -> RigSpec:
    """Return the rig of a TOML file, or the shipped one of that name (`paper`). Raises SpecError.

    >>> import sinew as sn
    >>> sn.load_rig("paper").silicone.length.value
    0.095
    """
    return parse_rig(read_spec("rigs", path_or_name), source=str(path_or_name))


def load_plan(path_or_name: str | Path) -> Plan:
    """Return the plan of a TOML file, or the shipped one of that name (`paper`, `short`). Raises SpecError.

    >>> import sinew as sn
    >>> sn.load_plan("short").pretension.pretension_mm
    (0.0, 6.0, 12.0)
    """
    return parse_plan(read_spec("plans", path_or_name), source=str(path_or_name))


def parse_rig(text: str, source: str = "rig") -> RigSpec:
    """Return the rig that a TOML text describes.

    source: what to call the text in an error, its path for instance.
    Raises SpecError with one line on the first fault, and how many more there are.
    """
    return _parse(text, source, RigSpec, "rig")


def parse_plan(text: str, source: str = "plan") -> Plan:
    """Return the plan that a TOML text describes; arguments and errors as for `parse_rig`."""
    return _parse(text, source, Plan, "plan")


class Fault(NamedTuple):
    """What is wrong with a text. line: of the text, counted from 1, at which it is to be mended; None: as a whole.
    is_limit: whether it is a limit of the rig that is broken; the text is a plan all the same."""

    line: int | None
    sentence: str
    is_limit: bool = False


def plan_faults(text: str, rig: RigSpec | None = None) -> list[Fault]:
    r"""Return all that is wrong with a TOML text as a plan, each at its line; empty where `parse_plan` takes it.

    A key that is missing is told at the head of its section. As TOML that cannot be read goes no further, of that there
    is one fault. rig: with it also which of its limits a plan without faults breaks.

    >>> plan_faults('name = "quick"\n[pretension]\npretension_mm = 2\n')[0].line
    3
    """
    try:
        data = _read_data(text, "the plan", Plan, "plan")
    except SpecError as trouble:
        return [Fault(_told_line(str(trouble), text), str(trouble))]
    line_of = _lines_of(text)
    try:
        plan = Plan.model_validate(_frozen(data), strict=True)
    except ValidationError as error:
        found = [Fault(line_of(loc), sentence) for loc, sentence in _faults(error, Plan, "plan")[:_MOST_FAULTS]]
    else:
        broken = setting_findings(plan, rig) if rig is not None else ()
        found = [Fault(line_of(tuple(filter(None, one.key.split(".")))), one.sentence, is_limit=True) for one in broken]
    return sorted(found, key=lambda one: one.line or 0)


def _told_line(sentence: str, text: str) -> int | None:
    """Return the line that a sentence of the TOML parser names; its end of document is the last line with anything."""
    if (named := re.search(r"\bline (\d+)", sentence)) is not None:
        return int(named[1])
    return text.rstrip().count("\n") + 1 if "end of document" in sentence else None


_MARK = "\N{REFERENCE MARK}"
_MOST_LINED = 64 * 1024  # characters of a text whose lines are looked for; a plan has some thousands


def _lines_of(text: str) -> Callable[[_Location], int | None]:
    """Return what gives the line, from 1, of a key or entry of a valid text, else of the nearest that it lies in.

    A mark is put where it stands, and found in what tomlkit writes. None where there is no such line.
    """
    try:
        document: Any = tomlkit.parse(text) if len(text) <= _MOST_LINED and _MARK not in text else {}
    except (TOMLKitError, RecursionError):
        document = {}

    def line_of(location: _Location) -> int | None:
        holder, key, at = None, None, document
        for part in location:
            try:
                holder, key, at = at, part, at[part]
            except (LookupError, TypeError):
                break
        if holder is None:
            return None
        if isinstance(at, Table) and not at.is_super_table():
            before, at.trivia.comment = at.trivia.comment, _MARK
            marked = document.as_string()
            at.trivia.comment = before
        else:
            holder[key] = _MARK
            marked = document.as_string()
            holder[key] = at
        return marked.partition(_MARK)[0].count("\n") + 1 if _MARK in marked else None

    return line_of


def dump_rig(rig: RigSpec, like: str = "") -> str:
    """Return a rig as TOML, one line a parameter, such that `parse_rig` gives the same rig to the last bit.

    like: the text of a rig from which it was made. Its comments and its order stay, and the lines of what is the same.

    >>> import sinew as sn
    >>> "[silicone]" in sn.dump_rig(sn.load_rig("paper"))
    True
    """
    text = _RIG_HEADER + _table(rig)
    if not like:
        return text
    _, header, mine = like.rpartition(_RIG_HEADER)  # what stands before the header, Sinew wrote when it made that file
    document = tomlkit.parse(header + mine)
    _update(document, tomlkit.parse(text), parse_rig(like), rig)
    return document.as_string()


def _update(old: Any, new: Any, before: BaseModel | None, after: BaseModel) -> None:
    """Make a section say what another one says, but for what was the same before."""
    for key in [key for key in old if key not in new and getattr(before, key, None) != getattr(after, key)]:
        del old[key]
    for key, item in new.items():
        value, was = getattr(after, key), getattr(before, key, None)
        if key in old and value == was:
            continue
        if key in old and isinstance(value, BaseModel) and not isinstance(value, Parameter):
            _update(old[key], item, was, value)
        else:
            old[key] = item


def dump_plan(plan: Plan) -> str:
    """Return a plan as TOML, such that `parse_plan` gives the same plan to the last bit.

    >>> import sinew as sn
    >>> "[sweep]" in sn.dump_plan(sn.load_plan("short"))
    True
    """
    return _PLAN_HEADER + _table(plan)


def save_rig(rig: RigSpec, path: Path, head: Sequence[str] = (), like: str = "") -> None:
    """Write a rig file, atomically. Raises FileError where it cannot be written.

    head: lines of comment before it. like: the text of a rig whose comments are kept, see `dump_rig`.
    """
    write_text(path, "".join(f"# {' '.join(line.split())}\n" for line in head) + dump_rig(rig, like))


def save_plan(plan: Plan, path: Path) -> None:
    """Write a plan file, atomically. Raises FileError where it cannot be written."""
    write_text(path, dump_plan(plan))


def _parse(text: str, source: str, model: type[_Spec], what: str) -> _Spec:
    data = _read_data(text, source, model, what)
    try:
        return model.model_validate(_frozen(data), strict=True)
    except ValidationError as error:
        raise SpecError(f"{source}: {complaint(error, model, what)}") from error


def _read_data(text: str, source: str, model: type[_Spec], what: str) -> dict[str, Any]:
    """Return the data of a text that may be a rig or a plan. Raises SpecError."""
    if len(text) > MOST_CHARACTERS:
        raise SpecError(f"{source} has {len(text)} characters, expected at most {MOST_CHARACTERS} of a {what}")
    if (deep := _DEEP.search(text)) is not None:
        line = text.count("\n", 0, deep.start()) + 1
        raise SpecError(f"{source}, line {line}: found a key of more than {_MOST_PARTS} parts; no {what} has one")
    try:
        data = tomllib.loads(text)
    except ValueError as error:  # of the parser, or of a number with thousands of digits
        raise SpecError(f"{source} is not valid TOML: {error}{_found_at(text, str(error))}") from error
    except RecursionError:
        raise SpecError(f"{source} is nested too deeply for a {what}; take brackets away") from None
    other, other_what = (Plan, "plan") if what == "rig" else (RigSpec, "rig")
    if _shared_keys(data, other) > _shared_keys(data, model):
        raise SpecError(f"{source} is a {other_what}, expected a {what}")
    return data


def _found_at(text: str, error: str) -> str:
    """Return the word at which the parser gave up, or what to write for a decimal comma; empty without a location."""
    if (at := re.search(r"at line (\d+), column (\d+)", error)) is None:
        return ""
    line = [*text.splitlines(), ""][min(int(at[1]) - 1, len(text.splitlines()))]
    if decimal := re.search(r"= *(-?\d+),(\d+) *(#|$)", line):  # no list: there a comma is taken
        return f"; found {decimal[1]},{decimal[2]}, decimals take a point: {decimal[1]}.{decimal[2]}"
    word = re.split(r"[\s,\]}#]", line[int(at[2]) - 1 :], maxsplit=1)[0][:40]
    return f"; found {word!r} there" if word else ""


def _shared_keys(data: dict[str, Any], model: type[BaseModel]) -> int:
    return len(data.keys() & model.model_fields.keys())


def _frozen(value: Any) -> Any:
    """Return the same data with tuples for lists: strict validation takes no lists for tuples."""
    if isinstance(value, dict):
        return {key: _frozen(inner) for key, inner in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def _table(model: BaseModel, prefix: str = "") -> str:
    """Return plain keys, then aligned parameter lines, then sections, in the order of the model."""
    values = {
        name: getattr(model, name)
        for name, field in type(model).model_fields.items()
        if prefix + name not in _UNSAID or getattr(model, name) != field.default
    }
    if values.get("amplitude_mm") is not None:
        del values["amplitude_deg"]  # of the lever, which does not move where the tendons drive
    plain = [_plain(k, v, prefix + k) for k, v in values.items() if v is not None and not isinstance(v, BaseModel)]
    rows = [_parameter_cells(k, v, prefix + k) for k, v in values.items() if isinstance(v, Parameter)]
    lines = plain + _aligned(rows)
    for name, value in values.items():
        if isinstance(value, BaseModel) and not isinstance(value, Parameter):
            lines += ["", f"[{prefix}{name}]", _table(value, f"{prefix}{name}.").rstrip("\n")]
    return "\n".join(lines) + "\n"


def _plain(key: str, value: object, dotted: str) -> str:
    remark = _FILE_REMARKS.get(dotted)
    return f"{key} = {_literal(value)}" + (f"  # {remark}" if remark else "")


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _parameter_cells(key: str, parameter: Parameter, dotted: str) -> list[str]:
    unit, numbers = _best_unit(parameter, _FILE_UNITS.get(dotted, _FILE_UNITS.get(parameter.unit, parameter.unit)))
    value, low, high, *ends = numbers
    interval = f", interval90 = [{', '.join(ends)}]" if ends else ""
    note = f"note = {_literal(parameter.note)}" if parameter.note else ""
    return [
        key,
        f" = {{ value = {value}, ",
        f"unit = {_literal(unit)}, ",
        f"origin = {_literal(parameter.origin)}, ",
        f"bounds = [{low}, {high}]{interval}{', ' if parameter.note else ''}",
        f"{note} }}",
    ]


def _best_unit(parameter: Parameter, wanted: str) -> tuple[str, tuple[str, ...]]:
    """Return (unit, numbers) as text: of the units that read back exactly, the one with fewer characters.

    A product of two floats cannot always be undone, so a number may have no exact text in the wanted unit; then the
    unit of the model stands in the file.
    """
    exact = tuple(_literal(number) for number in parameter.numbers())
    if wanted != parameter.unit:
        texts = [_text_in(number, parameter.unit, wanted) for number in parameter.numbers()]
        known = tuple(text for text in texts if text is not None)
        if len(known) == len(exact) and len("".join(known)) <= len("".join(exact)) + 3:
            return wanted, known
    return parameter.unit, exact


def _text_in(number: float, unit: str, wanted: str) -> str | None:
    guess = converted(number, unit, wanted)
    if not math.isfinite(guess):
        return None
    rounded = (float(f"{guess:.{digits}g}") for digits in (15, 16, 17))
    neighbours = (math.nextafter(guess, math.inf), math.nextafter(guess, -math.inf))
    for candidate in (*rounded, *neighbours):
        if converted(candidate, wanted, unit) == number:
            return _literal(candidate)
    return None


def _literal(value: object) -> str:
    """Return a TOML literal; whole floats lose their point, lists are broken at 100 characters."""
    if isinstance(value, tuple):
        return _list([_literal(inner) for inner in value])
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        value = int(value)
    return tomlkit.item(value).as_string()


def _list(items: Sequence[str]) -> str:
    flat = f"[{', '.join(items)}]"
    if len(flat) <= 90:
        return flat
    lines, line = [], "   "
    for item in items:
        if len(line) + len(item) > 98:
            lines.append(line)
            line = "   "
        line += f" {item},"
    return "\n".join(["[", *lines, line, "]"])
