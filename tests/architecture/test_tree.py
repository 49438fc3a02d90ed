"""The tree itself: no hosts, no dead links, locks that match what the package asks for."""

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from tools import check_hosts, check_links, write_reference

from sinew.measure.errors import DISTRIBUTION

ROOT = Path(__file__).resolve().parents[2]


def in_a_clone() -> bool:
    git = shutil.which("git")
    return (
        git is not None
        and subprocess.run([git, "rev-parse"], cwd=ROOT, capture_output=True, check=False).returncode == 0
    )


clone_only = pytest.mark.skipif(not in_a_clone(), reason="not a git clone: what is committed cannot be listed")


@clone_only
def test_no_committed_text_names_a_package_index_or_a_path_of_one_machine(capsys: pytest.CaptureFixture[str]) -> None:
    assert check_hosts.main() == 0, capsys.readouterr().out


@clone_only
def test_every_link_inside_the_pages_leads_somewhere(capsys: pytest.CaptureFixture[str]) -> None:
    assert check_links.main() == 0, capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("notes.md", "get it from py" + "pi.org"),
        ("requirements.txt", "--index" + "-url somewhere"),
        ("requirements.txt", "package @ https" + "://example.net/package.whl"),
        (".ci/run", "curl https" + "://example.net"),
        ("notes.md", "see /ro" + "ot/notes"),
    ],
)
def test_a_line_that_must_not_be_committed_is_found(name: str, line: str) -> None:
    assert check_hosts.find_hosts(f"fine\n{line}\n", name) != []


def test_a_link_to_an_absent_page_and_to_an_absent_heading_are_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# Here it is\n[a](absent.md) [b](#nowhere) [c](#here-it-is) [d](https://example.net)\n`[e](no.md)`\n"
    )
    assert len(check_links.broken_links(page)) == 2


def test_every_committed_reference_page_is_what_the_schema_says() -> None:
    pages = write_reference.reference_pages()
    written = {name: (ROOT / name).read_text(encoding="utf-8") for name in pages}
    assert [name for name in pages if written[name] != pages[name]] == [], "run `make reference`"


def locked(name: str) -> dict[str, str]:
    text = (ROOT / name).read_text(encoding="utf-8")
    return dict(re.findall(r"^([a-z0-9.-]+)==(\S+)", text, re.MULTILINE))


def wanted(*extras: str) -> list[Requirement]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = project["dependencies"] + [line for extra in extras for line in project["optional-dependencies"][extra]]
    return [Requirement(line) for line in lines]


def test_the_lock_answers_every_dependency_of_the_package() -> None:
    pins = locked("requirements.txt")
    assert [str(r) for r in wanted() if not r.specifier.contains(pins.get(canonicalize_name(r.name), "0"))] == []


def test_the_development_lock_answers_every_development_dependency() -> None:
    pins = locked("requirements-dev.txt")
    assert [str(r) for r in wanted("dev") if not r.specifier.contains(pins.get(canonicalize_name(r.name), "0"))] == []


def test_the_development_lock_moves_no_version_of_the_runtime_lock() -> None:
    assert locked("requirements.txt").items() <= locked("requirements-dev.txt").items()


@pytest.mark.parametrize("name", ["requirements.txt", "requirements-dev.txt"])
def test_every_locked_package_has_a_hash(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    assert re.findall(r"^(\S+==\S+)(?!\S)(?! \\\n    --hash=sha256:[0-9a-f]{64})", text, re.MULTILINE) == []


def test_the_distribution_has_a_name_of_its_own_and_one_version() -> None:
    built = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert built["project"]["name"] == DISTRIBUTION != "sinew"
    assert built["project"]["scripts"]["sinew"] == "sinew.apps.cli:main"
    assert (built["project"]["dynamic"], "version" in built["project"]) == (["version"], False)
    assert built["tool"]["setuptools_scm"]["version_file"] == "src/sinew/_version.txt"


def test_nobody_is_told_to_fetch_another_projects_sinew() -> None:
    texts = [
        *ROOT.glob("*.md"),
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "src").rglob("*.py"),
        *(ROOT / "src").rglob("*.html"),
    ]
    told = re.compile(r"(?:pip|uv|pipx) (?:install|add) [^\n]*\bsinew(?:\[|\"|'|\b(?![-_/]))|`sinew\[")
    allowed = {ROOT / "docs/how-to/install.md", ROOT / "src/sinew/measure/errors.py"}  # which warn of it
    found = [str(path) for path in texts if path not in allowed and told.search(path.read_text(encoding="utf-8"))]
    assert found == []


@pytest.mark.parametrize("extra", ["posterior", "cluster", "dashboard", "files", "dev"])
def test_the_page_on_installing_names_every_extra_and_the_wheel(extra: str) -> None:
    page = (ROOT / "docs/how-to/install.md").read_text(encoding="utf-8")
    assert f"| `{extra}` |" in page
    assert "sinew_lab-0.1.0-py3-none-any.whl[" in page
    assert (
        extra
        in tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    )
