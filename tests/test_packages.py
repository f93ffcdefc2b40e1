"""The container and the package of conda: what can be compared with pyproject.toml without building them."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import yaml  # type: ignore[import-untyped]

import workbench as wb

ROOT = Path(__file__).parents[1]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
RECIPE: dict[str, Any] = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8"))
CONDA = {"matplotlib": "matplotlib-base"}  # which brings no Qt


def lines_of(name: str) -> list[str]:
    return (ROOT / name).read_text(encoding="utf-8").splitlines()


def test_the_recipe_asks_for_what_pip_asks_for() -> None:
    wanted = [re.fullmatch(r"([\w-]+)(\[\w+\])?(.+)", text) for text in PROJECT["project"]["dependencies"]]
    named = {CONDA.get(found[1], found[1]): found[3] for found in wanted if found is not None}
    asked = dict(text.split(" ", 1) for text in RECIPE["requirements"]["run"])
    assert asked == {"python": PROJECT["project"]["requires-python"], **named}
    assert len(named) == len(PROJECT["project"]["dependencies"])


def test_the_recipe_is_of_this_version_and_licence() -> None:
    assert RECIPE["package"]["name"] == PROJECT["project"]["name"]
    assert RECIPE["context"]["version"] == wb.__version__
    assert RECIPE["about"]["license"] == PROJECT["project"]["license"]
    assert RECIPE["about"]["license_file"] == PROJECT["project"]["license-files"]
    assert f"python {PROJECT['project']['requires-python']}" in RECIPE["requirements"]["host"]


def test_an_image_is_built_from_all_that_a_wheel_is_made_of() -> None:
    wheel = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {"pyproject.toml", "hatch_build.py", PROJECT["project"]["readme"], *PROJECT["project"]["license-files"]}
    needed |= {*wheel["packages"], *wheel["force-include"]}
    lines = [line for line in lines_of(".dockerignore") if not line.startswith("#")]
    kept = [line.removeprefix("!") for line in lines if line.startswith("!")]
    assert lines[0] == "*"
    assert set(kept) == needed
    assert all((ROOT / name).exists() for name in kept)


def test_an_image_has_the_command_and_a_user_without_rights() -> None:
    lines = lines_of("Dockerfile")
    assert len([line for line in lines if line.startswith("FROM python:3.13-slim")]) == 2
    assert lines.index("USER workbench") > lines.index("RUN useradd --create-home workbench")
    (entry,) = re.findall(r'^ENTRYPOINT \["/opt/workbench/bin/(\w+)"\]$', lines[-1])
    assert entry in PROJECT["project"]["scripts"]
