"""Was it worth it: recorded and refined side by side, in pictures and in numbers.

To add a sharpness figure, see `SHARPNESS` in `metrics.py`; a figure of likeness to the true slices,
`SIMILARITY` in `similarity.py`; a panel of curves, `graphs_of` in `graphs.py`; a line of the table,
`measures.py`; a part of the page, `page`.
"""

from tomoslam_stage.comparison.compared import Compared, compared
from tomoslam_stage.comparison.findings import Findings, Run
from tomoslam_stage.comparison.metrics import SHARPNESS, compare, compare_slices
from tomoslam_stage.comparison.named import HALVES, wholes
from tomoslam_stage.comparison.report import report, write_report
from tomoslam_stage.comparison.similarity import SIMILARITY
from tomoslam_stage.comparison.slices_picture import draw_comparison
from tomoslam_stage.comparison.summary import summary
from tomoslam_stage.comparison.theta_picture import draw_theta
from tomoslam_stage.comparison.versions import versions

__all__ = [
    "HALVES",
    "SHARPNESS",
    "SIMILARITY",
    "Compared",
    "Findings",
    "Run",
    "compare",
    "compare_slices",
    "compared",
    "draw_comparison",
    "draw_theta",
    "report",
    "summary",
    "versions",
    "wholes",
    "write_report",
]
