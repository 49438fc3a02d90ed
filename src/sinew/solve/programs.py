"""JAX's settings, and its programs kept from run to run: as they are traced, and compiled.

To trace a program, which is to follow our functions operation by operation, takes JAX up to some seconds, in every
process; to compile it, more. JAX keeps what it has compiled, and is asked for that by the traced program. Those of
`program` are kept as JAX exports them, and read back in some milliseconds.
"""

import contextlib
import ctypes
import hashlib
import inspect
import io
import os
import pickle
from base64 import b64decode, b64encode
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from threading import RLock
from typing import Any

import jax
import jaxlib
import numpy as np
import scipy
from jax import export

from sinew.measure.errors import SpecError
from sinew.measure.kept import cache_folder, keep, key_of, recall
from sinew.measure.tasks import DEVICE, cores

_WHOLE_LOOP = "xla_cpu_small_while_loop_byte_threshold"
"""XLA's option: a loop whose turn reads and writes fewer bytes is compiled into one function."""

_TURN_BYTES = 5_000_000  # of ours up to 1 000 000: a step of the twin in a batch of 64 lanes

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # of glibc's malloc.h
_KEPT_BYTES = 64 << 20


def use_all_cores() -> None:
    """Do what `configure` does, for work in many large batches: they run on every core, where JAX has not computed yet.

    A program of hundreds of small kernels, such as a batch of joints in space, does not stay in the thread that asks;
    with a pool of one thread two of them take turns. A pool of all cores is for them alone, as one program by itself
    takes a half longer in it. A user's own NPROC stays.
    """
    os.environ.setdefault("NPROC", str(cores()))
    configure()


def configure() -> None:
    """Switch JAX to double precision, the persistent compilation cache and its device; once per process.

    The device is the CPU, whatever else JAX finds, or a GPU where $SINEW_DEVICE is `gpu`: double precision there too.
    Raises SpecError where there is none, or where this process has begun on the other one.
    """
    wanted = os.environ.get(DEVICE) or "cpu"
    if (begun := _begun()) != wanted:
        raise SpecError(f"this process computes on the {begun} already; begin a new one for the {wanted}")


def _keep_memory() -> None:
    """Have glibc keep what is freed, up to 64 MB; another library of C stays as it is.

    Every call of a compiled program asks for some megabytes and frees them. Left to itself glibc gives them back to the
    system, which clears every page of them anew: a seventh of the time of 13 predicted curves.
    """
    with contextlib.suppress(OSError, AttributeError, TypeError):
        libc = ctypes.CDLL(None)
        libc.mallopt(_TRIM_THRESHOLD, _KEPT_BYTES)
        libc.mallopt(_MMAP_THRESHOLD, _KEPT_BYTES)


@cache
def _begun() -> str:
    """Set JAX up and return the device.

    What is computed is computed in the thread that asks for it, and cores share the work by batches, which threads of
    ours ask for. JAX's own way is to hand every program to a pool and every small kernel of it, some hundred in one
    slope of the joint in space, from thread to thread of another one: two thirds of the processor's time went into
    that, 169 µs for a slope instead of 63. And a loop that keeps time with a priority of its own does not wait for
    threads that have none: beside two busy programs on two cores, the slowest of 1500 steps of the emulated joint took
    1 ms instead of 27. How many threads JAX makes is NPROC's to say, and a user's own stays; see `use_all_cores`.

    Loops of small steps are compiled whole. XLA does that by itself up to 1024 bytes in a turn, and calls every
    operation of a larger one by itself: the derivatives of a simulated oscillation took ten times as long. The option
    has no other door than the environment; XLA reads it when it first computes, and a version that does not know it
    passes it over. Several lists of such options add up, so a user's own stays beside ours.

    What JAX and XLA log, as that a constant takes long to fold, helps nobody at a command: errors come as exceptions.
    A user's own JAX_LOGGING_LEVEL stays.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if _WHOLE_LOOP not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --xla_backend_extra_options={_WHOLE_LOOP}={_TURN_BYTES}".strip()
    os.environ.setdefault("NPROC", "1")
    _keep_memory()
    settings: dict[str, object] = {"jax_enable_x64": True, "jax_cpu_enable_async_dispatch": False}
    if "JAX_LOGGING_LEVEL" not in os.environ:
        settings["jax_logging_level"] = "CRITICAL"
    folder = cache_folder()
    with contextlib.suppress(OSError):  # a read-only home costs a compilation each time, nothing else
        folder.mkdir(parents=True, exist_ok=True)
        settings["jax_compilation_cache_dir"] = str(folder)
        settings["jax_persistent_cache_min_compile_time_secs"] = 0.2
        settings["jax_persistent_cache_min_entry_size_bytes"] = 0
    device = os.environ.get(DEVICE) or "cpu"
    if device == "cpu":
        settings["jax_platforms"] = "cpu"
    for name, value in settings.items():
        jax.config.update(name, value)  # type: ignore[no-untyped-call]
    if device != "cpu" and jax.default_backend() != device:
        raise SpecError(
            f"found no GPU that JAX can use, only {jax.default_backend()}; install a JAX for yours, as by `pip install "
            '"jax[cuda13]"`, or compute on the CPU (--device cpu)'
        )
    return device


_KIND, _MOST = "programs", 512

_PLAIN = {np.ndarray, np.float64, np.int64}
_making = RLock()
"""Held while a program is traced, which may call others."""

_ready: dict[Any, Callable[..., Any] | None] = {}
"""Of this process: by function, arguments that are static, and shapes; None for what is not kept."""


def forget() -> None:
    """Have this process read or trace every program anew."""
    _ready.clear()


def program(
    *, static: Sequence[str] = (), options: dict[str, Any] | None = None
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return what makes a function a compiled program, as `jax.jit` does, whose trace is kept from run to run.

    static: names of arguments that the program is compiled for. options: of the compiler. The function takes all
    else as arguments, arrays in trees: what it enclosed, no key would know of. Plain numbers are float64 and int64 to
    it, not of JAX's weak types. What is kept holds for the source of Sinew and the versions of JAX as they are; a
    program of other people's classes or functions, whose source nobody watches, is traced in every process, and so is
    one that cannot be exported.
    Raises TypeError for a function that encloses something.
    """

    def of(function: Callable[..., Any]) -> Callable[..., Any]:
        if function.__closure__:
            raise TypeError(f"found a program that encloses something, {function.__qualname__}; hand it in")
        traced = jax.jit(function, static_argnames=tuple(static), compiler_options=options)
        names = tuple(inspect.signature(function).parameters)

        @wraps(function)
        def run(*args: Any, **kwargs: Any) -> Any:
            given = dict(zip(names, args, strict=False)) | kwargs
            if len(given) != len(args) + len(kwargs):
                return traced(*args, **kwargs)  # raises what such a call raises
            chosen = {name: given.pop(name) for name in static if name in given}
            leaves, tree = jax.tree.flatten(given)
            if not {type(leaf) for leaf in leaves} <= _PLAIN:
                if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
                    return traced(*args, **kwargs)
                leaves = [leaf if hasattr(leaf, "dtype") else np.asarray(leaf) for leaf in leaves]
            key = (function, tree, *chosen.items(), *[(leaf.shape, leaf.dtype.char) for leaf in leaves])
            if key not in _ready:
                with _making:
                    if key not in _ready:
                        _ready[key] = _kept(function, chosen, leaves, tree, options)
            do = _ready[key]
            return traced(*args, **kwargs) if do is None else do(leaves)

        return run

    return of


def _kept(
    function: Callable[..., Any],
    chosen: Mapping[str, Any],
    leaves: Sequence[Any],
    tree: Any,
    options: dict[str, Any] | None,
) -> Callable[[Sequence[Any]], Any] | None:
    """Return the program for arguments of these shapes, from leaves to result; None where it cannot be kept."""
    configure()
    if not function.__module__.startswith("sinew."):
        return None
    kinds = [[list(leaf.shape), str(leaf.dtype)] for leaf in leaves]
    try:
        asked = hashlib.sha256(_bytes((chosen, jax.tree.unflatten(tree, range(len(leaves)))))).hexdigest()
        key = key_of(f"{function.__module__}.{function.__qualname__}", asked, kinds, _surroundings())
        exported, result = _recalled(key) or _traced(key, function, chosen, leaves, tree)
    except (ValueError, NotImplementedError, pickle.PicklingError, AttributeError, TypeError):
        return None  # an error of the function itself comes again where it is called

    def call(*leaves: Any) -> Any:
        return exported.call(*leaves)  # type: ignore[no-untyped-call]

    call.__name__ = function.__name__  # as JAX tells of it
    compiled = jax.jit(call, compiler_options=options)
    return lambda leaves: jax.tree.unflatten(result, compiled(*leaves))


def _recalled(key: str) -> tuple[export.Exported, Any] | None:
    """Return what was kept, and the tree of its results; None where there is nothing that can be read."""
    with contextlib.suppress(Exception):  # whatever a damaged file does to those who read it
        *parts, digest = recall(_KIND, key)
        program, result = map(b64decode, parts)
        if digest != hashlib.sha256(program + result).hexdigest():
            return None
        return export.deserialize(bytearray(program)), jax.tree.structure(pickle.loads(result))
    return None


def _traced(
    key: str, function: Callable[..., Any], chosen: Mapping[str, Any], leaves: Sequence[Any], tree: Any
) -> tuple[export.Exported, Any]:
    """Return the same of a function that is traced now, and keep it. Raises what `_kept` takes as a refusal."""
    results: list[Any] = []

    def flat(*leaves: Any) -> list[Any]:
        parts, result = jax.tree.flatten(function(**jax.tree.unflatten(tree, leaves), **chosen))
        results.append(result)
        return parts

    flat.__name__ = function.__name__
    exported = export.export(jax.jit(flat))(*(jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) for leaf in leaves))  # type: ignore[no-untyped-call]
    result = results[-1]
    parts = bytes(exported.serialize()), _bytes(jax.tree.unflatten(result, range(result.num_leaves)))
    digest = hashlib.sha256(b"".join(parts)).hexdigest()
    keep(_KIND, key, [*(b64encode(part).decode() for part in parts), digest], most=_MOST)
    return exported, result


@cache
def _surroundings() -> list[str]:
    """Return what a kept program depends on beside the source of Sinew, which a key has already."""
    versions = [one.__version__ for one in (jax, jaxlib, np, scipy)]
    return [*versions, jax.default_backend(), str(jax.config.jax_enable_x64)]  # type: ignore[attr-defined]


def _bytes(thing: Any) -> bytes:
    """Return a thing as bytes. Raises PicklingError where it is made of classes or functions of other people."""
    written = io.BytesIO()
    _OursAlone(written).dump(thing)
    return written.getvalue()


class _OursAlone(pickle.Pickler):
    def reducer_override(self, thing: Any) -> Any:
        if isinstance(thing, type) or callable(thing):
            where = str(getattr(thing, "__module__", "")).partition(".")[0]
            if where not in ("sinew", "numpy", "builtins", "jax", "jaxlib"):
                raise pickle.PicklingError(f"found {thing!r} of {where or 'nowhere'}")
        return NotImplemented
