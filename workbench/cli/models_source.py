"""The input of `compare-models`: the torque records of a campaign, or the closed loops of a scenario."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from workbench.cli.campaign import load_campaign
from workbench.core.errors import InputError
from workbench.machines import of_kind, studied
from workbench.simulate.models import ModelsCompared, compare_loops, compare_models
from workbench.simulate.multibody_loop import check_multibody

MOST_LOOPS = 12


def comparison_of(source: Path, runs: str | None, machine: Path | None, step_s: float) -> Callable[[], ModelsCompared]:
    """The comparison, to be run when called; all of the input is checked before. InputError as of its readers."""
    if source.is_file():
        return _of_scenario(source, runs, machine, step_s)
    campaign = load_campaign(source, runs, machine, None)
    hoist = studied(campaign.machine)
    if hoist is None:
        kind = of_kind(campaign.machine)
        raise InputError(f"{kind}; the multi-body machine is a hoist", file=source / "machine.yaml")
    check_multibody(hoist)
    return lambda: compare_models(hoist, campaign.runs, step_s=step_s)


def _of_scenario(source: Path, runs: str | None, machine: Path | None, step_s: float) -> Callable[[], ModelsCompared]:
    from workbench.study.load import load_study
    from workbench.study.run import case_of

    if runs is not None or machine is not None:
        raise InputError("belongs to a campaign; a scenario names both itself", place="--runs" if runs else "--machine")
    study = load_study(source)
    check_multibody(study.machine)
    if len(study.specs) > MOST_LOOPS:
        raise InputError(
            f"makes {len(study.specs)} runs, expected at most {MOST_LOOPS} to compare one by one", file=source
        )
    cases = [case_of(spec) for spec in study.specs]
    return lambda: compare_loops(cases, step_s=step_s)
