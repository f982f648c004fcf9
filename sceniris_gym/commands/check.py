"""The `check` command: reports whether a scene has valid layouts, and rejected candidates by object and cause."""

from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sceniris_gym.commands.answer import OK, verdict
from sceniris_gym.commands.narrowing import narrow
from sceniris_gym.commands.options import replay_command
from sceniris_gym.config.member_names import object_of
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import FallbackWarning, InfeasibleSceneError
from sceniris_gym.layout.blame import obstructions, recording
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.notices import noting

# The verdict is bad if a smaller share of layouts is valid, because the others repeat the layouts of the bank.
_LEAST_VALID = 0.5


def judge(config: SceneConfig, device: str | None, *options: Any, strict: bool = False) -> dict:
    """Compile a scene and return the findings of `check`, with the verdict.

    Args:
        config: The scene.
        device: Warp's name of the device. None takes "cuda:0" if available, otherwise "cpu".
        options: The arguments of `check` after the scene.
        strict: Whether a FallbackWarning makes the verdict bad.
    """
    with noting() as noted:
        try:
            found: dict = check(compile_scene(config, device), *options)
        except InfeasibleSceneError as error:
            counted = {"rejections": error.counts, "in_the_way": error.in_the_way}
            found = {"scene": config.name, "valid": 0.0, "error": str(error), **counted}
    often = strict and any(isinstance(warning, FallbackWarning) for warning in noted)
    return {OK: found["valid"] >= _LEAST_VALID and not often, **found}


def check(compiled: CompiledScene, layouts: int, seed: int, picture: Path | None = None, split: str = "train") -> dict:
    """Make layouts, and return the fraction of valid layouts and the rejections per object and cause.

    If `picture` is given, draw the places of objects into this file. If the scene has `reachable`, also measure which
    fraction of the places `reachable` permits.
    """
    generator = recording(LayoutGenerator(compiled, layouts, seed=seed, split=split))
    generator.generate()
    table = generator.table()
    return {
        "scene": compiled.config.name,
        "hash": compiled.hash,
        "first_id": compiled.layout_id(seed, 0, split),
        "layouts": layouts,
        "attempts": compiled.attempts,
        "valid": float(table.valid.mean()),
        "first_pass_valid": float(table.first_pass_valid.mean()),
        "attempts_per_layout": float(table.attempts.mean()),
        "rejections": generator.rejection_counts(),
        "in_the_way": obstructions(generator),
        **narrow(compiled, layouts, seed, picture, made=generator),
    }


def report(found: Mapping, scene: str, changes: Sequence[str] = ()) -> str:
    """Return the findings of `check` as text, with the command that draws a layout of the changed scene."""
    pairs = found["in_the_way"] if found["valid"] < 1.0 else {}
    collided = {label: [pairs[name] for name in names if name in pairs] for label, names in _alike(found["rejections"])}
    ways = [f"most in the way of {label}: {told[0]}" for label, told in collided.items() if told]
    if "error" in found:
        return "\n".join([verdict(found, found["error"]), table_of_rejections(found["rejections"]), *ways])
    valid = (
        f"{found['layouts']} layouts of '{found['scene']}': {found['valid']:.2%} valid, "
        f"{found['first_pass_valid']:.2%} on the first pass, {found['attempts_per_layout']:.2f} candidates per layout"
        f"{'' if found['rejections'] else ', but the scene has no object to place'}"
    )
    lines = [
        verdict(found, valid),
        f"each object gets {found['attempts']} attempts before a layout starts again",
        f"the first one is {found['first_id']}",
        table_of_rejections(found["rejections"]),
        *ways,
    ]
    reach = found.get("narrowing", {})
    for label, names in _folded({name: part["candidates"] > 0 for name, part in reach.items()}):
        kept, candidates = zip(*((reach[name]["kept"], reach[name]["candidates"]) for name in names), strict=True)
        ends = " to ".join(dict.fromkeys(f"{end(kept):.1%}" for end in (min, max)))
        lines.append(f"{label}: {ends} of {sum(candidates)} candidates are within reach")
    lines += [f"picture: {found['picture']}"] if "picture" in found else []
    return "\n".join([*lines, f"draw the first one: {replay_command(found['first_id'], scene, changes)}"])


def table_of_rejections(counts: Mapping[str, Mapping[str, int]]) -> str:
    """Return rejection counts as a table: a row for each object with some, a column for each cause.

    Variants of an object with the same most frequent cause share a row, `thing/can +2`.
    """
    causes = list(next(iter(counts.values()), {}))
    rows = {label: [sum(counts[name][cause] for name in names) for cause in causes] for label, names in _alike(counts)}
    if not rows:
        return "no candidate was rejected"
    width = max([14, *(len(label) + 1 for label in rows)])
    lines = [
        f"{label:<{width}}" + "".join(f"{n:>12}" for n in row) for label, row in {"rejected": causes, **rows}.items()
    ]
    return "\n".join(lines)


def _alike(counts: Mapping[str, Mapping[str, int]]) -> list[tuple[str, list[str]]]:
    """Return the objects with rejections, and fold variants of an object with the same most frequent cause."""
    return _folded({name: max(each, key=each.__getitem__) for name, each in counts.items() if any(each.values())})


def _folded(kinds: Mapping[str, Hashable]) -> list[tuple[str, list[str]]]:
    """Fold the variants of an object that are of one kind. Return a label and the names of each set of variants."""
    found: dict[Hashable, list[str]] = {}
    for name, kind in kinds.items():
        found.setdefault((object_of(name), kind), []).append(name)
    return [(f"{names[0]} +{len(names) - 1}".removesuffix(" +0"), names) for names in found.values()]
