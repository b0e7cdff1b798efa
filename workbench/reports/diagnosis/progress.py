"""The progress of a diagnosis in words."""

from __future__ import annotations

from workbench.diagnose.progress import Progress, Stage, Task
from workbench.diagnose.words import listed

STAGES = {
    Stage.READ: "reading the logs",
    Stage.SEARCH: "searching the effects",
    Stage.JUDGE: "the verdict",
    Stage.LOCATE: "where the gap lies",
    Stage.SEPARATE: "what these runs can tell apart",
    Stage.SHRINK: "how far the gap shrinks",
    Stage.CONSEQUENCES: "what changes in the control study",
    Stage.WRITE: "writing the report",
}


def progress_words(progress: Progress) -> str:
    """The current step in one short line."""
    names = listed(progress.effects) if progress.effects else ""
    return {
        Task.BASE: "base parameters",
        Task.SIGNATURES: "signatures of all effects",
        Task.SINGLE: f"effect {progress.step} of {progress.steps}: {names}",
        Task.PAIRS: f"pairs with {names}",
    }.get(progress.task, STAGES[progress.stage])


def share_done(progress: Progress) -> float:
    """The share of the work that is done, 0 to 1: by stages, and within the search by its steps."""
    within = (progress.step - 1) / progress.steps if progress.steps else 0.0
    return (progress.stage.value + within) / len(Stage)
