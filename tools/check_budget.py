"""The size of the repository, held to `[tool.sinew.budget]` of pyproject.toml: each number there may only fall.

`python tools/check_budget.py` prints every count beside its budget and exits 1 where one is above. `--lower` writes the
lower number where a count has fallen; nothing here raises one. What is counted:

- Lines of all `*.py` under `tests`, `campaigns`, `benchmarks`, `src`, and by room, a folder of `src/sinew`.
- Commands of `sinew`, public names of `import sinew as sn`, and modules of `src` that import themselves over others, by
  an import inside a function too.
- Numeric constants: assignments of a module whose value is made of numbers alone: signs, arithmetic, tuples, `math.pi`.
- `dict[str, Any]`, and functions with more than eight parameters; `self` and `cls` are none.
- Words that explain nothing in a name. Names that are defined or used in `src` are split at underscores and capitals;
  each whole part counts, wherever the name stands. Prose does not count. `found` counts in names of classes alone.
"""

import argparse
import ast
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import grimp

import sinew
from sinew.apps.cli import COMMANDS

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tools.tree import ROOT, repository_files

Counts = dict[str, dict[str, int]]
_SENTENCES = {
    "lines": "{key} has {number} lines and a budget of {most}: remove {over}, or show which room shrinks by as many",
    "counts": "src has {number} {key} and a budget of {most}: remove {over}",
    "words": "{number} names of src contain {key!r}, and the budget is {most}: give {over} a word of the field",
}
_PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def is_numeric(value: ast.expr | None) -> bool:
    """Return whether an expression is made of numbers alone."""
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float | complex) and not isinstance(value.value, bool)
    if isinstance(value, ast.UnaryOp | ast.BinOp | ast.Tuple):
        parts = [part for part in ast.iter_child_nodes(value) if isinstance(part, ast.expr)]
        return bool(parts) and all(map(is_numeric, parts))
    return value is not None and ast.unparse(value) in ("math.pi", "math.tau", "math.inf", "math.nan")


def has_nine_parameters(node: ast.AST) -> bool:
    """Return whether a node is a function with more than eight parameters, self and cls left out."""
    if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return False
    given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return sum(one.arg not in ("self", "cls") for one in given) > 8


def words_in(nodes: Iterable[ast.AST]) -> Counter[str]:
    """Return how often each word is a part of a name, "found" in names of classes alone."""
    words = Counter[str]()
    for node in nodes:
        for field in ("id", "attr", "arg", "name", "asname", "module"):
            if isinstance(name := getattr(node, field, None), str):
                is_class = name[:1].isupper() and not name.isupper()
                words.update(part for part in map(str.lower, _PARTS.findall(name)) if part != "found" or is_class)
    return words


def budget_of(path: Path) -> Counts:
    """Return the budget that a pyproject.toml states: tables of numbers."""
    return Counts(tomllib.loads(path.read_text(encoding="utf-8"))["tool"]["sinew"]["budget"])


def count(words: Iterable[str]) -> Counts:
    """Return what this tree has, by the tables and keys of the budget."""
    lines, counts, found = Counter[str](), Counter[str](), Counter[str]()
    for path in repository_files("src/*.py", "tests/*.py", "campaigns/*.py", "benchmarks/*.py"):
        text = path.read_text(encoding="utf-8")
        top, *inside = path.relative_to(ROOT).parts
        lines[top] += text.count("\n")
        if top != "src":
            continue
        counts["modules"] += 1
        if len(inside) > 2:
            lines[f"src/{inside[1]}"] += text.count("\n")
        tree = ast.parse(text)
        nodes = list(ast.walk(tree))
        found += words_in(nodes)
        assigned = [node.value for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign)]
        counts["numeric constants"] += sum(map(is_numeric, assigned))
        subscripts = [ast.unparse(node) for node in nodes if isinstance(node, ast.Subscript)]
        counts["dict[str, Any]"] += subscripts.count("dict[str, Any]")
        counts["functions of many parameters"] += sum(map(has_nine_parameters, nodes))
    graph = grimp.build_graph("sinew", cache_dir=None)
    for module in graph.modules:
        direct = graph.find_modules_directly_imported_by(module)
        counts["modules in circles"] += any(module in graph.find_upstream_modules(other) for other in direct)
    counts["commands"] = len(COMMANDS)
    counts["public names"] = sum(not name.startswith("__") for name in dir(sinew))
    return {"lines": dict(lines), "counts": dict(counts), "words": {word: found[word] for word in words}}


def above(budget: Counts, counts: Counts) -> list[str]:
    """Return a sentence for each count that is above its budget; what has no budget may not be."""
    return [
        _SENTENCES[table].format(key=key, number=number, most=most, over=number - most)
        for table, numbers in counts.items()
        for key, number in sorted(numbers.items())
        if number > (most := budget[table].get(key, 0))
    ]


def lowered(text: str, counts: Counts) -> str:
    """Return pyproject.toml with each number of the budget that is above its count lowered to it."""

    def lower(table: re.Match[str]) -> str:
        numbers = counts[table[1]]
        return re.sub(
            r'(?m)^("?)(.+?)\1 = (\d+)',
            lambda entry: f"{entry[1]}{entry[2]}{entry[1]} = {min(int(entry[3]), numbers.get(entry[2], 0))}",
            table[0],
        )

    return re.sub(r"(?ms)^\[tool\.sinew\.budget\.(\w+)\]$.*?(?=^\[|\Z)", lower, text)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print every count beside its budget, and what is above it; return the exit status."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("--lower", action="store_true", help="write the lower number where a count has fallen")
    lower = parser.parse_args(arguments).lower
    path = ROOT / "pyproject.toml"
    counts = count(budget_of(path)["words"])
    if lower:
        path.write_text(lowered(path.read_text(encoding="utf-8"), counts), encoding="utf-8")
    budget = budget_of(path)
    for table, numbers in budget.items():
        print(f"{table:34} count  budget")
        for key, most in numbers.items():
            print(f"  {key:30} {counts[table].get(key, 0):7} {most:7}")
    print("\n".join(refused := above(budget, counts)) or "every count is within its budget")
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())
