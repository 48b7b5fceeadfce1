"""Kinds of factors, by the name a pipeline gives them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tomoslam_stage.refinement.factors.block import Block, Factor
from tomoslam_stage.refinement.factors.closure import Closure
from tomoslam_stage.refinement.factors.cv import Cv
from tomoslam_stage.refinement.factors.encoder import Encoder
from tomoslam_stage.refinement.factors.prior import Prior

if TYPE_CHECKING:
    from collections.abc import Mapping

FACTORS: Mapping[str, type[Factor]] = {
    "prior": Prior,
    "encoder": Encoder,
    "cv": Cv,
    "closure": Closure,
}

__all__ = ["FACTORS", "Block", "Closure", "Cv", "Encoder", "Factor", "Prior"]
