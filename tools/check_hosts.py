"""Search of the tree for what must not be in it: package indexes, and paths of one machine.

A lock file with an index address sends every user to that address, past their own settings; a path of one machine
works nowhere else. `python tools/check_hosts.py` prints each find as file:line and exits 1 if there is any.
"""

import re
import sys
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tools.tree import ROOT, repository_files

# Written in pieces, so that this file does not find itself.
_INDEX = re.compile(
    r"(?:py"
    r"pi|npm"
    r"js|rubygems|mvnrepository)\.(?:org|com)|python"
    r"hosted|crates"
    r"\.io/|simple"
    r"/index"
    r"|--(?:extra-)?index"
    r"-url|--find"
    r"-links"
)
_MACHINE = re.compile(r"(?<![\w.])/(?:wo" r"rk|fa" r"rm|ro" r"ot|ho" r"me/\w+)/|/tmp/\w+_jobs")
_ANY_ADDRESS = re.compile(r"\w+://")
_NO_ADDRESS = re.compile(r"requirements[^/]*\.(?:txt|in)$|Makefile$|^\.ci/|\.sh$")


def find_hosts(text: str, name: str) -> list[str]:
    """Return "name:line: what" for every index address or machine path in a text.

    name: path of the file inside the repository; files that install things may hold no address at all.
    """
    patterns = [_INDEX, _MACHINE, *([_ANY_ADDRESS] if _NO_ADDRESS.search(name) else [])]
    return [
        f"{name}:{number}: {match.group(0)}"
        for number, line in enumerate(text.splitlines(), start=1)
        for pattern in patterns
        if (match := pattern.search(line))
    ]


def main() -> int:
    """Print every find in the repository's text files; return the exit status."""
    finds: list[str] = []
    for path in repository_files():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        finds += find_hosts(text, path.relative_to(ROOT).as_posix())
    print("\n".join(finds) if finds else "no package index and no machine path in the tree")
    return 1 if finds else 0


if __name__ == "__main__":
    sys.exit(main())
