from __future__ import annotations

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_every_folder_with_code_is_in_the_wheel() -> None:
    folders = {path.parent for path in (ROOT / "tomoslam_stage").rglob("__init__.py")}
    packages = {".".join(folder.relative_to(ROOT).parts) for folder in folders}
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == packages | {"tomoslam_stage.pipelines"}


def test_every_file_that_is_no_code_is_in_the_wheel() -> None:
    data = PROJECT["tool"]["setuptools"]["package-data"]
    for path in (ROOT / "tomoslam_stage").rglob("*"):
        if path.is_file() and path.suffix not in {".py", ".pyc"}:
            package = ".".join(path.parent.relative_to(ROOT).parts)
            assert any(path.match(pattern) for pattern in data.get(package, [])), path


def test_every_imported_package_is_a_dependency() -> None:
    declared = {name.split(">")[0] for name in PROJECT["project"]["dependencies"]}
    assert declared >= {"numpy", "scipy", "h5py", "gtsam", "finufft", "threadpoolctl", "pillow"}


def test_the_script_starts_what_the_module_starts() -> None:
    assert PROJECT["project"]["scripts"] == {"tomoslam-stage": "tomoslam_stage.cli:main"}
