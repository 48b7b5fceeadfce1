from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from typing import Any

import jsonschema
import pytest

from tomoslam_stage.comparison import Findings, Run, report
from tomoslam_stage.comparison.plain import as_json
from tomoslam_stage.products import Event, Rigidity, StageNoise

SCHEMA = json.loads((files("tomoslam_stage.comparison") / "report.schema.json").read_text())
CHECK = jsonschema.Draft202012Validator(SCHEMA)


def parts(schema: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """All named parts of an object, those of objects within it included."""
    here = list(schema.get("properties", {}).items())
    inner = [*here, ("items", schema["items"])] if "items" in schema else here
    return here + [found for _, part in inner for found in parts(part)]


@pytest.mark.parametrize("which", ["findings", "kept_findings", "complete"])
def test_reports_are_what_the_schema_says(
    which: str, run: Run, request: pytest.FixtureRequest
) -> None:
    CHECK.validate(report(request.getfixturevalue(which), run))


def test_a_report_of_events_and_of_nothing_known_are_what_the_schema_says(
    findings: Findings, tiny: Callable[[int], Findings], run: Run
) -> None:
    found = replace(
        findings.refinement,
        events=(Event(40, -1.5, 31.0, "lost step"),),
        stage_noise=StageNoise(1e-3, 1e-4),
        sources={"map": "used"},
        evidence=replace(
            findings.refinement.evidence, rigidity=Rigidity(321, 0.1, 9.0, -0.2, -3.0)
        ),
    )
    CHECK.validate(report(replace(findings, refinement=found), run))
    CHECK.validate(report(tiny(3), Run()))


def test_a_key_that_nobody_described_is_refused(findings: Findings, run: Run) -> None:
    made = report(findings, run) | {"novelty": 1}
    with pytest.raises(jsonschema.ValidationError, match="novelty"):
        CHECK.validate(made)


def test_the_schema_describes_every_key() -> None:
    CHECK.check_schema(SCHEMA)
    undescribed = [name for name, part in parts(SCHEMA) if not part.get("description")]
    assert undescribed == []
    assert len(parts(SCHEMA)) > 50


def test_lists_of_numbers_take_one_line_each(findings: Findings, run: Run) -> None:
    made = report(findings, run)
    made["theta"]["sigma_deg"][1] = None
    lines = as_json(made).decode().splitlines()
    assert len(lines) < 150
    assert json.loads("".join(lines)) == made
