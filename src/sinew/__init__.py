"""Sinew: a resonance laboratory for tendon-driven continuum joints, in software.

`import sinew as sn` is what a person in a notebook needs. Its names are those that `__init__.pyi` beside this file
imports, where editors and type checkers read them too; each is loaded when it is first used, so that the import itself
is light. Three rooms bear the name of a function (`identify`, `predict`, `tune`): `sn.predict` is the function, and
what is in the room is imported by its path, `from sinew.predict.band import Band`.
"""

import sys
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any


def _read_version() -> str:
    try:
        return Path(__file__).with_name("_version.txt").read_text(encoding="utf-8").strip()
    except FileNotFoundError:  # in a clone that was never built or installed
        return "0+unbuilt"


__version__ = _read_version()


@cache
def _places() -> dict[str, str]:
    """Return the module that each name of the face comes from: of lines "from MODULE import NAME as NAME"."""
    lines = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8").splitlines()
    return {words[3]: words[1] for line in lines if len(words := line.split()) == 6 and words[0] == "from"}


class _Face(ModuleType):
    """The package, whose names load when they are used."""

    def __getattr__(self, name: str) -> Any:
        if name not in _places():
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}; dir({self.__name__}) lists them")
        value = getattr(__import__(_places()[name], fromlist=[name]), name)
        super().__setattr__(name, value)
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        # Whoever loads the room `sinew.predict` has the import system bind it here, over the function of its name.
        hides = isinstance(value, ModuleType) and value.__name__ == f"{self.__name__}.{name}"
        if not (hides and name in _places()):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*_places(), *(name for name in super().__dir__() if name.startswith("__"))})


sys.modules[__name__].__class__ = _Face
