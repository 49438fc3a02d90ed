"""What an import loads: heavy packages only where they are used."""

import math
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parents[2] / "src"
MEASURE = sorted(
    ".".join(path.relative_to(SOURCE).with_suffix("").parts) for path in SOURCE.glob("sinew/measure/**/[a-z]*.py")
)


def modules_loaded_by(code: str) -> set[str]:
    """Return the top-level packages that a fresh interpreter has loaded after running `code`."""
    report = "import sys; print(*{name.split('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", f"{code}\n{report}"], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize("package", ["jax", "matplotlib", "numpy", "pandas", "pint", "scipy", "serial", "xarray"])
def test_importing_sinew_loads_no(package: str) -> None:
    assert package not in modules_loaded_by("import sinew")


def test_importing_all_of_measure_loads_neither_jax_nor_matplotlib_nor_serial() -> None:
    loaded = modules_loaded_by(f"import {', '.join(MEASURE)}")
    assert loaded & {"jax", "matplotlib", "serial"} == set()


def test_importing_all_of_measure_does_load_what_the_check_looks_for_in_kind() -> None:
    assert "xarray" in modules_loaded_by(f"import {', '.join(MEASURE)}")


def test_reading_and_analysing_a_table_loads_neither_jax_nor_matplotlib_nor_serial(tmp_path: Path) -> None:
    file = tmp_path / "swing.csv"
    swing = (f"{i / 100},{math.exp(-i / 100) * math.cos(i / 5)}\n" for i in range(400))
    file.write_text("t_s,angle_deg\n" + "".join(swing), encoding="utf-8")
    loaded = modules_loaded_by(
        f"import sinew as sn; sn.analyse(sn.read({str(file)!r}, time='t_s', response='angle_deg'))"
    )
    assert loaded & {"jax", "matplotlib", "serial"} == set()


def test_a_command_loads_no_module_of_another() -> None:
    loaded = "print(*(name for name in sys.modules if name.startswith('sinew.apps.')))"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; from sinew.apps.cli import main; main(['analyse', '--help']); {loaded}"],
        capture_output=True,
        text=True,
        check=True,
    )
    own = {"sinew.apps.cli", "sinew.apps.console", "sinew.apps.recordings", "sinew.apps.recordings.analyse"}
    assert set(done.stdout.splitlines()[-1].split()) == own


@pytest.mark.parametrize("module", ["sinew.apps.dashboard.steward", "sinew.apps.dashboard.page_server"])
def test_a_dashboard_begins_without_what_only_its_workers_need(module: str) -> None:
    loaded = modules_loaded_by(f"import {module}; from sinew.plan.toml import load_rig; load_rig('paper')")
    assert loaded & {"jax", "matplotlib"} == set()
