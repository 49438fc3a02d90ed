"""JAX as Sinew uses it: double precision, its device, its threads, and its own cache of compiled programs."""

import contextlib
import os
from collections.abc import Callable, Sequence
from functools import cache, wraps
from pathlib import Path
from typing import Any

import jax

from sinew.measure.errors import SpecError
from sinew.measure.tasks import DEVICE, cores

_WHOLE_LOOP = "xla_cpu_small_while_loop_byte_threshold"
"""XLA's option: a loop whose turn reads and writes fewer bytes is compiled into one function."""

_TURN_BYTES = 5_000_000  # of ours up to 1 000 000: a step of the twin in a batch of 64 lanes


def cache_folder() -> Path:
    """Return the folder of compiled programs: $SINEW_CACHE, else $XDG_CACHE_HOME/sinew, else ~/.cache/sinew."""
    if chosen := os.environ.get("SINEW_CACHE"):
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "sinew"


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


def program(
    *, static: Sequence[str] = (), options: dict[str, Any] | None = None
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that compiles a function by `jax.jit`, in the settings of `configure`.

    static: names of the arguments that the program is compiled for. options: of the compiler.
    """

    def of(function: Callable[..., Any]) -> Callable[..., Any]:
        compiled = jax.jit(function, static_argnames=tuple(static), compiler_options=options)

        @wraps(function)
        def run(*args: Any, **kwargs: Any) -> Any:
            configure()
            return compiled(*args, **kwargs)

        return run

    return of
