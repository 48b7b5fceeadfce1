"""write_theta: accepted angles -> the scan, or a companion file."""

from __future__ import annotations

import logging
from typing import ClassVar

from tomoslam_stage import scans
from tomoslam_stage.comparison import versions
from tomoslam_stage.frames import of_all_frames, shift_in_file
from tomoslam_stage.methods import method
from tomoslam_stage.stages.work import SideOutputs, Work, made

log = logging.getLogger(__name__)


@method
class WriteTheta:
    """Write the refined angles back, if they were accepted; else touch nothing."""

    needs: ClassVar = ("scan", "refinement")

    safe_copy: bool = False
    """Edit a copy and put it in place, as is done up to 256 MB, however large the scan is."""

    def check_writable(self, work: Work) -> None:
        """Refuse what could not be written at the end."""
        if work.output is not None:
            scans.check_output(work.output, work.path)
        elif not work.dry_run:
            scans.check_writable(work.path, safe_copy=self.safe_copy)

    def run(self, work: Work) -> SideOutputs:
        """Write in one transaction."""
        scan, refinement = made(work.scan, "scan"), made(work.refinement, "refinement")
        if refinement.status == "kept":
            log.info("%s: recorded angles kept, nothing written", scan.name)
            return {}
        if work.dry_run:
            log.info("%s: dry run, nothing written", scan.name)
            return {}
        shift, shift_sigma = (
            None if some is None else shift_in_file(scan, some)
            for some in (refinement.shift, refinement.shift_sigma)
        )
        record = scans.ProcessRecord(
            parameters={"pipeline": work.pipeline},
            versions={name: version or "" for name, version in versions().items()},
            started=work.started,
            message=refinement.reason,
            shift_px=shift,
            shift_sigma_px=shift_sigma,
        )
        refined, sigma = of_all_frames(
            scan, refinement.refined, refinement.sigma, refinement.stage_noise
        )
        if work.output is None:
            scans.write_theta(work.path, refined, sigma, record, safe_copy=self.safe_copy)
        else:
            scans.write_companion(work.output, work.path, refined, sigma, record)
        log.info("%s: refined angles written", (work.output or work.path).name)
        return {}
