"""This is where a plan becomes the fields of a form and comes back, validated by the models themselves."""

import math
import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from sinew.measure.units import one_number, split_list
from sinew.plan.plan import Plan
from sinew.plan.toml import dump_plan, fault_sentence

_UNITS = {"mm": "mm", "hz": "Hz", "deg": "°", "s": "s"}
_TITLES = {
    "sample_hz": "Sample rate",
    "pretension_mm": "Pretensions",
    "rest_s": "Rest",
    "settle": "Settling",
    "settle_s": "Settling time",
    "settle_tolerance": "Settling tolerance",
    "settle_most_s": "Longest settling time",
    "drive_s": "Driven for",
    "record_s": "Recorded for",
    "start_hz": "First frequency",
    "low_hz": "Lowest frequency",
    "high_hz": "Highest frequency",
    "pretension_to_mm": "Pretension moves to",
    "wanted_hz": "Wanted resonance, first and last",
    "ring_down": "Ring-downs",
    "track": "Tracking",
}
"""Titles that say more than the name does."""

_MOST_VALUES = 10_000


def fields_of(model: type[BaseModel] = Plan) -> list[dict[str, Any]]:
    """Return what a form for a plan shows, field by field in the order of the model.

    Each has `path` ("sweep.amplitude_deg"), `part` ("sweep", "" for the plan itself), `title` with the unit, `unit`,
    `type` (number, whole, text, choice, numbers), `required`, `default` as the form shows it (None where there is
    none), `choices`, `gt`, `ge`, `lt`, `le`, `optional` (may be left empty) and `help`. A part that may be left out is
    a field of the type `part` before its own, whose `default` says whether a new plan has it.
    """
    return list(_fields(model, ""))


def form_of(plan: Plan) -> dict[str, Any]:
    """Return the values of a form that shows a plan, by path; lists as text, parts as true or false."""
    return dict(_values(plan, ""))


def plan_from_form(values: Mapping[str, Any]) -> tuple[str | None, dict[str, str]]:
    """Return (the text of the plan that a form says, None where there are errors; sentences by path).

    values: by path as in `fields_of`; what is empty or missing takes its default. A part counts where its own path is
    true, or is missing while one of its fields is given. Lists: "0, 4, 8", and ranges "1:5:0.25" (from:to:step).
    The path "" holds what is said of the plan as a whole.
    """
    errors: dict[str, str] = {}
    data: dict[str, Any] = {}
    known = {row["path"]: row for row in fields_of()}
    for path in values.keys() - known.keys():
        errors[path] = f"the plan has no key {path}"
    for path, row in known.items():
        if row["type"] == "part":
            if _has_part(path, values, known):
                data.setdefault(path, {})
            continue
        part, _, name = path.rpartition(".")
        if part in known and known[part]["type"] == "part" and part not in data:
            continue
        inside = data.setdefault(part, {}) if part else data
        try:
            value = _read(values.get(path), row["type"])
        except ValueError as error:
            errors[path] = str(error)
            continue
        if value is not None:
            inside[name] = value
    try:
        plan = Plan.model_validate(data)
    except ValidationError as error:
        for fault in error.errors(include_url=False):
            where = ".".join(str(step) for step in fault["loc"] if not isinstance(step, int))
            sentence = fault_sentence(fault, Plan, "plan").removeprefix("plan: ").removeprefix(f"plan key {where}: ")
            errors.setdefault(_named_in(sentence, where, known), sentence)
        return None, errors
    return (None if errors else dump_plan(plan)), errors


def _named_in(sentence: str, path: str, known: Mapping[str, Any]) -> str:
    """Return the path of the field that a sentence on a whole part begins with, else that of the part."""
    inside = f"{path}.{sentence.split()[0]}"
    return inside if inside in known else path


def _fields(model: type[BaseModel], prefix: str) -> Iterator[dict[str, Any]]:
    helps = _helps(model)
    for name, info in model.model_fields.items():
        path = prefix + name
        inner, optional = _inner(info.annotation)
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            if optional:
                yield _row(path, "part", info, helps, _first_line(inner), default=name != "track")
            yield from _fields(inner, f"{path}.")
            continue
        kind, choices = _kind(inner)
        row = _row(path, kind, info, helps, "", default=_shown(_default(info)))
        yield row | {"choices": choices, "optional": optional, **_bounds(info, inner)}


def _row(path: str, kind: str, info: FieldInfo, helps: Mapping[str, str], more: str, default: Any) -> dict[str, Any]:
    name = path.rpartition(".")[2]
    words = name.split("_")
    unit = _UNITS.get(words[-1], "")
    plain = " ".join(words[:-1] if unit else words)
    title = _TITLES.get(name, plain[:1].upper() + plain[1:])
    return {
        "path": path,
        "part": path.rpartition(".")[0],
        "title": f"{title} / {unit}" if unit else title,
        "unit": unit,
        "type": kind,
        "required": info.is_required(),
        "default": default,
        "optional": False,
        "choices": [],
        "gt": None,
        "ge": None,
        "lt": None,
        "le": None,
        "help": helps.get(name, more),
    }


def _inner(annotation: Any) -> tuple[Any, bool]:
    """Return (annotation without None, whether None is allowed)."""
    if get_origin(annotation) in (Union, type(int | None)):
        parts = [part for part in get_args(annotation) if part is not type(None)]
        return parts[0], len(parts) < len(get_args(annotation))
    return annotation, False


def _kind(annotation: Any) -> tuple[str, list[str]]:
    if get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    if get_origin(annotation) is Literal:
        return "choice", list(get_args(annotation))
    if get_origin(annotation) is tuple:
        return "numbers", []
    return {int: "whole", float: "number"}.get(annotation, "text"), []


def _bounds(info: FieldInfo, annotation: Any) -> dict[str, float | None]:
    """Return the bounds of a number, or of each number of a list."""
    found: dict[str, float | None] = {}
    about = [*info.metadata, *getattr(annotation, "__metadata__", ())]
    if get_origin(annotation) is tuple:
        about = list(getattr(get_args(annotation)[0], "__metadata__", ()))
    for one in about:
        for bound in getattr(one, "metadata", [one]):  # of a FieldInfo inside Annotated
            for kind, name in ((Gt, "gt"), (Ge, "ge"), (Lt, "lt"), (Le, "le")):
                if isinstance(bound, kind):
                    found[name] = getattr(bound, name)
    return found


def _default(info: FieldInfo) -> Any:
    return None if info.default is PydanticUndefined else info.default


def _values(model: BaseModel, prefix: str) -> Iterator[tuple[str, Any]]:
    for name, info in type(model).model_fields.items():
        value, path = getattr(model, name), prefix + name
        inner, optional = _inner(info.annotation)
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            if optional:
                yield path, value is not None
            if value is not None:
                yield from _values(value, f"{path}.")
        else:
            yield path, _shown(value)


def _shown(value: Any) -> Any:
    return ", ".join(f"{one:.15g}" for one in value) if isinstance(value, tuple) else value


def _helps(model: type[BaseModel]) -> dict[str, str]:
    """Return what the docstring of a model says of its fields: `name: ...` up to the next one, also `a, b: ...`."""
    text = " ".join((model.__doc__ or "").split())
    names = "|".join(sorted(model.model_fields, key=len, reverse=True))
    found: dict[str, str] = {}
    marks = list(re.finditer(rf"(?:^|(?<=[.;] ))((?:{names})(?:, (?:{names}))*): ", text))
    for mark, after in zip(marks, [*marks[1:], None], strict=True):
        told = text[mark.end() : after.start() if after else len(text)].strip(" ;")
        found |= dict.fromkeys(mark.group(1).split(", "), told)
    return found


def _first_line(model: type[BaseModel]) -> str:
    """Return the first line of a model's docstring."""
    return (model.__doc__ or "").strip().splitlines()[0]


def _has_part(path: str, values: Mapping[str, Any], known: Mapping[str, Any]) -> bool:
    asked = values.get(path)
    if asked is not None:
        return bool(asked)
    return any(name.startswith(f"{path}.") and not _is_empty(values[name]) for name in values if name in known)


def _is_empty(value: Any) -> bool:
    return value is None or (isinstance(value, str) and not value.strip())


def _read(value: Any, kind: str) -> Any:
    """Return what stands in a field; None where nothing does. Raises ValueError with a sentence."""
    if _is_empty(value):
        return None
    if kind == "numbers":
        if isinstance(value, (list, tuple)):
            return tuple(_number(one) for one in value)
        return tuple(_numbers(str(value)))
    if kind == "number":
        return _number(value)
    if kind == "whole":
        number = _number(value)
        if not number.is_integer():
            raise ValueError(f"found {number:g}, expected a whole number")
        return int(number)
    return str(value).strip()


def _number(value: Any) -> float:
    return one_number(str(value))


def _numbers(text: str) -> Iterator[float]:
    count = 0
    for part in split_list(text):
        for number in _range(part) if ":" in part else [_number(part)]:
            count += 1
            if count > _MOST_VALUES:
                raise ValueError(f"found more than {_MOST_VALUES} numbers; take a larger step")
            yield number


def _range(part: str) -> Iterator[float]:
    """Yield the numbers of from:to:step, both ends included where the step meets them."""
    ends = part.split(":")
    if len(ends) != 3:
        raise ValueError(f"found {part!r}, expected from:to:step, as 1:5:0.25")
    first, last, step = map(_number, ends)
    if step <= 0 or last < first:
        raise ValueError(f"found {part!r}, expected from:to:step with from below to and a positive step")
    count = math.floor((last - first) / step + 1e-9) + 1
    for index in range(min(count, _MOST_VALUES + 1)):
        yield float(f"{first + index * step:.12g}")
