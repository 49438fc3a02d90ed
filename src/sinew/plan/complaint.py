"""This is where a failed validation becomes one sentence: key path, what was found, what was expected."""

import difflib
import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from sinew.plan.parameter import Parameter

__all__ = ["complaint", "fault_sentence"]

_PARAMETER = "{ value, unit, origin, bounds }"
_PLAIN = {"int": "a whole number", "float": "a number", "str": "a text", "tuple": "a list of numbers"}
_PREFIX = re.compile(r"^(Input|String|Tuple|List|Value) should (be |have )?")


def complaint(error: ValidationError, model: type[BaseModel], what: str) -> str:
    """Return one sentence on the first fault of a rig or plan, and how many more there are.

    what: "rig" or "plan". Unknown keys come first, because a misspelt key is also missing under its right name.
    """
    faults = error.errors(include_url=False)
    unknown = [fault for fault in faults if fault["type"] == "extra_forbidden"]
    first = (unknown or faults)[0]
    sentence, meant = _sentence(first, model, what)
    more = len(faults) - 1
    if meant is not None and any(f["type"] == "missing" and f["loc"] == (*first["loc"][:-1], meant) for f in faults):
        more -= 1
    if more:
        sentence += f" (and {more} more fault{'s' if more > 1 else ''})"
    return " ".join(sentence.split())


def fault_sentence(fault: ErrorDetails, model: type[BaseModel], what: str) -> str:
    """Return the sentence on one fault of a rig or plan. what: "rig" or "plan"."""
    return " ".join(_sentence(fault, model, what)[0].split())


def _sentence(fault: ErrorDetails, model: type[BaseModel], what: str) -> tuple[str, str | None]:
    where = _dotted(fault["loc"])
    if fault["type"] == "extra_forbidden":
        meant = _meant(fault["loc"], model)
        return f"unknown {what} key {where}; {_advice(fault['loc'], model, meant)}", meant
    if fault["type"] == "missing":
        return f"{what} key {where} is missing; expected {_expected(fault, model)}", None
    if fault["type"] == "value_error":
        message = str(fault["msg"]).removeprefix("Value error, ")
        return (f"{what} key {where}: {message}" if where else f"{what}: {message}"), None
    return f"{what} key {where}: found {_shown(fault['input'])}, expected {_expected(fault, model)}", None


def _dotted(location: tuple[int | str, ...]) -> str:
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}"
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


def _advice(location: tuple[int | str, ...], model: type[BaseModel], meant: str | None) -> str:
    if meant is not None:
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
        parent = _model_at(fault["loc"][:-1], model)
        field = parent.model_fields.get(str(fault["loc"][-1])) if parent else None
        return _PLAIN.get(getattr(field and field.annotation, "__name__", ""), "a value")
    return _PREFIX.sub("", str(fault["msg"])).replace(" after validation", "")


def _shown(value: object) -> str:
    if isinstance(value, Mapping):
        return "a section"
    text = repr(list(value)) if isinstance(value, tuple) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
