"""A score in sentences."""

from __future__ import annotations

from workbench.blind import criteria
from workbench.blind.score import Score


def sentences(score: Score) -> list[str]:
    """When the test was made and opened, how many campaigns have an answer, and what was not blind."""
    counts = f"{len(score.rows)} of {score.cases} campaigns"
    said = [
        f"{counts} are answered; made {score.manifest.made} by version {score.manifest.version}, answered by version "
        f"{', '.join(score.versions)}, seal first opened {score.opened}.",
        f"Seal (SHA-256) {score.manifest.seal_sha256}: labels, manifest, campaigns and answers are as they were.",
    ]
    if score.partial:
        said.append("This is a part of the test: `workbench blind run` goes on with the rest.")
    if score.after_opening:
        said.append(
            f"{len(score.after_opening)} campaigns were answered after the seal had been opened; they are counted, and "
            "blind only as far as nothing was changed in between."
        )
    broken = [row["folder"] for row in score.rows if row["word"] in ("refused", "failed")]
    if broken:
        said.append(f"No diagnosis came of {', '.join(broken)}; they count as wrong.")
    if all(criteria.source_of(row) == "plant" for row in score.rows):
        said.append("All campaigns come from the plant's own equations: this is what the diagnosis can do at best.")
    return said
