"""This is where `sinew predict` takes a rig, or makes one, and writes what it was asked to write."""

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sinew.apps.console import require_file, require_folder
from sinew.apps.joint import design_document, write_rig
from sinew.apps.joint_options import JointOptions, designed_rig
from sinew.apps.predict_further import Further
from sinew.apps.predict_rig import RigAsked, predict_rig

__all__ = ["predict_joint"]


def predict_joint(
    base: str | None, joint: JointOptions, asked: RigAsked, further: Further, out: Path | None
) -> tuple[dict[str, Any], Callable[[], list[dict[str, Any]]]]:
    """Return the document of a rig's prediction, and what gives its backbones; write files where `out` says so.

    base: file or name of the rig. joint: what is changed in it. further: what is asked beside the curves. out: a folder
    for figures and page, or a file ending in .toml for the rig alone.
    """
    alone = out is not None and out.suffix == ".toml"
    if out is not None:
        if alone:
            require_file(out)
        else:
            require_folder(out)
    held = further.held(base)
    rig, design = designed_rig(base, joint)
    found = predict_rig(rig, further.asked(held, asked))
    more, figures = further.answered(held, found, base, drawn=out is not None and not alone)
    document: dict[str, Any] = {"rig": rig.name, **found.document(), **more}
    if design is not None:
        document |= design_document(rig, design)
    if out is not None and alone:
        write_rig(rig, out)
    elif out is not None:
        from sinew.apps.predict_pages import write_prediction

        words = ["sinew", "predict", *([base] if base else []), *joint.words()]
        words += [*further.words(asked), "--out", str(out)]
        write_prediction(found, document, out, shlex.join(words), figures)
    return document, found.backbones
