"""Rigs and plans as TOML files, number for number there and back."""

import difflib
import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar, get_args, get_origin

import tomli_w
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from sinew.measure.doors import write_text
from sinew.measure.errors import SpecError
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


def read_ranges(rig: str) -> dict[str, dict[str, Any]] | None:
    """Return how far each calibrated parameter of a shipped rig can move, by dotted name; None where it is not known.

    A row is `{"value", "unit", "bounds": [low, high], "alone": [low, high], "together": [low, high]}`, as the
    calibration writes it beside the rig.
    """
    path = files("sinew").joinpath("rigs", f"{rig}-ranges.json")
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else None


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise SpecError(f"{path} is not text (byte {error.start}); expected TOML in UTF-8") from error
    except OSError as error:
        raise SpecError(f"cannot read {path}: {error.strerror or error}") from error


# A failed validation becomes one sentence: key path, what was found, what was expected.

_PARAMETER = "{ value, unit, origin, bounds }"
_PLAIN = {"int": "a whole number", "float": "a number", "str": "a text", "tuple": "a list of numbers"}
_PREFIX = re.compile(r"^(Input|String|Tuple|List|Value) should (be |have )?")


_MOST_TOLD, _MOST_FAULTS = 4, 100


def complaint(error: ValidationError, model: type[BaseModel], what: str) -> str:
    """Return one line on the faults of a rig or plan. what: "rig" or "plan"."""
    return _in_a_line(error.errors(include_url=False), model, what)


def _in_a_line(faults: Sequence[ErrorDetails], model: type[BaseModel], what: str) -> str:
    ordered = _ordered(faults, model)
    more = len(ordered) - _MOST_TOLD
    told = [_sentence(one, model, what) for one in (ordered if more == 1 else ordered[:_MOST_TOLD])]
    return "; ".join([*told, *([f"{more} more faults"] if more > 1 else [])])


def _ordered(faults: Sequence[ErrorDetails], model: type[BaseModel]) -> list[ErrorDetails]:
    """Return unknown keys first, for what is meant by a misspelt one is missing, and that is not told again."""
    unknown = [one for one in faults if one["type"] == "extra_forbidden"]
    meant = {(*one["loc"][:-1], _meant(one["loc"], model)) for one in unknown[:_MOST_FAULTS]}
    others = (one for one in faults if one["type"] != "extra_forbidden")
    return [*unknown, *(one for one in others if one["type"] != "missing" or one["loc"] not in meant)]


def _every_fault(data: Any, model: type[BaseModel]) -> tuple[list[ErrorDetails], Any]:
    """Return (what is wrong with data, the data without the entries of lists that are wrong).

    pydantic looks at a list or a section as a whole only where each part of it is right. So entries that are wrong are
    left out, and the rest is looked at again; what is short for want of them is no fault.
    """
    data, found, places = _frozen(data), list[ErrorDetails](), set[tuple[Any, str]]()
    while True:
        try:
            model.model_validate(data, strict=True)
            return found, data
        except ValidationError as error:
            faults = error.errors(include_url=False)
        new = [one for one in faults if not found or one["type"] == "value_error"]
        new = [one for one in new if (one["loc"], one["type"]) not in places]
        places |= {(one["loc"], one["type"]) for one in new}
        found += new
        entries = {one["loc"] for one in new if one["loc"] and isinstance(one["loc"][-1], int)}
        if not entries:
            return found, data
        data = _without(data, entries)


def _without(data: Any, entries: Set[tuple[int | str, ...]], place: tuple[int | str, ...] = ()) -> Any:
    """Return data without some entries of its lists."""
    if isinstance(data, dict):
        return {key: _without(one, entries, (*place, key)) for key, one in data.items()}
    if isinstance(data, tuple):
        return tuple(one for index, one in enumerate(data) if (*place, index) not in entries)
    return data


def _sentence(fault: ErrorDetails, model: type[BaseModel], what: str) -> str:
    where = _dotted(fault["loc"])
    if fault["type"] == "extra_forbidden":
        said = f"unknown {what} key {where}; {_advice(fault['loc'], model)}"
    elif fault["type"] == "missing":
        said = f"{what} key {where} is missing; expected {_expected(fault, model)}"
    elif fault["type"] == "value_error":
        message = str(fault["msg"]).removeprefix("Value error, ")
        said = f"{what} key {where}: {message}" if where else f"{what}: {message}"
    else:
        said = f"{what} key {where}: found {_shown(fault['input'])}, expected {_expected(fault, model)}"
    return " ".join(said.split())


_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")


def _dotted(location: tuple[int | str, ...]) -> str:
    """Return a place as a file has it: the dotted key, and which entry of its list."""
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f", {_ORDINALS[part]} entry" if part < len(_ORDINALS) else f", entry {part + 1}"
        else:
            text += f".{part}"
    return text.removeprefix(".")


def _inner_model(annotation: Any) -> type[BaseModel] | None:
    for candidate in (annotation, *get_args(annotation)):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return None


def _model_at(location: tuple[int | str, ...], model: type[BaseModel]) -> type[BaseModel] | None:
    found: type[BaseModel] | None = model
    for part in location:
        if found is None or part not in found.model_fields:
            return None
        found = _inner_model(found.model_fields[str(part)].annotation)
    return found


def _meant(location: tuple[int | str, ...], model: type[BaseModel]) -> str | None:
    parent = _model_at(location[:-1], model)
    close = difflib.get_close_matches(str(location[-1]), parent.model_fields if parent else (), n=1)
    return close[0] if close else None


def _advice(location: tuple[int | str, ...], model: type[BaseModel]) -> str:
    if (meant := _meant(location, model)) is not None:
        return f"did you mean {meant}?"
    elsewhere = [dotted for dotted in _keys(model) if dotted.rsplit(".", 1)[-1] == location[-1]]
    if elsewhere:
        return f"did you mean {elsewhere[0]}?"
    parent = _model_at(location[:-1], model)
    return f"expected one of {', '.join(parent.model_fields if parent else ())}"


def _keys(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield prefix + name
        inner = _inner_model(field.annotation)
        if inner is not None and inner is not Parameter:
            yield from _keys(inner, f"{prefix}{name}.")


def _expected(fault: ErrorDetails, model: type[BaseModel]) -> str:
    inner = _model_at(fault["loc"], model)
    if inner is Parameter:
        return _PARAMETER
    if inner is not None:
        return f"a section [{_dotted(fault['loc'])}] with {', '.join(inner.model_fields)}"
    if fault["type"] == "missing":
        keys = [part for part in fault["loc"] if not isinstance(part, int)]
        parent = _model_at(tuple(keys[:-1]), model)
        field = parent.model_fields.get(keys[-1]) if parent else None
        if isinstance(fault["loc"][-1], int) and field is not None:
            return f"{_entries(field.annotation)} entries"
        return _PLAIN.get(getattr(field and field.annotation, "__name__", ""), "a value")
    return _PREFIX.sub("", str(fault["msg"])).replace(" after validation", "")


def _entries(annotation: Any) -> int:
    """Return how many entries the first tuple of a fixed length in an annotation has; 0 where there is none."""
    parts = get_args(annotation)
    if get_origin(annotation) is tuple and Ellipsis not in parts:
        return len(parts)
    return next(filter(None, map(_entries, parts)), 0)


def _shown(value: object) -> str:
    if isinstance(value, Mapping):
        return "a section"
    text = repr(list(value)) if isinstance(value, tuple) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


MOST_CHARACTERS = 256 * 1024
"""A longer text is no rig and no plan: the longest that Sinew writes, with a calibration, has a tenth of it."""

_MOST_PARTS = 16
# The parser's time grows with the square of the parts of a dotted key. This finds one that has too many, wherever it
# stands; it looks at no character more than a few times, so no text makes it slow.
_DEEP = re.compile(
    r"""(?<![\w\-\\])(?:(?:[\w\-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+)"""
    rf"{{{_MOST_PARTS}}}"
)

_Spec = TypeVar("_Spec", RigSpec, Plan)

_RIG_HEADER = """\
# A test bed. Each parameter has a value in its unit, an origin (paper, data sheet, measured, calibrated or assumed),
# the bounds of what is physically thinkable, and a note. Any unit of the right dimension may stand here.
"""
_PLAN_HEADER = """\
# A campaign: pretensions to visit; at each of them a sweep, ring-downs, or both.
"""

_FILE_UNITS = {
    "silicone.length": "mm",
    "silicone.diameter": "mm",
    "section.area": "mm^2",
    "section.torsion_constant": "mm^4",
    "section.least_moment": "mm^4",
    "section.greatest_moment": "mm^4",
    "section.warping_constant": "mm^6",
    "section.perimeter": "mm",
    "section.shear_arm": "mm",
    "space.head_height": "mm",
    "space.lever_height": "mm",
    "tendons.base_radius": "mm",
    "tendons.head_radius": "mm",
    "tendons.free_span": "mm",
    "tendons.guide_friction": "mm",
    "tendons.pulley_radius": "mm",
    "tendons.current_lsb": "mA",
    "drive.no_load_speed": "rpm",
    "drive.current_lsb": "mA",
    "imu.gyro_range": "deg/s",
    "imu.gyro_lsb": "deg/s",
    "imu.gyro_noise": "deg/s",
    "imu.gyro_bias": "deg/s",
    "imu.accelerometer_range": "g_0",
    "imu.accelerometer_lsb": "g_0",
    "imu.accelerometer_noise": "g_0",
    "imu.mount_radius": "mm",
    "imu.residual_delay": "ms",
    "imu.delay_std": "ms",
    "bus.stamp_jitter": "ms",
    "bus.drive_delay": "ms",
    "repeatability.pretension": "mm",
}
"""Units that read better in a file than those that the model keeps."""

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
    "wiring.imu_model": "or TurtleBot3, whose firmware has samples at 50 Hz only",
    "wiring.tendon_pull": "1 where more counts of the encoder pull, -1 where they let go",
    "wiring.drive_sign": "1 where more counts turn the lever positively against the head, else -1",
    "wiring.drive_zero_counts": "encoder reading with the lever in its middle",
    "wiring.imu_axes": "axes of the chip that point along x, y and z of the head",
    "calibration.pretension_mm": "of the recordings",
    "calibration.std": "in SI, in the order of the parameters",
    "calibration.correlation": "lower triangle",
    "wiring.measured": "keys of the wiring that were found on this bench",
    "wiring.latency_ms": "of port, driver and operating system, on top of the time on the wire",
    "wiring.reads": "how a cycle asks all devices: plain or, in one packet of all, fast",
}
"""What a key that is no parameter, and has no note therefore, means; it stands behind it in the file."""

_UNSAID = (
    "wiring.measured",
    "sweep.settle",
    "sweep.settle_tolerance",
    "sweep.settle_most_s",
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
    """Return all that is wrong with a TOML text as a plan, each at its line; empty where `parse_plan` takes it.

    A key that is missing is told at the head of its section. As TOML that cannot be read goes no further, of that there
    is one fault. rig: with it also which of its limits the numbers that can be read break.

    >>> plan_faults('name = "quick"\\n[pretension]\\npretension_mm = 2\\n')[0].line
    3
    """
    try:
        faults, rest = _every_fault(_read_data(text, "the plan", Plan, "plan"), Plan)
    except SpecError as trouble:
        return [Fault(_told_line(str(trouble), text), str(trouble))]
    lines = _Lines(text)
    told = _ordered(faults, Plan)[:_MOST_FAULTS]
    found = [Fault(lines.line_of(one["loc"]), _sentence(one, Plan, "plan")) for one in told]
    if rig is not None:
        with suppress(ValidationError):
            for one in setting_findings(Plan.model_validate(rest, strict=True), rig):
                line = lines.line_of(one.key.split(".")) if one.key else None
                found.append(Fault(line, one.sentence, is_limit=True))
    return sorted(found, key=lambda one: one.line or 0)


def _told_line(sentence: str, text: str) -> int | None:
    """Return the line that a sentence of the TOML parser names; its end of document is the last line with anything."""
    if (named := re.search(r"\bline (\d+)", sentence)) is not None:
        return int(named[1])
    return text.rstrip().count("\n") + 1 if "end of document" in sentence else None


_MOST_SEARCHED = 2_000_000  # characters that are parsed to find lines; a plan takes some thousands


class _Statement(NamedTuple):
    """A head of a section, or a key with its value. first, last: its lines, from 1. section: in which it stands."""

    first: int
    last: int
    section: tuple[str, ...]
    data: dict[str, Any]


class _Lines:
    """Lines of the statements of a TOML text that is valid: where the key at a path stands.

    Each statement is valid TOML by itself, so the parser finds where it ends.
    """

    def __init__(self, text: str) -> None:
        self._lines = text.replace("\r\n", "\n").split("\n")
        self._left = _MOST_SEARCHED
        self._statements = list(self._found())

    def line_of(self, location: Sequence[int | str]) -> int | None:
        """Return the line, from 1, of the key or list entry at a path, else of the nearest that it lies in."""
        best, depth = None, 0
        for one in self._statements:
            reached = _depth(one, location)
            if reached > depth:
                best, depth = one, reached
        if best is None:
            return None
        entry = location[depth] if depth < len(location) else None
        return self._entry_line(best, entry) if isinstance(entry, int) else best.first

    def _entry_line(self, one: _Statement, index: int) -> int:
        """Return the line of an entry of a list that goes over several lines: the first with which it has so many."""
        for last in range(one.first, one.last):
            found = self._parsed("\n".join([*self._lines[one.first - 1 : last], "]"]))
            while isinstance(found, dict) and len(found) == 1:
                (found,) = found.values()
            if isinstance(found, list) and len(found) > index:
                return last
        return one.last if one.last > one.first else one.first

    def _found(self) -> Iterator[_Statement]:
        section: tuple[str, ...] = ()
        first = 1
        while first <= len(self._lines) and self._left > 0:
            last, data = first, None
            while last <= len(self._lines) and self._left > 0:
                data = self._parsed("\n".join(self._lines[first - 1 : last]))
                if data is not None:
                    break
                last += 1
            if data:
                is_head = self._lines[first - 1].lstrip().startswith("[")
                section = _path(data) if is_head else section
                yield _Statement(first, last, section if not is_head else (), data)
            first = last + 1

    def _parsed(self, text: str) -> dict[str, Any] | None:
        self._left -= len(text)
        try:
            return tomllib.loads(text)
        except (ValueError, RecursionError):
            return None


def _path(data: Any) -> tuple[str, ...]:
    """Return the path of the section that a head opens."""
    path: list[str] = []
    while isinstance(data, dict) and data:
        ((key, data),) = data.items()
        path.append(key)
    return tuple(path)


def _depth(one: _Statement, location: Sequence[int | str]) -> int:
    """Return how much of a path a statement reaches; 0 where it stands elsewhere."""
    if tuple(location[: len(one.section)]) != one.section:
        return 0
    depth, data = len(one.section), one.data
    while depth < len(location) and isinstance(data, dict) and location[depth] in data:
        data, depth = data[str(location[depth])], depth + 1
    return depth if depth > len(one.section) else 0


def dump_rig(rig: RigSpec) -> str:
    """Return a rig as TOML, one line a parameter, such that `parse_rig` gives the same rig to the last bit.

    >>> import sinew as sn
    >>> "[silicone]" in sn.dump_rig(sn.load_rig("paper"))
    True
    """
    return _RIG_HEADER + _table(rig)


def dump_plan(plan: Plan) -> str:
    """Return a plan as TOML, such that `parse_plan` gives the same plan to the last bit.

    >>> import sinew as sn
    >>> "[sweep]" in sn.dump_plan(sn.load_plan("short"))
    True
    """
    return _PLAN_HEADER + _table(plan)


def save_rig(rig: RigSpec, path: Path, head: Sequence[str] = ()) -> None:
    """Write a rig file, atomically; head: lines of comment before it. Raises FileError where it cannot be written."""
    write_text(path, "".join(f"# {' '.join(line.split())}\n" for line in head) + dump_rig(rig))


def save_plan(plan: Plan, path: Path) -> None:
    """Write a plan file, atomically. Raises FileError where it cannot be written."""
    write_text(path, dump_plan(plan))


def _parse(text: str, source: str, model: type[_Spec], what: str) -> _Spec:
    data = _read_data(text, source, model, what)
    try:
        return model.model_validate(_frozen(data), strict=True)
    except ValidationError as error:
        raise SpecError(f"{source}: {_in_a_line(_every_fault(data, model)[0], model, what)}") from error


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


_AT = re.compile(r"at line (\d+), column (\d+)")


def _found_at(text: str, error: str) -> str:
    """Return the word at which the parser gave up, or what to write for a decimal comma; empty without a place."""
    if (at := _AT.search(error)) is None:
        return ""
    line = [*text.splitlines(), ""][min(int(at[1]) - 1, len(text.splitlines()))]
    column = int(at[2]) - 1
    decimal = re.search(r"-?\d+$", line[:column]), re.match(r",\d+(?=\s*(#|$))", line[column:])
    if decimal[0] and decimal[1]:  # no list: there a comma is taken
        whole, part = decimal[0][0], decimal[1][0]
        return f"; found {whole}{part}, decimals take a point: {whole}.{part[1:]}"
    word = re.split(r"[\s,\]}#]", line[column:], maxsplit=1)[0][:40]
    return f"; found {word!r} there" if word else ""


def _shared_keys(data: dict[str, Any], model: type[BaseModel]) -> int:
    return len(data.keys() & model.model_fields.keys())


def _frozen(value: Any) -> Any:
    """Return the same data with tuples for lists: strict validation takes no lists for tuples."""
    if isinstance(value, dict):
        return {key: _frozen(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return tuple(_frozen(inner) for inner in value)
    return value


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
    unit, numbers = _best_unit(parameter, _FILE_UNITS.get(dotted, parameter.unit))
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
    return tomli_w.dumps({"k": value}).removeprefix("k = ").rstrip("\n")


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
