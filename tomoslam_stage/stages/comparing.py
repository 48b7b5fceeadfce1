"""compare: everything found -> Comparison, and the files people look at."""

from __future__ import annotations

from typing import ClassVar

from tomoslam_stage import comparison, scans
from tomoslam_stage.methods import method
from tomoslam_stage.stages.work import SideOutputs, Work, made

SLICES = "slices.h5"


@method
class Compare:
    """Compare recorded and refined angles, and write the report folder."""

    needs: ClassVar = ("scan", "refinement", "reconstructions")
    makes: ClassVar = ("comparison",)

    save_tiff: bool = False
    """Write the slices as stacks of float32 TIFF pages, too: ``slices/refined.tif`` and so on."""

    def run(self, work: Work) -> SideOutputs:
        """Leave the comparison and the report, and write its files."""
        scan, refinement = made(work.scan, "scan"), made(work.refinement, "refinement")
        slices = made(work.reconstructions, "reconstructions")
        truth = scans.read_truth(work.path, scan.frames)
        compared = comparison.compare(refinement, slices, truth)
        work.comparison = compared
        findings = comparison.Findings(scan, refinement, slices, compared, truth, work.tracks)
        run = comparison.Run(dict(work.seconds), work.pipeline, work.started)
        work.report = comparison.write_report(work.folder, findings, run)
        # The halves serve the Fourier ring correlation, and nobody else.
        wholes = comparison.wholes(slices)
        scans.write_slices(work.folder / SLICES, wholes)
        if self.save_tiff:
            scans.write_tiffs(work.folder / "slices", wholes)
        return {}
