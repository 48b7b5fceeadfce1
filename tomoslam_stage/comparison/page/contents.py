"""All that the page shows, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import yaml

from tomoslam_stage.comparison.findings import verdict
from tomoslam_stage.comparison.measures import measures
from tomoslam_stage.comparison.page.charts import (
    correction_chart,
    residual_chart,
    shift_chart,
    slice_charts,
    track_charts,
)
from tomoslam_stage.comparison.page.movie import movie
from tomoslam_stage.comparison.page.viewers import sinogram_viewer, slices_viewer
from tomoslam_stage.comparison.plain import plain

if TYPE_CHECKING:
    from tomoslam_stage.comparison.findings import Findings


def contents(findings: Findings, report: Mapping[str, Any]) -> dict[str, Any]:
    """Gather what is shown; what there is nothing of is None or empty, and its section goes.

    Parameters
    ----------
    findings
        Some projections and one row of its scan are read, one after the other.
    report
        As `comparison.report` makes it.
    """
    # The angles are drawn as curves already.
    told = {key: value for key, value in report.items() if key not in ("theta", "pipeline")}
    return {
        "verdict": verdict(findings),
        "report": told,
        "slices": slices_viewer(findings),
        "slice_charts": slice_charts(findings),
        "correction": correction_chart(findings),
        "shifts": shift_chart(findings),
        "residuals": residual_chart(findings),
        "movie": movie(findings),
        "track_charts": track_charts(findings),
        "sinogram": sinogram_viewer(findings),
        "measures": plain(measures(findings)),
        "pipeline": pipeline_yaml(report),
    }


def pipeline_yaml(report: Mapping[str, Any]) -> str:
    """Write the pipeline as it ran, all parameters included, to be run again."""
    text: str = yaml.safe_dump(report["pipeline"], sort_keys=False, allow_unicode=True)
    return text if report["pipeline"] else ""
