"""The command `sinew`: its parts put together, and an error as one line and an exit status.

Exit status: 0 on success, 1 where a bench run, stop or doctor did not end well, 2 on wrong input (one line on stderr),
130 when interrupted. Any other exception is a fault of Sinew's own and keeps its
traceback.
"""

import os
import sys
from collections.abc import Callable, Sequence
from typing import Annotated

import typer

from sinew import __version__
from sinew.apps.bench import doctor, emulate, run, serve, stream, track
from sinew.apps.console import NumbersCommand
from sinew.apps.joints import calibrate, design, model, pose, predict, transfer
from sinew.apps.recordings import analyse, convert, gait, identify, reproduce, runs, simulate
from sinew.measure.errors import SinewError

app = typer.Typer(
    name="sinew",
    help="Sinew: a resonance laboratory for tendon-driven continuum joints, in software.",
    epilog="Example: sinew reproduce --out out/paper",
    add_completion=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

COMMANDS: dict[Callable[..., object], tuple[str, ...]] = {
    simulate.check: ("sinew check plans/paper.toml --rig rigs/paper.toml",),
    simulate.simulate: ("sinew simulate short --rig paper --out run/recording.nc --without guide_friction",),
    convert.look: ("sinew look swing.csv",),
    analyse.analyse: (
        "sinew analyse chirp.csv --kind broadband --time t_s --response phi:deg --drive u:N*m --out chirp",
        "sinew analyse decay.csv --kind ring-down --time t_s --response angle:deg --json",
    ),
    runs.runs: (
        'sinew runs runs --search "f_r>3.2 pretension=6 tag:aged"',
        "sinew runs runs --search pretension=6 --trend f_r --out ageing.svg",
    ),
    analyse.current: ("sinew current out/bench/recording.nc",),
    identify.identify: ("sinew identify a.csv --time t_s --input u:N*m --output phi:deg --excitation torque --json",),
    calibrate.calibrate: ("sinew calibrate rigs/paper.toml monday.nc tuesday.nc --out rigs/mine.toml",),
    predict.predict: (
        "sinew predict fit/fit.json --torque 1,2,4:V --through 3.1:12+-0.2:deg@2",
        "sinew predict rigs/paper.toml --pretension-mm 0,6,12 --json",
    ),
    transfer.transfer: ("sinew transfer rigs/paper.toml --pretension-mm 0,4,8 --out out/transfer.mat",),
    model.model: (
        "sinew model paper --pretension-mm 6 --out joint.xml",
        "sinew model paper --pretension-mm 6 --out joint.urdf --json",
    ),
    pose.modes: ("sinew modes rigs/paper.toml --pretension-mm 0,6,12 --bend-deg 0,10,20 --out out/modes.html",),
    design.joint: ("sinew joint --section circle --outer-mm 60 --out sixty.toml",),
    predict.compare: ("sinew compare paper ring.toml --pretension-mm 0,6,12 --out out/compared",),
    design.tune: ("sinew tune rigs/paper.toml --resonance-hz 3.2,3.6,4 --yaw-deg 7 --json",),
    pose.pose: ("sinew pose paper --pretension-mm 6 --bend-deg 20 --azimuth-deg 90 --out bent.png",),
    pose.workspace: ("sinew workspace paper --pretension-mm 0,6,12 --step-deg 4 --out workspace.png",),
    gait.gait: ("sinew gait slow.npz fast.npz --speed-m-s 0.8,1.4 --out out/gait",),
    design.design: ("sinew design --stride-hz 0.7:1.1 --yaw-deg 7 --inertia-kg-m2 0.25 --out out/torso",),
    reproduce.answer: ("sinew answer out/paper/recording.nc --out out/paper",),
    convert.import_: ("sinew import decay.csv --time t_s --response angle:deg --out decay.nc",),
    convert.export: ("sinew export run/recording.nc --to mat --out run/recording.mat",),
    convert.table: (
        "sinew table out/paper --part resonance --columns pretension_mm,resonance_hz,gain_peak --out resonance.tex",
        "sinew table fit/fit.json --to csv",
    ),
    convert.film: ("sinew film run/recording.nc --kind sweep --pretension-mm 6 --out run/sweep.mp4",),
    emulate.emulate: ("sinew emulate --rig paper --link /tmp/bench --fault unplug@60 --seed 1",),
    doctor.doctor: (
        "sinew doctor --port /dev/ttyUSB0 --rig rigs/paper.toml --fix",
        "sinew doctor --port /dev/ttyUSB0 --guide my-rig.toml",
    ),
    run.run: ("sinew run short --rig paper --port /dev/ttyUSB0 --out out/bench",),
    track.track: ("sinew track paper --emulate --pretension-mm 0,4,8,12 --out out/backbone",),
    serve.serve: ("sinew serve --emulate --runs runs",),
    stream.stream: ("sinew stream runs/monday --ws-port 8765",),
    run.stop: ("sinew stop --port /dev/ttyUSB0 --state release",),
    reproduce.report: ("sinew report out/paper",),
    reproduce.reproduce: ("sinew reproduce --out out/paper --seed 1",),
}
"""The commands in the order in which they are listed, each with examples."""

for _function, _examples in COMMANDS.items():
    _epilog = "\n\n".join(f"Example: {one}" for one in _examples)
    app.command(_function.__name__.rstrip("_"), cls=NumbersCommand, epilog=_epilog)(_function)


@app.callback(invoke_without_command=True)
def _sinew(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and leave.")] = False,
) -> None:
    if version:
        print(f"sinew {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line (`sys.argv` by default) and return its exit status."""
    try:
        status = app(args=None if arguments is None else list(arguments), standalone_mode=False, prog_name="sinew")
        sys.stdout.flush()
    except SinewError as error:
        return _refuse(str(error), 2)
    except typer.TyperException as error:
        return _refuse(getattr(error, "format_message", error.__str__)(), 2)
    except (KeyboardInterrupt, typer.Abort):
        return _refuse("interrupted; what was being written is not there, what was finished is", 130)
    except BrokenPipeError:
        # The reader of a pipe has left (`sinew ... | head`); without this Python complains again while it exits.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return status if isinstance(status, int) else 0


def _refuse(sentence: str, status: int) -> int:
    print(f"sinew: {' '.join(sentence.split())}", file=sys.stderr)
    return status
