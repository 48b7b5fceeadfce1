"""Every option is described, and the schema takes what the pipelines that come with us say."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator

from tomoslam_stage import describing
from tomoslam_stage.cli import main
from tomoslam_stage.errors import PipelineError
from tomoslam_stage.methods import checked
from tomoslam_stage.stages import STAGES

PIPELINES = sorted((Path(__file__).parents[1] / "pipelines").glob("*.yaml"))
VALIDATOR = Draft202012Validator(describing.schema())


def options(said: dict[str, Any], place: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield all options below a section, by their place."""
    for name, option in describing._sections(said):
        if "default" in option or not dict(describing._sections(option)):
            yield f"{place}.{name}", option
        yield from options(option, f"{place}.{name}")


ALL = [pair for name, cls in STAGES.items() for pair in options(describing.of_method(cls), name)]


def test_there_are_options_at_every_depth() -> None:
    places = {place for place, _ in ALL}
    assert len(places) > 80
    assert {"refine_theta.tracks.detector.sift.keypoints", "reconstruct.algorithm.fbp.window"} <= (
        places
    )
    assert "refine_theta.refinement.factors.encoder.robust" in places


@pytest.mark.parametrize(("place", "option"), ALL, ids=[place for place, _ in ALL])
def test_every_option_has_a_default_and_says_what_it_is(place: str, option: Any) -> None:
    assert "default" in option, place
    assert option["description"].endswith("."), place
    kinds = {"type", "enum", "anyOf"} & option.keys()
    assert kinds, place


def test_the_schema_is_one_itself() -> None:
    Draft202012Validator.check_schema(describing.schema())


@pytest.mark.parametrize("path", PIPELINES, ids=[path.stem for path in PIPELINES])
def test_the_pipelines_that_come_with_us_follow_the_schema(path: Path) -> None:
    VALIDATOR.validate(yaml.safe_load(path.read_text()))


@pytest.mark.parametrize(
    ("parameters", "fits"),
    [
        ({"width": 64}, True),
        ({"width": 63}, False),
        ({"widht": 640}, False),
        ({"tracks": {"detector": "surf"}}, True),
        ({"tracks": {"detector": {"method": "surf", "octaves": 7}}}, False),
        ({"tracks": {"detector": "orb"}}, False),
        ({"mapping": None}, True),
        ({"tracks": None}, False),
        ({"axis": 12.5}, True),
        ({"axis": "left"}, False),
        ({"refinement": {"factors": {"encoder": {"robust": -1}}}}, False),
    ],
)
def test_the_schema_refuses_what_the_stage_refuses(parameters: Any, fits: bool) -> None:
    entry = {"method": "refine_theta", "module_path": "tomoslam_stage.stages"}
    assert VALIDATOR.is_valid([{**entry, "parameters": parameters}]) is fits
    try:
        checked(STAGES["refine_theta"], parameters, "refine_theta")
    except PipelineError:
        assert not fits
    else:
        assert fits


def test_a_reference_may_stand_for_any_parameter() -> None:
    entry = {"method": "refine_theta", "module_path": "tomoslam_stage.stages"}
    entry["parameters"] = {"axis": "${{centering.side_outputs.cor}}"}
    assert VALIDATOR.is_valid([entry])


def test_the_command_describes_entries_sections_and_options(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["describe", "refine_theta.mapping.rows"]) == 0
    assert "integer >= 4; default 32" in capsys.readouterr().out
    assert main(["describe", "load_scan"]) == 0
    said = capsys.readouterr().out
    assert "binning: integer >= 1; default 1" in said
    assert "parallel: boolean; default false" in said
    assert main(["describe"]) == 0
    assert all(name in capsys.readouterr().out for name in [*STAGES][:1])
    assert main(["describe", "--json-schema"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(describing.schema()))


def test_a_wrong_name_is_answered_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["describe", "refine_theat"]) == 2
    assert "Did you mean 'refine_theta'?" in capsys.readouterr().err
    assert main(["describe", "refine_theta.tracks.detektor"]) == 2
    assert "refine_theta.tracks has no 'detektor'. Did you mean 'detector'?" in (
        capsys.readouterr().err
    )
