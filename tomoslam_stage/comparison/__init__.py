"""Was it worth it: recorded and refined side by side, in pictures and in numbers.

To add a sharpness figure, see `SHARPNESS` in `metrics.py`.
"""

from tomoslam_stage.comparison.findings import Findings, Run
from tomoslam_stage.comparison.metrics import SHARPNESS, compare
from tomoslam_stage.comparison.pictures import draw_comparison, draw_theta
from tomoslam_stage.comparison.report import report, versions, write_report
from tomoslam_stage.comparison.summary import summary

__all__ = [
    "SHARPNESS",
    "Findings",
    "Run",
    "compare",
    "draw_comparison",
    "draw_theta",
    "report",
    "summary",
    "versions",
    "write_report",
]
