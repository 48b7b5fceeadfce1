"""The pipelines that come with the package, and what a run says about the pipeline it ran."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from tomoslam_stage.entries import Entry
from tomoslam_stage.errors import BackendMissingError
from tomoslam_stage.methods import name_of
from tomoslam_stage.pipeline import check, described, load_pipeline, pipeline_names
from tomoslam_stage.reconstruction import ALGORITHMS
from tomoslam_stage.refinement.factors import FACTORS, Cv
from tomoslam_stage.stages import MODULES, STAGES, Stage
from tomoslam_stage.stages.refining import RefineTheta
from tomoslam_stage.tracks.detectors import DETECTORS, Surf
from tomoslam_stage.tracks.following import FOLLOWERS, Steps

FILES = sorted((Path(__file__).parents[1] / "pipelines").glob("*.yaml"))

TABLES: dict[str, tuple[str, dict[str, type[Any]]]] = {
    "detector": ("refine_theta", dict(DETECTORS)),
    "follower": ("refine_theta", dict(FOLLOWERS)),
    "algorithm": ("reconstruct", dict(ALGORITHMS)),
}
"""Parameter that takes a method by its name -> its stage, and the methods it may take."""

CHOICES = [(key, name) for key, (_, table) in TABLES.items() for name in table]

FACTOR_CHOICES: list[dict[str, Any]] = [
    {name: {} for name in FACTORS},
    {"prior": None, "encoder": None},
    {
        "prior": {"sigma_deg": 1e-6},
        "encoder": {"sigma_deg": 0.02, "robust": 2.5},
        "cv": {"correlated": False},
    },
]


def stated(name_or_path: str | Path) -> list[dict[str, Any]]:
    entries = load_pipeline(name_or_path)
    return [
        described(entry, stage)
        for entry, stage in zip(entries, check(entries, MODULES), strict=True)
    ]


def without_id(whole: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in whole.items() if key != "id"}


def parameters_of(key: str, chosen: Any) -> dict[str, Any]:
    return {"tracks": {key: chosen}} if key in ("detector", "follower") else {key: chosen}


def built(method: str, parameters: dict[str, Any]) -> tuple[Entry, Stage]:
    """Build an entry on its own, whatever it would need in a pipeline."""
    loose = {"load_scan": {}, "refine_theta": {}, "reconstruct": {}} | {method: parameters}
    module = "tomoslam_stage.stages"
    entries = [Entry(name, module, "test.yaml:1", given) for name, given in loose.items()]
    place = list(loose).index(method)
    return entries[place], check(entries, MODULES)[place]


def again(method: str, whole: dict[str, Any]) -> Stage:
    """Build what was described once more, from YAML."""
    parameters = yaml.safe_load(yaml.safe_dump(whole["parameters"]))
    return built(method, parameters)[1]


def test_there_are_pipelines_and_all_are_known_by_name() -> None:
    assert [path.stem for path in FILES] == pipeline_names()


@pytest.mark.usefixtures("stand_in_functions")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_pipeline_of_the_package_can_run(path: Path) -> None:
    stages = check(load_pipeline(path), MODULES)
    ours = [name_of(stage, STAGES) for stage in stages if type(stage) in STAGES.values()]
    assert ours == list(STAGES)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_pipeline_of_the_package_says_when_to_take_it(path: Path) -> None:
    first, second, *_ = path.read_text().splitlines()
    assert first.startswith(f"# {path.stem}: ")
    assert second.startswith("# ")
    assert "Take it" in path.read_text() or path.stem == "paper"


@pytest.mark.usefixtures("no_tomopy")
def test_a_pipeline_that_needs_tomopy_says_how_to_get_it() -> None:
    with pytest.raises(BackendMissingError) as caught:
        check(load_pipeline("stripes"), MODULES)
    assert caught.value.exit_code == 5
    assert str(caught.value).startswith("stripes.yaml:9: tomopy is needed ")
    assert "conda install -c conda-forge tomopy" in str(caught.value)


def test_the_default_pipeline_spells_out_exactly_the_defaults() -> None:
    entries = load_pipeline("default")
    bare = [Entry(e.method, e.module_path, e.where) for e in entries]
    defaults = [described(e, s) for e, s in zip(bare, check(bare, MODULES), strict=True)]
    assert [without_id(whole) for whole in stated("default")] == defaults


def test_the_default_pipeline_leaves_no_parameter_out() -> None:
    for entry, whole in zip(load_pipeline("default"), stated("default"), strict=True):
        assert dict(entry.parameters) == whole["parameters"]


def test_the_paper_pipeline_is_the_published_method() -> None:
    stages = check(load_pipeline("paper"), MODULES)
    refine = next(stage for stage in stages if isinstance(stage, RefineTheta))
    cv = refine.refinement.factors["cv"]
    assert isinstance(refine.tracks.detector, Surf)
    assert isinstance(refine.tracks.follower, Steps)
    assert refine.tracks.follower.steps_deg == refine.angles.steps_deg == (4, 5, 10)
    assert refine.angles.closed_form
    assert isinstance(cv, Cv)
    assert not cv.correlated
    assert refine.rounds == 1


@pytest.mark.usefixtures("stand_in_functions")
@pytest.mark.parametrize("name", pipeline_names())
def test_a_pipeline_as_run_is_a_pipeline_that_runs_the_same(name: str, tmp_path: Path) -> None:
    path = tmp_path / "as_run.yaml"
    path.write_text(yaml.safe_dump(stated(name)))
    assert check(load_pipeline(path), MODULES) == check(load_pipeline(name), MODULES)
    assert stated(path) == stated(name)


@pytest.mark.parametrize(("key", "name"), CHOICES)
@pytest.mark.parametrize("as_mapping", [False, True])
def test_a_chosen_method_is_described_by_the_name_that_chooses_it(
    key: str, name: str, as_mapping: bool
) -> None:
    method, table = TABLES[key]
    entry, stage = built(method, parameters_of(key, {"method": name} if as_mapping else name))
    whole = described(entry, stage)
    said = whole["parameters"].get("tracks", whole["parameters"])[key]
    assert said["method"] == name
    assert said.keys() == {"method", *table[name].__dataclass_fields__}
    assert again(method, whole) == stage


@pytest.mark.parametrize(
    ("method", "parameters"),
    [
        ("refine_theta", {"tracks": {"detector": {"method": "surf", "octaves": 2}}}),
        ("refine_theta", {"tracks": {"follower": {"method": "steps", "steps_deg": [2, 7.5]}}}),
        ("refine_theta", {"tracks": {"follower": {"method": "runs", "reach": 3}}}),
        ("refine_theta", {"axis": 31.25, "refinement": {"solver": {"settled_deg": 1e-7}}}),
        ("reconstruct", {"algorithm": {"method": "sirt", "iterations": 7}, "rows": [3, 1]}),
    ],
)
def test_values_other_than_the_defaults_are_described_and_come_back(
    method: str, parameters: dict[str, Any]
) -> None:
    entry, stage = built(method, parameters)
    assert stage != built(method, {})[1]
    assert again(method, described(entry, stage)) == stage


@pytest.mark.parametrize("factors", FACTOR_CHOICES)
def test_factors_are_described_by_the_names_that_choose_them(factors: dict[str, Any]) -> None:
    entry, stage = built("refine_theta", {"refinement": {"factors": factors}})
    whole = described(entry, stage)
    said = whole["parameters"]["refinement"]["factors"]
    assert list(said) == list(factors)
    for name, given in factors.items():
        assert said[name].keys() == set(FACTORS[name].__dataclass_fields__)
        assert said[name].items() >= (given or {}).items()
    assert again("refine_theta", whole) == stage
