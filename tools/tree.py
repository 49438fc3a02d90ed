"""The repository's own files: what git tracks, and what it would track if it were added."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def repository_files(*patterns: str) -> list[Path]:
    """Return the existing regular files under git's eyes, or those that match one of the patterns, sorted.

    patterns: as git takes them, for example "*.md". Raises CalledProcessError outside a git work tree.
    """
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", "--", *patterns]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split("\0")
    paths = (ROOT / name for name in sorted(set(listed)) if name)
    return [path for path in paths if path.is_file() and not path.is_symlink()]
