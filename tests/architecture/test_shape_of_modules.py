"""This is where modules are kept small, named and honest about what they export."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "src" / "sinew"
MODULES = sorted(SOURCE.rglob("*.py"))
LONGEST_MODULE, LONGEST_FUNCTION = 400, 70

each_module = pytest.mark.parametrize("module", MODULES, ids=lambda path: path.relative_to(SOURCE).as_posix())
Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def parse(module: Path) -> ast.Module:
    return ast.parse(module.read_text(encoding="utf-8"))


def exported(tree: ast.Module) -> list[str] | None:
    for node in tree.body:
        if isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets):
            return [str(name) for name in ast.literal_eval(node.value)]
    return None


def bound_names(tree: ast.Module) -> set[str]:
    names: set[str] = set()
    for node in tree.body:
        if isinstance(node, Definition):
            names.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names.update(n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name))
    return names


@each_module
def test_a_module_has_at_most_400_lines(module: Path) -> None:
    assert len(module.read_text(encoding="utf-8").splitlines()) <= LONGEST_MODULE


@each_module
def test_a_function_has_at_most_70_lines(module: Path) -> None:
    functions = [node for node in ast.walk(parse(module)) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    long = {node.name: node.end_lineno - node.lineno + 1 for node in functions if node.end_lineno is not None}
    assert {name: lines for name, lines in long.items() if lines > LONGEST_FUNCTION} == {}


@each_module
def test_a_module_says_what_it_is_the_place_of(module: Path) -> None:
    beginning = "Sinew: " if module == SOURCE / "__init__.py" else "This is where "
    assert (ast.get_docstring(parse(module)) or "").startswith(beginning)


@each_module
def test_every_public_function_and_class_is_exported(module: Path) -> None:
    tree = parse(module)
    public = {node.name for node in tree.body if isinstance(node, Definition) and not node.name.startswith("_")}
    assert public - set(exported(tree) or []) == set()


@each_module
def test_every_exported_name_is_defined_in_the_module(module: Path) -> None:
    # That the list is sorted is ruff's rule RUF022.
    tree = parse(module)
    assert set(exported(tree) or []) - bound_names(tree) == set()
