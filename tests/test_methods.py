from __future__ import annotations

from dataclasses import FrozenInstanceError, field
from typing import Annotated, Any, Protocol, runtime_checkable

import pytest
from pydantic import Field

from tomoslam_stage import errors
from tomoslam_stage.errors import PipelineError, ScanError, StageError, nearest
from tomoslam_stage.methods import build, checked, chosen_from, method, name_of


@runtime_checkable
class Brush(Protocol):
    def stroke(self) -> str: ...


@method
class Flat:
    width: Annotated[int, Field(ge=1)] = 3
    soft: bool = False

    def stroke(self) -> str:
        return "=" * self.width


@method
class Round:
    def stroke(self) -> str:
        return "o"


BRUSHES: dict[str, type[Brush]] = {"flat": Flat, "round": Round}


@method
class Mixer:
    speed: int = 1
    share: float | None = None


@method
class Painting:
    brush: Annotated[Brush, chosen_from(BRUSHES, "paint.brush")] = field(default_factory=Flat)
    sizes: tuple[Annotated[int, Field(ge=0)], ...] = ()
    mixer: Mixer = field(default_factory=Mixer)


def refused(action: Any, *args: Any) -> str:
    with pytest.raises(PipelineError) as caught:
        action(*args)
    return str(caught.value)


def test_a_method_is_made_from_its_name_alone() -> None:
    assert build(BRUSHES, "flat", "brush") == Flat(width=3, soft=False)


def test_a_method_is_made_from_its_name_and_parameters_which_stay_as_they_were() -> None:
    spec = {"method": "flat", "width": 5, "soft": True}
    assert build(BRUSHES, spec, "brush") == Flat(width=5, soft=True)
    assert spec == {"method": "flat", "width": 5, "soft": True}


def test_methods_cannot_be_changed_and_take_their_parameters_by_name() -> None:
    flat = Flat(width=4)
    with pytest.raises(FrozenInstanceError):
        flat.width = 5  # type: ignore[misc]
    with pytest.raises(Exception, match="Unexpected positional argument"):
        Flat(4)  # type: ignore[misc]


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("flta", "brush: no method 'flta'. Did you mean 'flat'?"),
        ("airbrush-7", "brush: no method 'airbrush-7'. Known: flat, round."),
        ({"width": 3}, "brush: no method None. Known: flat, round."),
        ({"method": ["flat"]}, "brush: no method ['flat']. Did you mean 'flat'?"),
        (
            {"method": "flat", "widht": 3},
            "brush.flat: no parameter 'widht'. Did you mean 'width'?",
        ),
        ({"method": "flat", 7: 3}, "brush.flat: no parameter 7. Known: soft, width."),
        (
            {"method": "flat", "width": 0},
            "brush.flat.width: 0 does not fit: Input should be greater than or equal to 1.",
        ),
        (
            {"method": "flat", "width": "wide"},
            "brush.flat.width: 'wide' does not fit: "
            "Input should be a valid integer, unable to parse string as an integer.",
        ),
    ],
)
def test_a_wrong_choice_is_answered_with_the_right_one(spec: Any, message: str) -> None:
    assert refused(build, BRUSHES, spec, "brush") == message


def test_the_place_of_a_wrong_value_in_a_list_is_said() -> None:
    message = refused(checked, Painting, {"sizes": [1, -2]}, "paint")
    assert message == (
        "paint.sizes.1: -2 does not fit: Input should be greater than or equal to 0."
    )


@pytest.mark.parametrize(
    ("parameters", "where"),
    [
        ({"sizes": [1, True]}, "paint.sizes.1"),
        ({"brush": {"method": "flat", "width": True}}, "paint.brush.flat.width"),
        ({"mixer": {"speed": False}}, "paint.mixer.speed"),
        ({"mixer": {"share": True}}, "paint.mixer.share"),
    ],
)
def test_a_switch_is_no_number(parameters: dict[str, Any], where: str) -> None:
    needed = "a switch (true, false, yes, no, on, off) does not fit; a number is needed."
    assert refused(checked, Painting, parameters, "paint") == f"{where}: {needed}"


def test_a_switch_is_a_switch_and_a_number_in_quotes_a_number() -> None:
    assert checked(Painting, {"brush": {"method": "flat", "soft": True}}, "paint").brush == Flat(
        soft=True
    )
    assert checked(Mixer, {"speed": "3", "share": ".5e-1"}, "mixer") == Mixer(speed=3, share=0.05)


def test_an_unknown_key_is_refused_though_the_others_are_wrong_too() -> None:
    message = refused(checked, Flat, {"width": "wide", "sfot": True}, "brush")
    assert message == "brush: no parameter 'sfot'. Did you mean 'soft'?"


@pytest.mark.parametrize("spec", ["round", {"method": "round"}, Round()])
def test_a_field_takes_the_name_of_a_method_or_the_method_itself(spec: Any) -> None:
    assert checked(Painting, {"brush": spec}, "paint").brush == Round()


def test_a_field_left_out_has_its_default() -> None:
    assert Painting().brush == Flat()


def test_a_wrong_method_in_a_field_is_answered_like_any_other() -> None:
    message = refused(checked, Painting, {"brush": {"method": "flat", "width": 0}}, "paint")
    assert message.startswith("paint.brush.flat.width: 0 does not fit: ")
    assert refused(checked, Painting, {"brush": "rond"}, "paint") == (
        "paint.brush: no method 'rond'. Did you mean 'round'?"
    )


def test_what_is_neither_a_name_nor_a_method_is_refused() -> None:
    message = refused(checked, Painting, {"brush": 5}, "paint")
    assert message.startswith("paint.brush: 5 does not fit: ")


def test_a_method_knows_its_name() -> None:
    assert [name_of(brush, BRUSHES) for brush in (Flat(width=9), Round())] == ["flat", "round"]


def test_an_error_says_where_what_and_what_to_do() -> None:
    assert str(ScanError("scan.h5", "no angles.", "Add them.")) == "scan.h5: no angles. Add them."
    assert str(ScanError("scan.h5", "no angles.")) == "scan.h5: no angles."


def test_each_kind_of_error_has_its_own_exit_code() -> None:
    codes = {kind.__name__: kind.exit_code for kind in StageError.__subclasses__()}
    assert codes == {"PipelineError": 2, "ScanError": 3, "BackendMissingError": 5}
    assert (errors.DONE, errors.BUG, StageError.exit_code, errors.KEPT) == (0, 1, 1, 4)


def test_nearest_names_the_likeliest_or_all_in_order() -> None:
    assert nearest("surff", ["sift", "surf"]) == "Did you mean 'surf'?"
    assert nearest("orb", ["surf", "kaze"]) == "Known: kaze, surf."
