"""This is where a plan is previewed for its page: what `sinew check --json` says of it."""

from typing import Any

__all__ = ["preview_document"]


def preview_document(plan_toml: str, rig_toml: str, swing: bool = True) -> dict[str, Any]:
    """Return what `sinew check --json` says of a plan on a rig, further `refusals` and `warnings` as sentences.

    plan_toml, rig_toml: texts. swing: simulate the plan for its largest torsions, which takes seconds where it is long.
    A plan that breaks a limit is an answer, with `ok` false. Raises SpecError where a text is no plan or no rig.
    """
    from sinew.apps.check import preview_plan, told_preview
    from sinew.plan.toml import parse_plan, parse_rig

    plan, rig = parse_plan(plan_toml), parse_rig(rig_toml)
    preview = preview_plan(plan, rig, swing=swing)
    warnings = [finding.sentence for finding in preview.findings if finding.severity == "warn"]
    return {**told_preview(plan, rig, preview), "refusals": list(preview.refusals), "warnings": warnings}
