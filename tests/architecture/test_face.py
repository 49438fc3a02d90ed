"""The face: `import sinew as sn` is enough, light, and says what it has."""

import doctest
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import sinew as sn

ROOT = Path(__file__).resolve().parents[2]
NAMES = sorted(name for name in dir(sn) if not name.startswith("_"))


def run(code: str) -> str:
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def test_every_name_of_the_stub_is_what_its_module_has() -> None:
    lines = (ROOT / "src/sinew/__init__.pyi").read_text(encoding="utf-8").splitlines()
    places = {words[3]: words[1] for line in lines if (words := line.split())[:1] == ["from"]}
    wrong = {}
    for name, module in places.items():
        home = importlib.import_module(module)
        there = getattr(home, name, None) or importlib.import_module(f"{module}.{name}")
        if getattr(sn, name) is not there:
            wrong[name] = module
    assert (wrong, sorted(places)) == ({}, NAMES)


def test_a_name_that_is_not_there_is_an_attribute_error_that_names_it() -> None:
    with pytest.raises(AttributeError, match="'simulte'"):
        sn.simulte  # type: ignore[attr-defined]  # noqa: B018


def test_a_room_that_was_loaded_first_does_not_hide_the_function_of_its_name() -> None:
    code = "import sinew.tune, sinew.predict, sinew.identify.joint, sinew.measure; print(*vars(sinew).keys())"
    assert {"tune", "predict", "identify", "measure"} & set(run(code).split()) == {"measure"}


def test_importing_sinew_takes_the_processor_less_than_0_15_s() -> None:
    code = "import time; t = time.process_time(); import sinew; print(time.process_time() - t)"
    assert min(float(run(code)) for _ in range(3)) < 0.15


@pytest.mark.parametrize("what", ["an empty dataset", "what it gave before"])
def test_what_is_no_recording_is_refused_in_words(what: str) -> None:
    import xarray as xr

    given = xr.Dataset() if what == "an empty dataset" else sn.results.RecordingResult(recording=xr.Dataset())
    with pytest.raises(sn.RecordingError, match="expected a recording"):
        sn.analyse(given)  # type: ignore[arg-type]


def test_a_term_of_ones_own_is_refused_with_those_there_are() -> None:
    from sinew.mechanics.laws import Term

    class Own(Term):
        def force(self, *_: object) -> float:
            return 0.0

    with pytest.raises(sn.SpecError, match="Viscous"):
        sn.Linear() + Own()


FUNCTIONS = [name for name in NAMES if name[0].islower()]
SLOW = {"identify", "predict", "tune", "plot", "simulate"}  # they compile
LONG = {"calibrate"}
IN_A_NOTEBOOK = {"design"}  # whose example takes minutes


def marks_of(name: str) -> list[pytest.MarkDecorator]:
    """Return how long the example of a function takes."""
    return [pytest.mark.slow] * (name in SLOW | LONG) + [pytest.mark.long] * (name in LONG)


@pytest.mark.parametrize("name", [pytest.param(name, marks=marks_of(name)) for name in FUNCTIONS])
def test_the_example_of_a_function_of_the_face_runs(name: str) -> None:
    (found,) = doctest.DocTestFinder(recurse=False).find(getattr(sn, name), name, globs={})
    run = [example for example in found.examples[1:] if not example.options.get(doctest.SKIP)]
    assert run or name in IN_A_NOTEBOOK
    assert doctest.DocTestRunner().run(found).failed == 0
