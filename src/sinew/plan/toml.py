"""Rigs and plans as TOML files: read, refused with the place of each fault, and written over a user's comments."""

import difflib
import json
import math
import re
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import suppress
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

Library = Literal["rigs", "plans"]
_Location = tuple[int | str, ...]
_Spec = TypeVar("_Spec", RigSpec, Plan)

MOST_CHARACTERS = 64 * 1024
"""A longer text is no rig and no plan: the longest that Sinew writes, with a calibration, has less than half of it."""

_MOST_LISTED, _MOST_FAULTS = 4, 100  # of a sentence, which a person reads at once; of a list
_MOST_PARTS = 16
# The parser's time grows with the square of the parts of a dotted key. This finds one that has too many, wherever it
# stands; it looks at no character more than a few times, so no text makes it slow.
_DEEP = re.compile(
    r"""(?<![\w\-\\])(?:(?:[\w\-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+)"""
    rf"{{{_MOST_PARTS}}}"
)


def list_shipped(library: Library) -> list[str]:
    """Return the names of the rigs or plans that ship with Sinew, in alphabetical order."""
    names = (entry.name for entry in files("sinew").joinpath(library).iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def read_spec(library: Library, path_or_name: str | Path) -> str:
    """Return the text of a rig or plan: of the file at a path, else of the shipped one of that name.

    path_or_name: `paper`, `paper.toml`, `rigs/paper.toml`, or the path of a file. A file that exists comes first; a
        folder is passed over, such as `sinew reproduce --out paper` leaves.
    Raises SpecError where there is neither, or where the file is not UTF-8 text.
    """
    path, what, shipped = Path(path_or_name), library.removesuffix("s"), list_shipped(library)
    name = path.name.removesuffix(".toml")
    if not path.is_file() and str(path.parent) in (".", library) and name in shipped:
        return files("sinew").joinpath(library, f"{name}.toml").read_text(encoding="utf-8")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise SpecError(f"{path} is not text (byte {error.start}); expected TOML in UTF-8") from error
    except FileNotFoundError:
        advice = "".join(f"; did you mean {one}?" for one in difflib.get_close_matches(name, shipped, n=1))
        found = f"found no such file, and Sinew ships {', '.join(shipped)}{advice}"
        raise SpecError(f"no {what} {path_or_name}: {found}") from None
    except IsADirectoryError:
        raise SpecError(f"{path} is not a file; expected a {what} as a TOML file") from None
    except OSError as error:
        raise SpecError(f"cannot read {path}: {error.strerror or error}") from error


def read_posterior(rig: str) -> dict[str, dict[str, Any]] | None:
    """Return what the paper's numbers leave of each calibrated parameter of a shipped rig; None where it is not known.

    By dotted name `{"unit", "prior90": [low, high], "median", "posterior90": [low, high], "ratio", ...}`, SI, as
    `sinew calibrate --paper --posterior` writes it beside the rig.
    """
    path = files("sinew").joinpath("rigs", f"{rig}-posterior.json")
    return dict(json.loads(path.read_text(encoding="utf-8"))["parameters"]) if path.is_file() else None


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
    """Return the rig that a TOML text describes. Raises SpecError with one line on its faults.

    source: what to call the text in an error, its path for instance.
    """
    return _parse(text, source, RigSpec, "rig")


def parse_plan(text: str, source: str = "plan") -> Plan:
    """Return the plan that a TOML text describes; arguments and errors as for `parse_rig`."""
    return _parse(text, source, Plan, "plan")


def _parse(text: str, source: str, model: type[_Spec], what: str) -> _Spec:
    data = _read_data(text, source, model, what)
    try:
        return model.model_validate(data, strict=True)
    except ValidationError as error:
        raise SpecError(f"{source}: {complaint(error, model, what)}") from error


def _read_data(text: str, source: str, model: type[BaseModel], what: str) -> dict[str, Any]:
    """Return the data of a text that may be a rig or a plan. Raises SpecError."""
    if len(text) > MOST_CHARACTERS:
        raise SpecError(f"{source} has {len(text)} characters, expected at most {MOST_CHARACTERS} of a {what}")
    if (deep := _DEEP.search(text)) is not None:
        line = text.count("\n", 0, deep.start()) + 1
        raise SpecError(f"{source}, line {line}: found a key of more than {_MOST_PARTS} parts; no {what} has one")
    try:
        data: dict[str, Any] = _frozen(tomllib.loads(text))
    except ValueError as error:  # of the parser, or of a number with thousands of digits
        raise SpecError(f"{source} is not valid TOML: {error}{_found_at(text, str(error))}") from error
    except RecursionError:
        raise SpecError(f"{source} is nested too deeply for a {what}; take brackets away") from None
    other, other_what = (Plan, "plan") if what == "rig" else (RigSpec, "rig")
    if len(data.keys() & other.model_fields.keys()) > len(data.keys() & model.model_fields.keys()):
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


def _frozen(value: Any) -> Any:
    """Return the same data with tuples for lists: strict validation takes no lists for tuples."""
    if isinstance(value, dict):
        return {key: _frozen(inner) for key, inner in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


# A fault that pydantic finds becomes a sentence: its location, what was found, what was expected.


def complaint(error: ValidationError, model: type[BaseModel], what: str) -> str:
    """Return one line on the faults of a rig or plan. what: "rig" or "plan"."""
    lines = [sentence for _, sentence in _faults(error, model, what)]
    most = len(lines) if len(lines) <= _MOST_LISTED + 1 else _MOST_LISTED
    return "; ".join([*lines[:most], *([f"{len(lines) - most} more faults"] if most < len(lines) else [])])


def _faults(error: ValidationError, model: type[BaseModel], what: str) -> list[tuple[_Location, str]]:
    """Return (location, sentence) of each fault, unknown keys first: what is meant by a misspelt one is not missing."""
    keys, meant = dict(_keys(model)), set[str]()
    found: list[tuple[_Location, str]] = []
    for one in sorted(error.errors(include_url=False), key=lambda one: one["type"] != "extra_forbidden"):
        *parents, name = map(str, one["loc"] or ("",))
        section, dotted = ".".join(parents), ".".join([*parents, name])
        if one["type"] == "extra_forbidden":
            own = keys.get(section, ())
            near = difflib.get_close_matches(name, own, n=1) if len(found) < _MOST_FAULTS else []
            meant.update(f"{section}.{key}".removeprefix(".") for key in near)
            near += [f"{other}.{name}" for other, names in keys.items() if name in names]
            advice = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(own)}"
            found.append((one["loc"], f"unknown {what} key {dotted}; {advice}"))
        elif one["type"] != "missing" or dotted not in meant:
            found.append((one["loc"], " ".join(_sentence(one, what, keys.get(dotted, ())).split())))
    return found


def _sentence(fault: ErrorDetails, what: str, keys: Sequence[str]) -> str:
    """Return what is wrong at a key. keys: those that a section has at its place, empty where it is none."""
    location = fault["loc"]
    key = "".join(f", entry {part + 1}" if isinstance(part, int) else f".{part}" for part in location)
    where = f"{what} key {key.removeprefix('.')}" if key else what
    section = f"{{ {', '.join(keys)} }}" if keys else ""
    if fault["type"] == "value_error":
        return f"{where}: {str(fault['msg']).removeprefix('Value error, ')}"
    if fault["type"] == "missing":
        entries = f"at least {location[-1] + 1} entries" if isinstance(location[-1], int) else "a value"
        return f"{where} is missing; expected {section or entries}"
    found = fault["input"]
    shown = "a section" if isinstance(found, dict) else repr(list(found) if isinstance(found, tuple) else found)
    wanted = re.sub(r"^(Input|String|Tuple|List|Value) should (be |have )?| after validation", "", str(fault["msg"]))
    return f"{where}: found {shown if len(shown) <= 60 else f'{shown[:57]}...'}, expected {section or wanted}"


def _keys(model: type[BaseModel], section: str = "") -> Iterator[tuple[str, list[str]]]:
    """Yield (dotted name, keys) of a model and of each section in it."""
    yield section, list(model.model_fields)
    for name, field in model.model_fields.items():
        for kind in (field.annotation, *get_args(field.annotation)):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                yield from _keys(kind, f"{section}.{name}".removeprefix("."))


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
        named = re.search(r"\bline (\d+)", str(trouble))
        ended = text.rstrip().count("\n") + 1 if "end of document" in str(trouble) else None
        return [Fault(int(named[1]) if named else ended, str(trouble))]
    document: Any = {}
    with suppress(TOMLKitError, RecursionError):
        document = tomlkit.parse(text)
    try:
        plan = Plan.model_validate(data, strict=True)
    except ValidationError as error:
        found = [Fault(_line_of(document, at), said) for at, said in _faults(error, Plan, "plan")[:_MOST_FAULTS]]
    else:
        broken = setting_findings(plan, rig) if rig is not None else ()
        found = [Fault(_line_of(document, one.key.split(".")), one.sentence, is_limit=True) for one in broken]
    return sorted(found, key=lambda one: one.line or 0)


_MARK = "\ue000"  # of the private use area: in no text that somebody writes


def _line_of(document: Any, location: Sequence[int | str]) -> int | None:
    """Return the line, from 1, of a key or entry, else of the nearest that it lies in; None where there is none.

    A mark is put where it stands, and found in what tomlkit writes.
    """
    holder, key, at = None, None, document
    with suppress(LookupError, TypeError):
        for part in location:
            holder, key, at = at, part, at[part]
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


# A rig is written over a text, of which all stays that says the same; a plan from nothing.

_RIG_TITLE = "# A test bed. "  # what stands before it, Sinew wrote when it made that file
_PLAN_TITLE = "A campaign: pretensions to visit; at each of them a sweep, ring-downs, or both."
_UNSAID = ("measured", "drive")  # not in a file while they keep their default: older recordings' texts stay as they are
_FILE_UNITS = {"m": "mm", "m^2": "mm^2", "m^4": "mm^4", "m^6": "mm^6"}  # they read better than those of the model


def dump_rig(rig: RigSpec, like: str = "") -> str:
    """Return a rig as TOML, one line a parameter, such that `parse_rig` gives the same rig to the last bit.

    like: the text of a rig from which it was made, else the shipped one of the paper. Its comments, its units and its
    order stay, and the lines of what is the same.

    >>> import sinew as sn
    >>> "[silicone]" in sn.dump_rig(sn.load_rig("paper"))
    True
    """
    like = like or read_spec("rigs", "rigs/paper")
    document = tomlkit.parse(like[max(like.find(_RIG_TITLE), 0) :])
    _write(document, rig, parse_rig(like))
    return document.as_string()


def dump_plan(plan: Plan) -> str:
    """Return a plan as TOML, such that `parse_plan` gives the same plan to the last bit.

    >>> import sinew as sn
    >>> "[sweep]" in sn.dump_plan(sn.load_plan("short"))
    True
    """
    document = tomlkit.document().add(tomlkit.comment(_PLAN_TITLE))
    _write(document, plan, None)
    return document.as_string()


def save_rig(rig: RigSpec, path: Path, head: Sequence[str] = (), like: str = "") -> None:
    """Write a rig file, atomically. Raises FileError where it cannot be written.

    head: lines of comment before it. like: the text of a rig whose comments are kept, see `dump_rig`.
    """
    write_text(path, "".join(f"# {' '.join(line.split())}\n" for line in head) + dump_rig(rig, like))


def save_plan(plan: Plan, path: Path) -> None:
    """Write a plan file, atomically. Raises FileError where it cannot be written."""
    write_text(path, dump_plan(plan))


def _write(table: Any, model: BaseModel, before: BaseModel | None) -> None:
    """Make a table say what a model says, but for what is as before; sections come behind what is none."""
    fields = [(name, getattr(model, name), field.default) for name, field in type(model).model_fields.items()]
    for name, value, default in sorted(fields, key=lambda one: isinstance(one[1], BaseModel) + _is_section(one[1])):
        # The lever's amplitude is none where the tendons drive.
        is_idle = name == "amplitude_deg" and getattr(model, "amplitude_mm", None) is not None
        if value is None or is_idle or (name in _UNSAID and value == default):
            table.pop(name, None)
        elif value != getattr(before, name, None):
            if _is_section(value):
                was = getattr(before, name, None) if name in table else None  # a new section is written whole
                table.setdefault(name, tomlkit.table())
                _write(table[name], value, was)
            elif isinstance(value, Parameter):
                table.setdefault(name, tomlkit.inline_table())
                _write_parameter(table[name], value)
            else:
                table[name] = _item(value)


def _is_section(value: object) -> bool:
    return isinstance(value, BaseModel) and not isinstance(value, Parameter)


def _write_parameter(cell: Any, parameter: Parameter) -> None:
    """Write a parameter in the unit of its cell where that gives back the number exactly, else in the model's."""
    wanted = cell.get("unit", _FILE_UNITS.get(parameter.unit, parameter.unit))
    unit, numbers = wanted, [_exactly(number, parameter.unit, wanted) for number in parameter.numbers()]
    if None in numbers:
        unit, numbers = parameter.unit, list(parameter.numbers())
    value, low, high, *ends = numbers
    said = {"value": value, "unit": unit, "origin": parameter.origin, "bounds": (low, high)}
    said |= {key: one for key, one in (("interval90", tuple(ends)), ("note", parameter.note)) if one}
    if said.keys() != cell.keys():
        cell.clear()  # so that the keys stand in their order
    for key, one in said.items():
        if key not in cell or _frozen(cell[key].unwrap()) != one:
            cell[key] = _item(one)


def _exactly(number: float, unit: str, wanted: str) -> float | None:
    """Return a number in another unit, such that it comes back to the last bit; None where no float does."""
    guess = converted(number, unit, wanted)
    rounded = (float(f"{guess:.{digits}g}") for digits in (15, 16, 17))
    near = (*rounded, math.nextafter(guess, math.inf), math.nextafter(guess, -math.inf))
    return next((one for one in near if math.isfinite(one) and converted(one, wanted, unit) == number), None)


def _item(value: object) -> Any:
    """Return a value as TOML; whole floats lose their point, long lists are broken into lines."""
    if isinstance(value, tuple):
        items, array = [_item(inner) for inner in value], tomlkit.array()
        if sum(len(item.as_string()) + 2 for item in items) <= 90:
            array.extend(items)
            return array
        in_line = max(1, 100 // max(len(item.as_string()) + 2 for item in items))
        for at in range(0, len(items), in_line):
            array.add_line(*items[at : at + in_line])
        array.add_line(indent="")
        return array
    is_whole = isinstance(value, float) and value.is_integer() and abs(value) < 1e15
    return tomlkit.item(int(value) if is_whole else value)  # type: ignore[call-overload]
