"""Which functions of tomopy an entry of a pipeline may name, and how they are fed.

Read from the sources of tomopy 1.15.2: a function is allowed where blocks give what the whole stack
gives. Everything here can be said without tomopy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tomoslam_stage.errors import PipelineError, nearest

if TYPE_CHECKING:
    from tomoslam_stage.products import Along


@dataclass(frozen=True)
class How:
    """How a function is fed with blocks of a stack, and what comes back."""

    along: Along
    """What it needs whole; where it needs neither, projections, which files read fastest."""
    by_axis: bool = False
    """Its parameter ``axis`` says what it needs whole instead: 0 projections, 1 rows."""
    finds: str = ""
    """Side output, where it finds a number in one row and leaves the stack alone."""
    filled: tuple[str, ...] = ()
    """Parameters besides the stack that are not the user's: flats, darks, angles."""
    withheld: tuple[str, ...] = ()
    """Parameters that stay at their defaults: callables, or such that do harm."""


PROJECTION, ROW = How("projection"), How("row")
AXIS = How("projection", by_axis=True)

ALLOWED: Mapping[str, Mapping[str, How]] = {
    "tomopy.prep.normalize": {
        "minus_log": PROJECTION,
        "normalize": How("projection", filled=("flat", "dark")),
        "normalize_bg": PROJECTION,
        "normalize_roi": PROJECTION,
    },
    "tomopy.prep.stripe": {
        "remove_stripe_fw": ROW,
        "remove_stripe_ti": ROW,
        "remove_stripe_sf": ROW,
        "remove_stripe_based_sorting": ROW,
        "remove_stripe_based_filtering": ROW,
        "remove_stripe_based_fitting": ROW,
        "remove_stripe_based_interpolation": ROW,
        "remove_large_stripe": ROW,
        "remove_dead_stripe": ROW,
        "remove_all_stripe": ROW,
    },
    # Without padding, retrieve_phase gives every row of a projection the values of the last.
    "tomopy.prep.phase": {"retrieve_phase": How("projection", withheld=("pad",))},
    "tomopy.prep.alignment": {"distortion_correction_proj": PROJECTION},
    "tomopy.misc.corr": {
        "adjust_range": PROJECTION,  # cuts off at its limits; without limits it does nothing
        "gaussian_filter": AXIS,
        "median_filter": AXIS,
        "median_filter_nonfinite": How("projection", withheld=("callback",)),
        "remove_nan": PROJECTION,
        "remove_neg": PROJECTION,
        "remove_outlier": AXIS,
    },
    "tomopy.recon.rotation": {
        "find_center": How("row", finds="cor", filled=("theta",)),
        "find_center_vo": How("row", finds="cor"),
    },
}
"""Module -> function -> how it is fed."""

WHOLE = "needs the whole stack at once"
CUDA = "needs CUDA and tomocuda"
SIMULATES = "spoils projections, for simulations"
MOVES = "changes the geometry, which is what is refined here"
BROKEN = "is broken in tomopy 1.15.2, where any call of it raises an error"
SLICES = "is for slices, not for projections"
SHAPE = "returns something else than a stack of the same shape"
SLITS = "is for the slits of one beamline"
OTHERS = "calls another library, by a function for `recon`"

REFUSED: Mapping[str, Mapping[str, str]] = {
    "tomopy.prep.normalize": {
        "normalize_nf": "needs to know which flats were taken when; load_scan does that by itself",
    },
    "tomopy.prep.stripe": {"stripes_detect3d": WHOLE, "stripes_mask3d": WHOLE},
    "tomopy.prep.alignment": {
        "align_seq": MOVES,
        "align_joint": MOVES,
        "tilt": MOVES,
        "shift_images": MOVES,
        "scale": SHAPE,
        "add_jitter": SIMULATES,
        "add_noise": SIMULATES,
        "blur_edges": "fades projections out towards their edges, which no projector expects",
        "find_slits_corners_aps_1id": SLITS,
        "calc_slit_box_aps_1id": SLITS,
        "remove_slits_aps_1id": SLITS,
        "distortion_correction_sino": "returns one row; take distortion_correction_proj",
        "load_distortion_coefs": SHAPE,
    },
    "tomopy.misc.corr": {
        "circ_mask": SLICES,
        "enhance_projs_aps_1id": "scales every projection by itself; attenuation is lost",
        "inpainter_morph": "needs a mask",
        "median_filter3d": WHOLE,
        "median_filter_cuda": CUDA,
        "remove_outlier1d": BROKEN,
        "remove_outlier3d": WHOLE,
        "remove_outlier_cuda": CUDA,
        "remove_ring": SLICES,
        "sobel_filter": BROKEN,
    },
    "tomopy.recon.rotation": {
        "find_center_pc": "takes two projections half a turn apart, whose angles are in question",
        "mask_empty_slice": SHAPE,
        "write_center": "writes files",
    },
    "tomopy.recon.algorithm": {"init_tomo": SHAPE},
    "tomopy.recon.wrappers": dict.fromkeys(["astra", "ufo_fbp", "ufo_dfi", "lprec"], OTHERS),
}
"""Module -> public function that is no entry -> why not."""


def allowed(module_path: str, function: str, where: str) -> How:
    """Return how `function` is fed, or say for `where` why it is not.

    Raises
    ------
    PipelineError
        If it is not in the table.
    """
    if module_path not in ALLOWED:
        raise PipelineError(where, f"no module {module_path!r}.", nearest(module_path, ALLOWED))
    functions = ALLOWED[module_path]
    why = REFUSED.get(module_path, {}).get(function)
    if why:
        known = ", ".join(functions)
        raise PipelineError(where, f"{module_path}.{function} {why}.", f"Allowed there: {known}.")
    if function not in functions:
        found = f"{module_path} has no function {function!r}."
        raise PipelineError(where, found, nearest(function, functions))
    return functions[function]
