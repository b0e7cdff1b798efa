"""A score as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from workbench.blind import criteria, measures
from workbench.blind.baselines import baselines
from workbench.blind.criteria import Row, Share, right
from workbench.blind.later import WithNextRun
from workbench.blind.measures import MEASURES, OF_A_METHOD, median, median_interval, numbers
from workbench.blind.power import Power
from workbench.blind.score import Score, Sheet
from workbench.core.json_records import plain
from workbench.reports.blind.tables import DIAGNOSIS, settled, why


def to_json(sheet: Sheet, power: Power | None = None, next_runs: Sequence[WithNextRun] = ()) -> dict[str, Any]:
    """Everything that the page shows. folders: what was scored; cases: each campaign's label and answer."""
    said: dict[str, Any] = {
        "format": 3,
        "folders": [_folder(score) for score in sheet.scores],
        "campaigns": sheet.cases,
        "answered": len(sheet.rows),
        "groups": {name: _group(rows) for name, rows in measures.groups(sheet.rows).items()},
        "by_size": {
            kind: {name: _group(rows) for name, rows in measures.by_size(of_kind).items()}
            for kind, of_kind in measures.by_kind(sheet.rows).items()
        },
        "methods": {
            kind: {name: _shares(rows, OF_A_METHOD) for name, rows in _methods(of_kind).items()}
            for kind, of_kind in measures.by_kind(sheet.rows).items()
        },
        "reliability": [
            {"from": b.low, "below": b.high, "said": b.said, "right": _share(b.right)}
            for b in measures.reliability(sheet.rows)
        ],
        "next_run_settles": _share(settled(next_runs)) if next_runs else None,
        "next_runs": [_next_run(case) for case in next_runs],
        "power": None if power is None else plain(power),
        "cases": [_case(row) for row in sheet.rows],
    }
    shown: dict[str, Any] = plain(said)
    return shown


def _methods(rows: Sequence[Row]) -> dict[str, Sequence[Row]]:
    return {DIAGNOSIS: rows, **baselines(rows)}


def _next_run(case: WithNextRun) -> dict[str, Any]:
    return {
        "campaign": case.row["folder"],
        "effects": case.row["label"]["effects"],
        "ranking": case.row["ranking"],
        "run": case.row["next_run"],
        "ranking_with_it": case.then["ranking"],
        "settled": case.settled,
    }


def _folder(score: Score) -> dict[str, Any]:
    return {
        "folder": score.folder.name,
        "made": score.manifest.made,
        "version": score.manifest.version,
        "answered_by": list(score.versions),
        "asked": dict(score.manifest.asked),
        "seed": score.truth.seed,
        "seal_sha256": score.manifest.seal_sha256,
        "opened": score.opened,
        "campaigns": score.cases,
        "answered": len(score.rows),
        "after_opening": list(score.after_opening),
    }


def _group(rows: Sequence[Row]) -> dict[str, Any]:
    n = numbers(rows)
    return {
        **_shares(rows),
        "parameter_error_median": median(n.parameter_errors),
        "parameter_error_median_95": median_interval(n.parameter_errors),
        "inside_90": _share(n.covered),
        "shrink_over_oracle_median": median(n.of_oracle),
        "shrink_over_oracle_median_95": median_interval(n.of_oracle),
        "calibration_error": n.calibration_error,
        "calibration_error_by_chance": n.calibration_by_chance,
        "cpu_s_median": median(n.cpu_s),
        "cpu_s_largest": n.cpu_s[-1] if n.cpu_s else None,
    }


def _shares(rows: Sequence[Row], keys: Sequence[str] = ()) -> dict[str, Any]:
    return {measure.key: _share(measure.share(rows)) for measure in MEASURES if not keys or measure.key in keys}


def _share(share: Share) -> dict[str, Any]:
    low, high = share.interval()
    return {"count": share.count, "of": share.of, "low_95": low, "high_95": high}


def _case(row: Row) -> dict[str, Any]:
    label = row["label"]
    return {
        "campaign": row["folder"],
        "source": criteria.source_of(row),
        "family": criteria.family_of(row),
        "kind": criteria.kind_of(row),
        "effects": label["effects"],
        "where": label["where"],
        "parameters": label.get("parameters", {}),
        "gap_over_noise": criteria.size_over_noise(row),
        "verdict": row["word"],
        "names": row["names"],
        "alike": row["alike"],
        "ranking": row["ranking"],
        "places": row["places"],
        "before": row["before"],
        "after": row["after"],
        "noise": row["noise"],
        "cpu_s": row["cpu_s"],
        "right": right(row),
        "why": "" if right(row) else why(row),
    }
