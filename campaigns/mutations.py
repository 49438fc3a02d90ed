"""Mutations of the physics, the analysis and the bench: which of them do the fast tests notice?

Each mutation is one change of one place, drawn at random with a seed: a sign, a factor of two, an off-by-one, two
neighbours swapped, a guard that is dropped. It is made in a copy of the tree, where `make test`'s selection runs until
a test fails: files first that name the mutated module, then those that name its room, then all. A mutation that no test
notices is printed with its place: read it, it may change nothing that anybody sees, or a test is missing.

    python -m campaigns.mutations --seed 2 --mutations 30
"""

import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from campaigns.options import campaign_parser, conclude

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("mechanics", "solve", "analysis", "identify", "bench", "hardware", "emulator")
KINDS = ("sign", "factor of two", "off by one", "swapped", "dropped guard")
_LONGEST_S = 3600.0  # a run that takes so long waits for something, and has noticed

_PYTEST = [sys.executable, "-B", "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "--no-header", "-rfE"]
_PYTEST += ["-m", "not slow and not hardware"]
_NOT_MUTATED = ("annotation", "returns", "decorator_list")
_SENTENCES = (ast.JoinedStr, ast.Raise)


@dataclass(frozen=True)
class Mutation:
    """One change: of a file under src/sinew, the bytes between two offsets of it become another text."""

    kind: str
    file: str
    line: int
    begin: int
    end: int
    before: str
    after: str

    def made(self, text: str) -> str:
        """Return the file's text with the change."""
        raw = text.encode()
        assert raw[self.begin : self.end].decode() == self.before
        return (raw[: self.begin] + self.after.encode() + raw[self.end :]).decode()


def code_of(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a module that can be changed: no annotation, and no sentence that somebody reads."""
    yield node
    for name, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and name not in _NOT_MUTATED and not isinstance(child, _SENTENCES):
                yield from code_of(child)


def changes(node: ast.AST) -> Iterator[tuple[str, ast.expr, str]]:
    """Yield (kind, what is replaced, by which text) of each change of a node."""
    match node:
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right) if not _is_text(node):
            other = ast.Sub() if isinstance(op, ast.Add) else ast.Add()
            yield "sign", node, f"({ast.unparse(ast.BinOp(left, other, right))})"
        case ast.BinOp(op=ast.Mult() | ast.Div()) if not _is_text(node):
            yield "factor of two", node, f"(2 * ({ast.unparse(node)}))"
        case ast.Constant(value=int(value)) if not isinstance(value, bool) and abs(value) < 100:
            yield "off by one", node, str(value + 1)
        case ast.Call(func=called, args=[ast.Name() | ast.Attribute(), ast.Name() | ast.Attribute(), *_]):
            first, second, *others = node.args
            if ast.unparse(called) != "suppress" and ast.unparse(first) != ast.unparse(second):
                yield "swapped", node, ast.unparse(ast.Call(called, [second, first, *others], node.keywords))
        case ast.If(test=test, body=[ast.Raise() | ast.Return() | ast.Continue()], orelse=[]):
            yield "dropped guard", test, "False"


def _is_text(node: ast.BinOp) -> bool:
    parts = (node.left, node.right)
    return any(
        isinstance(p, ast.JoinedStr) or (isinstance(p, ast.Constant) and isinstance(p.value, str)) for p in parts
    )


def mutations_of(file: str, text: str) -> list[Mutation]:
    """Return all mutations of a module's text."""
    raw, starts, found = text.encode(), [0], []
    for line in raw.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node in code_of(ast.parse(text)):
        for kind, old, after in changes(node):
            assert old.end_lineno is not None
            assert old.end_col_offset is not None
            begin, end = starts[old.lineno - 1] + old.col_offset, starts[old.end_lineno - 1] + old.end_col_offset
            found.append(Mutation(kind, file, old.lineno, begin, end, raw[begin:end].decode(), after))
    return found


def drawn(seed: int, count: int, rooms: Sequence[str] = ROOMS, root: Path = ROOT) -> list[Mutation]:
    """Return mutations drawn with a seed: rooms and kinds in turn, places at random, no place twice."""
    rng, source = random.Random(seed), root / "src/sinew"
    files = [path for room in rooms for path in sorted((source / room).rglob("*.py"))]
    every = [m for f in files for m in mutations_of(f.relative_to(source).as_posix(), f.read_text(encoding="utf-8"))]
    chosen: list[Mutation] = []
    while len(chosen) < count:
        room, kind = rooms[len(chosen) % len(rooms)], KINDS[len(chosen) % len(KINDS)]
        here = [m for m in every if m.file.startswith(f"{room}/") and m.kind == kind and m not in chosen]
        chosen.append(rng.choice(here))
    return chosen


def tests_for(mutation: Mutation, tree: Path) -> list[str]:
    """Return the tests that are run: files that name the mutated module, those that name its room, all."""
    module = "sinew." + mutation.file.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
    texts = {path: path.read_text(encoding="utf-8") for path in sorted((tree / "tests").rglob("test_*.py"))}
    named = [path for name in (module, ".".join(module.split(".")[:2])) for path, text in texts.items() if name in text]
    return [*dict.fromkeys(path.relative_to(tree).as_posix() for path in named), "tests"]


def failing(tree: Path, tests: Sequence[str]) -> str:
    """Return the first of the fast tests that fails, or what else went wrong; empty where none does."""
    path = f"{tree / 'src'}{os.pathsep}{tree}"
    flags = "--xla_cpu_use_fusion_emitters=false"  # as the Makefile has them
    environment = os.environ | {"PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "XLA_FLAGS": flags}
    command = [*_PYTEST, *tests]
    try:
        done = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, timeout=_LONGEST_S, check=False
        )
    except subprocess.TimeoutExpired:
        return f"no end within {_LONGEST_S:.0f} s"
    said = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return said[0].split(" - ")[0] if said else "" if done.returncode == 0 else f"status {done.returncode}"


def judged(mutation: Mutation, tree: Path) -> str:
    """Return what noticed a mutation made in a tree, which is as before afterwards; empty where nothing did."""
    path = tree / "src/sinew" / mutation.file
    text = path.read_text(encoding="utf-8")
    path.write_text(mutation.made(text), encoding="utf-8")
    try:
        return failing(tree, tests_for(mutation, tree))
    finally:
        path.write_text(text, encoding="utf-8")


@contextmanager
def copied() -> Iterator[Path]:
    """Give a copy of the tree with the shared recordings beside it."""
    with tempfile.TemporaryDirectory(prefix="mutated") as folder:
        tree = Path(folder) / "tree"
        listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
        for name in filter(lambda name: (ROOT / name).exists(), listed.stdout.splitlines()):
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name, follow_symlinks=False)
        if (ROOT.parent / "shared").is_dir():
            (Path(folder) / "shared").symlink_to((ROOT.parent / "shared").resolve())
        yield tree


def _share(mutations: Sequence[Mutation]) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    with copied() as tree:
        for mutation in mutations:
            began, noticed = time.monotonic(), judged(mutation, tree)
            change = f"{mutation.kind}, {mutation.file}:{mutation.line}: {mutation.before!r} -> {mutation.after!r}"
            print(f"{change}: {noticed or 'NOT NOTICED'} ({time.monotonic() - began:.0f} s)", flush=True)
            rows.append({**asdict(mutation), "noticed_by": noticed})
    return rows


def main() -> int:
    """Run the campaign; each worker has a copy of the tree."""
    parser = campaign_parser("mutations", __doc__, count=30, of="mutations", numbered=True)
    parser.add_argument("--workers", type=int, default=2, help="copies of the tree side by side [2]")
    parser.add_argument("--rooms", nargs="+", choices=ROOMS, default=ROOMS, help="of src/sinew [all of these]")
    asked = parser.parse_args()
    with copied() as tree:
        if already := failing(tree, ["tests"]):
            raise SystemExit(f"a test fails without any mutation: {already}; the campaign would prove nothing")
    chosen = drawn(asked.seed, asked.first + asked.mutations, asked.rooms)[asked.first :]
    with ThreadPoolExecutor(asked.workers) as pool:
        shares = pool.map(_share, [chosen[i :: asked.workers] for i in range(asked.workers)])
        rows = [row for share in shares for row in share]
    noticed = sum(bool(row["noticed_by"]) for row in rows)
    return conclude(asked.out, f"{noticed} of {len(rows)} noticed", rows)


if __name__ == "__main__":
    sys.exit(main())
