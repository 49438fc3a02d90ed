"""What was computed before, kept on the disk: answers by what was asked of the equations as they are now.

The folder is that of compiled code. Nothing depends on it: what is not there, cannot be read or belongs to other
equations is computed anew. A process whose source was changed after it began does without: nobody knows which of both
it has read.
"""

import hashlib
import json
import os
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import sinew
from sinew.measure.doors import write_text
from sinew.measure.errors import FileError

_MOST = 64
_TICK_NS = 20_000_000  # a file's time may lie so far behind the clock


def cache_folder() -> Path:
    """Return the folder of what need not be computed again: $SINEW_CACHE, else $XDG_CACHE_HOME/sinew, else
    ~/.cache/sinew."""
    if chosen := os.environ.get("SINEW_CACHE"):
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "sinew"


def key_of(*asked: Any) -> str:
    """Return what stands for a question. asked: as JSON holds it."""
    return hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()


def recall(kind: str, key: str) -> Any:
    """Return what `keep` was given under a key of `key_of`; None where that is not known."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        file = _file(kind, key)
        told = json.loads(file.read_text(encoding="utf-8"))
        if told["key"] == key:
            os.utime(file)
            return told["found"]
    return None


def keep(kind: str, key: str, found: Any, most: int = _MOST) -> None:
    """Write an answer down, and forget those of its kind that were not asked for longest; a full disk costs a
    computation, no more.

    found: as JSON holds it. most: of a kind that are kept.
    """
    with suppress(OSError, FileError):
        file = _file(kind, key)
        if _source() != _of_this_source():  # it was changed since
            return
        write_text(file, json.dumps({"key": key, "found": found}))
        others = sorted(file.parent.glob("*.json"), key=lambda one: one.stat().st_mtime_ns)
        for old in others[:-most]:
            old.unlink()


def _file(kind: str, key: str) -> Path:
    """Return where an answer of this source is. Raises FileNotFoundError where this process may have another one."""
    if not (source := _of_this_source()):
        raise FileNotFoundError("the source has changed since this process began")
    return cache_folder() / kind / f"{source}-{key[:32]}.json"


@cache
def _of_this_source() -> str:
    """Return what stands for the equations as they are now: whoever changes them wants no answer of those before.

    Empty where a file was changed, moved or made since this process began.
    """
    return _source()


def _source() -> str:
    stats = [(path, path.stat()) for path in sorted(Path(__file__).parents[1].rglob("*.py"))]
    if any(about.st_ctime_ns > sinew._began_ns - _TICK_NS for _, about in stats):
        return ""
    text = repr([(str(path), about.st_size, about.st_mtime_ns) for path, about in stats])
    return hashlib.sha256(text.encode()).hexdigest()[:16]
