"""What made a result: versions, hashes, platform, counts; written last, it says that the result is whole."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from workbench import __version__
from workbench.study.results.digests import MANIFEST, digests, read_manifest
from workbench.study.results.row import Row
from workbench.study.scenario.load import Study

__all__ = ["MANIFEST", "library_versions", "manifest", "read_manifest"]
_LIBRARIES = ("numpy", "numba", "scipy", "ruckig", "pyarrow", "plotly")


def manifest(study: Study, rows: Sequence[Row], folder: Path) -> dict[str, Any]:
    """The manifest of a study's finished result in `folder`; the commit where the program is a checkout."""
    failed = sum(not row.ok for row in rows)
    return {
        "format": 1,
        "study": study.scenario.name,
        "fingerprint": study.fingerprint,
        "scenario_hash": study.scenario_hash,
        "machine_hash": study.machine_hash,
        "machine": study.machine.name,
        "effects": study.effects_digests,
        "seed": getattr(study.scenario, "seed", None),
        "runs": {"all": len(rows), "ok": len(rows) - failed, "failed": failed},
        "versions": {"workbench": __version__, "python": platform.python_version()} | library_versions(),
        "files": digests(folder),
        "platform": f"{platform.system()} {platform.machine()}",
        "commit": _commit(Path(__file__).resolve().parents[3]),
    }


def library_versions() -> dict[str, str]:
    """The installed versions of the libraries that numbers and files come from."""
    from importlib.metadata import version

    return {name: version(name) for name in _LIBRARIES}


def _commit(checkout: Path) -> str | None:
    """The commit that is checked out, read from .git itself: git may not be installed."""
    try:
        git = checkout / ".git"
        head = (git / "HEAD").read_text().strip()
        if not head.startswith("ref: "):
            return head
        name = head.removeprefix("ref: ")
        if (git / name).is_file():
            return (git / name).read_text().strip()
        packed = (git / "packed-refs").read_text().splitlines()
        return next((line.split()[0] for line in packed if line.endswith(f" {name}")), None)
    except OSError:
        return None
