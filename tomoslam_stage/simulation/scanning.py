"""Scans whose true angles are known: a recipe, and what a beamline would record of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.methods import build, checked, method
from tomoslam_stage.products import Floats, Pixels
from tomoslam_stage.simulation.angle_errors import ANGLE_ERRORS, AngleError, EncoderWalk
from tomoslam_stage.simulation.bodies import Solids
from tomoslam_stage.simulation.card import Card
from tomoslam_stage.simulation.detector import Camera, Detector, camera
from tomoslam_stage.simulation.phantoms import PHANTOMS, Phantom
from tomoslam_stage.simulation.placing import FIELD_RADIUS
from tomoslam_stage.simulation.sample_motions import SAMPLE_MOTIONS, SampleMotion
from tomoslam_stage.simulation.shadows import (
    Frame,
    line_integrals,
    magnified,
    projection_directions,
    slice_through,
)

GOLDEN = (np.sqrt(5) - 1) / 2
MARGIN = 4.0
"""px kept free at the sides of the detector, for the blur."""
FARTHEST = 3.0
"""Standard deviations of the shifts that are kept free there, too."""
SLICE_DIRECTIONS = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
"""A slice is a picture with columns along X and rows along Z, seen along Y."""

# What each stream of random numbers is for: projections come out the same in any order.
PATTERN, WHITES, DARKS, ANGLES, PROJECTIONS, MOTIONS, SHIFTS = range(7)

Order = Literal["sequential", "interlaced", "golden"]

TABLES: Mapping[str, Mapping[str, type[Any]]] = {
    "angle_errors": ANGLE_ERRORS,
    "sample_motions": SAMPLE_MOTIONS,
}
"""Field of a recipe that lists methods -> where they are named."""

Kind = TypeVar("Kind")


@method
class Recipe:
    """Everything that decides what a simulated scan looks like, to the last bit."""

    phantom: Phantom = field(default_factory=Card)
    """The object."""
    n_projections: Annotated[int, Field(ge=3)] = 360
    """Number of projections."""
    span_deg: Annotated[float, Field(gt=0)] = 360.0
    """Nominal angle between the first projection and the one after the last."""
    endpoint: bool = False
    """The last projection is at `span_deg` itself."""
    order: Order = "sequential"
    """``interlaced``: `passes` sweeps, each between the angles of the others; ``golden``: every
    step is the golden section of the span. Both fall back into the span: angles jump."""
    passes: Annotated[int, Field(ge=2)] = 4
    """Sweeps of an interlaced scan."""
    rows: Annotated[int, Field(ge=1)] = 256
    """Detector rows."""
    columns: Annotated[int, Field(ge=16)] = 320
    """Detector columns."""
    axis_offset: float = 0.0
    """px: the axis to the right of the middle of the detector."""
    roll_deg: Annotated[float, Field(gt=-10, lt=10)] = 0.0
    """Tilt of the axis in the detector plane."""
    shift_px: Annotated[float, Field(ge=0)] = 0.0
    """px: standard deviation of how far the sample jitters to the right, each projection alone."""
    angle_errors: tuple[AngleError, ...] = (EncoderWalk(),)
    """How the true angles differ from the nominal, recorded ones; they add up."""
    sample_motions: tuple[SampleMotion, ...] = ()
    """How the sample moves while it is turned, one after the other."""
    source_px: Annotated[float, Field(gt=0)] | None = None
    """px from the source of a cone beam to the axis; a parallel beam where not given."""
    detector: Detector = field(default_factory=Detector)
    """What records it."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Of noise, dust and angle errors; the phantom has its own."""

    @property
    def shape(self) -> tuple[int, int]:
        """Detector rows and columns."""
        return self.rows, self.columns

    @property
    def axis(self) -> float:
        """Detector column of the rotation axis in the middle row, px."""
        return (self.columns - 1) / 2 + self.axis_offset

    @property
    def field_radius(self) -> float:
        """px: what is nearer to the axis stays in view all the way round, in every row."""
        side = min(self.axis, self.columns - 1 - self.axis) - MARGIN
        leaning = abs(np.sin(np.deg2rad(self.roll_deg))) * (self.rows - 1) / 2
        return float(side - leaning - FARTHEST * self.shift_px)

    def described(self) -> dict[str, Any]:
        """Return the recipe in plain words and numbers, as `recipe_from` reads it."""
        plain = asdict(self)
        plain["phantom"] = {"method": _name(self.phantom, PHANTOMS), **plain["phantom"]}
        for key, table in TABLES.items():
            plain[key] = [
                {"method": _name(one, table), **parameters}
                for one, parameters in zip(getattr(self, key), plain[key], strict=True)
            ]
        return plain


@dataclass(frozen=True)
class SimulatedScan:
    """A scan and the truth about it; projections are made when they are asked for."""

    recipe: Recipe
    """What it was made from."""
    theta_recorded: Floats
    """(n,) radians: nominal angles, as the file will have them."""
    theta_true: Floats
    """(n,) radians: the angles at which the projections were taken."""
    whites: NDArray[np.uint16]
    """(white, row, column) counts of the open beam, taken before the scan."""
    darks: NDArray[np.uint16]
    """(dark, row, column) counts without light."""
    shift: Floats
    """(n,) px: how far to the right each projection shows the sample."""
    camera: Camera
    """The detector with its pattern."""
    solids: tuple[Solids, ...]
    """The object."""

    @property
    def axis(self) -> float:
        """Detector column of the rotation axis in the middle row, px."""
        return self.recipe.axis

    @property
    def shape(self) -> tuple[int, int, int]:
        """Projections, rows, columns."""
        return self.recipe.n_projections, *self.recipe.shape

    def projection(self, index: int) -> NDArray[np.uint16]:
        """(row, column) counts; the same ones whatever was asked for before."""
        rng = _random(self.recipe, PROJECTIONS, index)
        return self.camera.projection(self.line_integrals(index), rng)

    def projections(self) -> Iterator[NDArray[np.uint16]]:
        """Yield the counts (row, column) of one projection after the other."""
        return map(self.projection, range(self.recipe.n_projections))

    def line_integrals(self, index: int) -> Floats:
        """(row, column) exact line integrals, without blur and noise, at the true angle."""
        roll = np.deg2rad(self.recipe.roll_deg)
        directions = projection_directions(self.theta_true[index], roll)
        middle = self.axis + self.shift[index], (self.recipe.rows - 1) / 2
        solids: Iterable[Solids] = map(partial(self._moved, index), self.solids)
        if self.recipe.source_px is not None:
            solids = [magnified(group, directions, self.recipe.source_px) for group in solids]
        return line_integrals(solids, Frame(directions, middle, self.recipe.shape))

    def _moved(self, index: int, group: Solids) -> Solids:
        """Return `group` where the sample's motions have brought it."""
        when = index / (self.recipe.n_projections - 1)
        for number, motion in enumerate(self.recipe.sample_motions):
            group = motion.moved(group, when, _random(self.recipe, MOTIONS, number, index))
        return group

    def slice_at(self, row: float, size: int) -> Pixels:
        """(z, x) true attenuation per px at the height of `row` on the axis, `size` px wide."""
        middle = (size - 1) / 2
        frame = Frame(SLICE_DIRECTIONS, (middle, middle), (size, size))
        down = row - (self.recipe.rows - 1) / 2
        return slice_through(self.solids, frame, down).astype(np.float32)


def simulate(recipe: Recipe) -> SimulatedScan:
    """Set up the scan that `recipe` describes.

    Raises
    ------
    PipelineError
        If the axis lies so near to the edge of the detector that nothing could turn in view.
    """
    if recipe.field_radius <= 0:
        found = f"the axis at column {recipe.axis:.1f} px of {recipe.columns} leaves no room"
        raise PipelineError("recipe.axis_offset", f"{found} for an object.", "Move it inwards.")
    factor = recipe.field_radius / FIELD_RADIUS
    eye = camera(recipe.detector, recipe.shape, _random(recipe, PATTERN))
    nominal = nominal_angles(recipe)
    return SimulatedScan(
        recipe=recipe,
        theta_recorded=nominal,
        theta_true=_true_angles(recipe, nominal),
        shift=_random(recipe, SHIFTS).normal(0, recipe.shift_px, len(nominal)),
        whites=eye.whites(_random(recipe, WHITES)),
        darks=eye.darks(_random(recipe, DARKS)),
        camera=eye,
        solids=tuple(group.scaled(factor) for group in recipe.phantom.solids()),
    )


def nominal_angles(recipe: Recipe) -> Floats:
    """(n,) radians: the angles that were asked of the stage, in the order of the projections."""
    n, span = recipe.n_projections, np.deg2rad(recipe.span_deg)
    if recipe.order == "golden":
        return np.asarray(span * np.mod(np.arange(n) * GOLDEN, 1))
    theta = np.linspace(0, span, n, endpoint=recipe.endpoint)
    if recipe.order == "interlaced":
        return np.concatenate([theta[start :: recipe.passes] for start in range(recipe.passes)])
    return theta


def recipe_from(spec: Mapping[str, Any], where: str = "recipe") -> Recipe:
    """Make the recipe that plain words and numbers describe.

    ``{"phantom": "grains", "angle_errors": [{"method": "walk", "sigma_deg": 0.1}], "seed": 3}``

    Raises
    ------
    PipelineError
        For an unknown name or key, or a value that does not fit.
    """
    chosen = dict(spec)
    if "phantom" in chosen:
        chosen["phantom"] = build(PHANTOMS, chosen["phantom"], f"{where}.phantom")
    for key in TABLES.keys() & chosen.keys():
        listed = [build(TABLES[key], one, f"{where}.{key}") for one in chosen[key]]
        chosen[key] = tuple(listed)
    if "detector" in chosen:
        chosen["detector"] = checked(Detector, chosen["detector"], f"{where}.detector")
    return checked(Recipe, chosen, where)


def _true_angles(recipe: Recipe, nominal: Floats) -> Floats:
    """(n,) radians: each error disturbs the nominal angles, and what they do adds up."""
    errors = [
        error.disturb(nominal, _random(recipe, ANGLES, number)) - nominal
        for number, error in enumerate(recipe.angle_errors)
    ]
    return np.asarray(nominal + np.sum(errors, axis=0)) if errors else nominal


def _random(recipe: Recipe, *stream: int) -> np.random.Generator:
    return np.random.default_rng([recipe.seed, *stream])


def _name(chosen: Kind, table: Mapping[str, type[Kind]]) -> str:
    return next(name for name, cls in table.items() if cls is type(chosen))
