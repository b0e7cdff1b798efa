"""A score in sentences."""

from __future__ import annotations

from workbench.blind import criteria, measures
from workbench.blind.score import Score, Sheet


def answer(sheet: Sheet) -> str:
    """The score in one line: what is named, what is accused without a gap, what is said to be unknown."""
    said = [("named", "single effects are named"), ("pair_both", "pairs are named in full")]
    said += [
        ("false_alarm", "machines without a gap are given a cause"),
        ("unknown_caught", "unlisted causes are caught"),
    ]
    shares = [(measures.measure(key).share(sheet.rows), words) for key, words in said]
    return "; ".join(f"{share.count} of {share.of} {words}" for share, words in shares if share.of) + "."


def sentences(sheet: Sheet) -> list[str]:
    """When the test was made and opened, how many campaigns have an answer, and what was not blind."""
    several = len(sheet.scores) > 1
    said = [sentence for score in sheet.scores for sentence in _of_folder(score, f"{score.folder.name}: " * several)]
    broken = [row["folder"] for row in sheet.rows if row["word"] in ("refused", "failed")]
    if broken:
        said.append(f"No diagnosis came of {', '.join(broken)}; counted as wrong.")
    if all(criteria.source_of(row) == "plant" for row in sheet.rows):
        said.append("All campaigns come from the plant's own equations: this is what the diagnosis can do at best.")
    return said


def _of_folder(score: Score, begin: str) -> list[str]:
    """begin: the folder's name where there are several."""
    counts = f"{len(score.rows)} of {score.cases} campaigns"
    said = [
        f"{begin}{counts} are answered; made {score.manifest.made} by version {score.manifest.version}, answered by "
        f"version {', '.join(score.versions)}, seal first opened {score.opened}.",
        f"{begin}Seal (SHA-256) {score.manifest.seal_sha256}: labels, manifest, campaigns and answers are as they "
        f"were. Seed {score.truth.seed}.",
    ]
    if score.compared:
        said.append(f"{begin}{score.compared}")
    if score.again:
        said.append(f"{begin}Answered more than once, the last answer counts: {', '.join(score.again)}.")
    if score.partial:
        said.append(f"{begin}This is a part of the test: `workbench blind run` goes on with the rest.")
    if score.after_opening:
        said.append(
            f"{begin}{len(score.after_opening)} campaigns were answered after the seal had been opened; they are "
            "counted, and blind only as far as nothing was changed in between."
        )
    return said
