"""The recipes of docs/libraries.md run as they stand, with fewer worlds and steps."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import sceniris_gym.adapters

PAGE = Path(__file__).parents[1] / "docs" / "libraries.md"
SECTIONS = (section.partition("\n") for section in PAGE.read_text().split("\n## ")[1:])
RECIPES = {name: re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0] for name, _, text in SECTIONS}
SMALLER = {
    "num_envs=4096": "num_envs=4, device='cpu'",
    "num_envs=64": "num_envs=4, device='cpu'",
    ", envs, 64)": ", envs, 6)",
    "learn(300)": "learn(2)",
    "learn(300 *": "learn(1 *",
    "timesteps=7200": "timesteps=30",
}


def test_every_library_has_a_recipe():
    """Those that the README names, and those that have an adapter."""
    named = {
        "rsl-rl",
        "Stable-Baselines3",
        "skrl",
        "Images with skrl",
        "TorchRL",
        "Your own training loop",
        "A policy on chosen layouts",
    }
    assert named <= set(RECIPES)
    programs = "\n".join(page.read_text() for page in PAGE.parent.glob("*.md"))
    adapters = [path.stem for path in Path(sceniris_gym.adapters.__path__[0]).glob("[!_]*")]
    assert len(adapters) >= 3
    assert not [name for name in adapters if f"from sceniris_gym.adapters.{name} import" not in programs]


@pytest.mark.slow
@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Of a library that is installed; some write logs to where they are."""
    program = RECIPES[name]
    for package in re.findall(r"^(?:from|import) (\w+)", program, re.MULTILINE):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    for before, after in SMALLER.items():
        program = program.replace(before, after)
    assert "4096" not in program
    exec(compile(program, name, "exec"), {})
