"""`compile_scene`: the only function that takes a scene to a device. It rejects unsupported scenes with the reason."""

import contextlib
import copyreg
import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.config.fields import short
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.scene_words import AUTO
from sceniris_gym.device.kernel_log import start_warp
from sceniris_gym.device.random import SPLITS
from sceniris_gym.device.sequence import launching
from sceniris_gym.errors import FallbackWarning, UnknownNameError
from sceniris_gym.layout.attempts import find_attempts
from sceniris_gym.layout.blame import AT_ONCE, ended_restarts, infeasible, of_starts, recording
from sceniris_gym.layout.columns import BANKED
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus, column_of
from sceniris_gym.layout.scene_cache import UNREADABLE, from_arrays, load_arrays, scene_key, store_arrays, to_arrays
from sceniris_gym.layout.wave.ahead import launch_draw_ahead
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.program.device import Cause, Program, copied, fill_struct
from sceniris_gym.program.device_bank import Bank
from sceniris_gym.program.notices import from_record, noting, to_record, warn
from sceniris_gym.progress import tell
from sceniris_gym.scene.build import SceneLike, build_carriers, build_model
from sceniris_gym.scene.level_bodies import level_bodies
from sceniris_gym.scene.model import SceneModel

# The probe makes layouts until the bank is full, in at most `_ROUNDS` rounds. The second split gets up to
# `_MOST_ROUNDS` rounds for its first layout, because the first split proves that the scene has layouts.
_ROUNDS = 8
_MOST_ROUNDS = 64
# A probe without any layout gives up after this many candidates. With a layout, or with layouts in the other split, the
# limit is `_MOST_DRAWN`. With the default settings, a round draws 5,760 candidates.
_BUDGET = 200_000
_MOST_DRAWN = 20 * _BUDGET
# A scene gets a warning above this fraction of layouts from the bank, and from this number of failed worlds on: in a
# small probe, fewer failures prove little.
_MOST_FALLBACKS = 0.05
_FEWEST_FAILED = 3
# A choice is a present member of a group, such as a variant, or a kind of start. Compilation rejects a choice if all
# layouts with it fail, in `_ROUNDS` rounds of at least `_ALONE` worlds. Its weight in these rounds is `_FAVOUR` times
# its group's total, small enough that the other weights keep their bits.
_ALONE, _FAVOUR = 64, 2.0**20
# Entries of a cache file in addition to the arrays of the scene.
_KEY, _WARNINGS = "key", "warnings"


@launching
def compile_scene(
    scene: SceneLike, device: str | None = None, *, overrides: Mapping[str, Any] | None = None, cache: bool = True
) -> CompiledScene:
    """Compile a scene for a device, prove that it has valid layouts, and fill its bank with them.

    If many worlds would get a layout from the bank, a FallbackWarning reports the fraction and the remedies.

    Args:
        scene: A shipped scene's name, a path, a mapping, a SceneConfig, or a SceneModel.
        device: Warp's name of the device. None takes "cuda:0" if available, otherwise "cpu".
        overrides: Parts of the scene to replace, by dotted keys: {"objects.apple.clearance": 0.01}.
        cache: Store the result on disk and reuse it, which only saves time. See `scene_cache.cache_folder`.

    Raises:
        UnknownNameError: There is no such device.
        InfeasibleSceneError: No valid layout was found at all, or no valid layout with some variant, group member or
            kind of `start`. The message names this choice, the object that fails and the cause.
        ScenirisError: Another error in the scene. See `SceneConfig.load`, `build_model` and `upload_scene`.
    """
    start_warp()
    name = device_name(device)
    if not cache:
        return _compiled(build_model(scene, overrides), name)
    if not isinstance(scene, SceneModel):
        scene, overrides = _with_bodies(SceneConfig.load(scene, overrides), name), None
    model = build_model(scene, overrides)
    key = scene_key(model, name)
    if kept := _from_cache(key, model, name):
        return kept
    with noting() as warned:
        compiled = _compiled(model, name)
    records = json.dumps([to_record(warning) for warning in warned])
    store_arrays(key, {**to_arrays(compiled), _KEY: np.array(key), _WARNINGS: np.array(records)})
    return compiled


copyreg.pickle(CompiledScene, lambda compiled: (compile_scene, (compiled.config, compiled.device)))


def device_name(device: Any, where: str = "compile_scene") -> str:
    """Return Warp's name of a device, which is given by name, or as a torch or Warp device.

    None stands for Warp's preferred device.

    Raises:
        UnknownNameError: There is no such device.
    """
    if device is None:
        return str(wp.get_preferred_device())
    try:
        return str(wp.get_device(str(device)))
    except (ValueError, RuntimeError):
        none = "" if wp.is_cuda_available() else " (no GPU was found)"
        valid = [f"{found.alias}{none}" for found in wp.get_devices()]
        raise UnknownNameError("device", short(device).strip("'"), where, valid) from None


def _compiled(model: SceneModel, device: str) -> CompiledScene:
    """Compile a scene without the cache."""
    compiled = upload_scene(model, device)
    if model.config.attempts == AUTO:
        compiled.program.attempts = find_attempts(compiled)
    return _with_bank(compiled)


def _with_bodies(config: SceneConfig, device: str) -> SceneConfig:
    """Return a scene with the bodies of each support `{any: NAME}`. The cache keeps their names."""
    asked = {f"{word} {name}": (name, word) for name, word in config.any_supports}
    if not asked:
        return config
    carriers = build_carriers(config)
    key = scene_key(carriers, device)
    kept = load_arrays(key) or {}
    if not asked.keys() <= kept.keys():
        kept |= {label: np.array(level_bodies(carriers, *each)) for label, each in asked.items()}
        store_arrays(key, kept)
    return config.with_bodies({each: kept[label].tolist() for label, each in asked.items()})


def _from_cache(key: str, model: SceneModel, device: str) -> CompiledScene | None:
    """Return a compiled scene from the cache and repeat its warnings, or return None if the cache lacks it."""
    arrays = load_arrays(key)
    with contextlib.suppress(*UNREADABLE):
        if arrays is not None and str(arrays[_KEY]) == key:
            compiled = from_arrays(model, device, arrays)
            for warning in [from_record(record) for record in json.loads(str(arrays[_WARNINGS]))]:
                warn(warning)
            return compiled
    return None


def _with_bank(compiled: CompiledScene) -> CompiledScene:
    """Return the scene with a bank for each split. The banks come from separate random streams."""
    probed = _within_budget(compiled)
    train, evaluation = (_Probe(probed, split, compiled.config.bank) for split in ("train_bank", "eval_bank"))
    for probe, most in ((train, 0), (evaluation, _MOST_ROUNDS)):  # if train has layouts, eval has them, too, but rarely
        if not probe.fill(_ROUNDS, most):
            raise infeasible(probed, probe.generator)
    before = compiled.program.group_weight.numpy().copy()
    found = [_with_all_choices(probed, probe) for probe in (train, evaluation)]
    if (before != compiled.program.group_weight.numpy()).any():  # the first layouts were made with other weights
        return _with_bank(compiled)
    _warn_of_fallbacks(compiled, train, evaluation)
    columns = (np.stack(rows) for rows in zip(*found[0], *found[1], strict=True))
    program = copied(Program, compiled.program)
    # pyrefly: ignore[missing-argument]
    bank = fill_struct(Bank, Bank(), dict(zip(BANKED, columns, strict=True)), compiled.device)
    bank.ntrain = len(found[0])
    # these two numbers only tune the parallel search, and do not change layouts
    made, first = train.made + evaluation.made, train.first + evaluation.first
    program.restart_rate = (made - first + 0.5) / (made + 1.0)
    rejected = sum(probe.generator.layouts.view.rejections.numpy().sum(axis=1) for probe in (train, evaluation))
    program.obj_effort = wp.array(1.0 + rejected / made, dtype=float, device=compiled.device)
    return replace(compiled, program=program, bank=bank)


def _within_budget(compiled: CompiledScene) -> CompiledScene:
    """Return the scene with fewer restarts, so that filling the bank stays within the budget of candidates.

    The budget counts candidates rather than time, so that every computer accepts the same scenes.
    """
    restarts = max(_BUDGET // (_probed_worlds(compiled, compiled.config.bank) * compiled.attempts) - 1, 0)
    program = copied(Program, compiled.program)
    program.restarts = min(restarts, compiled.config.restarts)
    return replace(compiled, program=program)


def _probed_worlds(compiled: CompiledScene, size: int) -> int:
    """Return the number of worlds of a `_Probe` that should make `size` layouts."""
    return min(size, max(_BUDGET // compiled.attempts, 1))


class _Probe:
    """Makes layouts for the bank of one split, records rejected candidates, and counts worlds without a layout."""

    def __init__(self, compiled: CompiledScene, split: str, size: int) -> None:
        self.size = size
        self.generator = recording(LayoutGenerator(compiled, _probed_worlds(compiled, size), seed=0, split=split))
        self.found: list[tuple[np.ndarray, ...]] = []
        self.made = self.failed = self.first = 0
        if self.generator.size.busy > 1 and len(compiled.placed) > 1:
            self.generator._generate_graph[0].ahead = self._launch_with_ahead

    def _launch_with_ahead(self) -> None:
        """Launch the kernels of `generate`, and the kernel that most later generators also need."""
        self.generator._generate_graph[0].launches()
        launch_draw_ahead(self.generator._work)

    def fill(self, rounds: int, most: int = 0) -> list[tuple[np.ndarray, ...]]:
        """Make layouts until the bank is full, and return the rows of the bank.

        Stop after `rounds` rounds at the latest. However, if these rounds find no layout, continue until the first
        layout, but for at most `most` rounds in total. Also stop once too many candidates were drawn.
        """
        layouts, nworld = self.generator.layouts, self.generator.nworld
        rounds, most = (-(-number * self.size // nworld) for number in (rounds, most))
        drawn = 0
        while len(self.found) < self.size and self.made < nworld * (rounds if self.found else max(rounds, most)):
            if drawn > (_MOST_DRAWN if self.found or most > rounds else _BUDGET):
                break
            self.generator.generate()
            drawn += int(layouts.view.attempts.numpy().sum(dtype=np.int64))
            valid = layouts.view.status.numpy() == LayoutStatus.VALID
            self.found += zip(*(column_of(layouts, name).numpy()[valid] for name in BANKED), strict=True)
            self.made += nworld
            self.first += int(layouts.view.first_pass_valid.numpy().sum())
            self.failed += int(nworld - valid.sum())
            tell(self.generator.split.replace("_", " "), min(len(self.found), self.size), self.size)
        self.found = self.found[: self.size]
        return self.found


def _with_all_choices(compiled: CompiledScene, probe: _Probe) -> list[tuple[np.ndarray, ...]]:
    """Return the rows of a split's bank, with added rows for the choices that no row has yet.

    A choice is a group member, a variant, or a kind of start. A new probe favours all missing choices together. If the
    probe finds none of them, the next probe favours only the first missing choice. A spare choice gets one round then.
    If it has no layout, its weight becomes 0.

    Raises:
        InfeasibleSceneError: There is a choice without a valid layout that cannot be left out.
    """
    config, split, rows, alone = compiled.config, probe.generator.split, list(probe.found), False
    while (number := len(missing := _lacking_choices(compiled, split, rows))) > 0:
        asked = missing[:1] if alone else missing
        other = _Probe(_favouring(compiled, asked), split, max(_ALONE, len(asked)))
        spare = len(asked) == 1 and _is_spare(compiled, asked[0])
        rows += other.fill(1, 1) if spare else other.fill(_ROUNDS - 1, _ROUNDS)
        left = _lacking_choices(compiled, split, rows)
        if len(asked) == 1 and asked[0] in left:
            if not spare:
                members = [config.key(compiled.slots[slot]) for slot in compiled.program.group_slot.numpy()]
                key = [*members, *(f"start.{kind}" for kind in range(len(config.start)))][asked[0]]
                raise infeasible(compiled, other.generator, f": {key}")
            weight = compiled.program.group_weight.numpy()
            weight[:, asked[0]] = 0.0
            compiled.program.group_weight.assign(weight)
        alone = len(left) == number
    if len(rows) > len(probe.found):  # spread by the golden ratio, since a world takes the next row that fits
        rows = [rows[i] for i in np.argsort(np.arange(len(rows)) * (0.5 + 0.5 * 5.0**0.5) % 1.0, kind="stable")]
    return rows


def _is_spare(compiled: CompiledScene, choice: int) -> bool:
    """Return whether a choice is one of several bodies of `{any: NAME}`, so that layouts may leave it out."""
    config, keys = compiled.config, compiled.config.presence.member_keys
    drawn = {key for key, both in zip(keys, compiled.program.group_weight.numpy()[0], strict=True) if both.any()}
    return choice < len(keys) and not drawn.isdisjoint(config.alternatives(keys[choice]))


def _lacking_choices(compiled: CompiledScene, split: str, rows: list[tuple[np.ndarray, ...]]) -> np.ndarray:
    """Return the numbers of the choices that a split may draw, but that no row has.

    First all group members are numbered, and then all kinds of start. A split never draws a member whose presence
    implies a member that it never draws.
    """
    program, kinds = compiled.program, np.arange(len(compiled.config.start))
    present, start = (np.stack([row[BANKED.index(name)] for row in rows]) for name in ("present", "start"))
    group, weight = program.group.numpy()[0], program.group_weight.numpy()[0, :, SPLITS[split] % 2]
    never = weight * np.repeat(group[:, 3], group[:, 1]) == 0.0
    presence = compiled.config.presence
    barred = {key for key, is_never in zip(presence.member_keys, never, strict=True) if is_never}
    never = np.array([not barred.isdisjoint(presence.must(key)) for key in presence.member_keys], bool)
    return np.flatnonzero(~np.append(never | present[:, program.group_slot.numpy()].any(axis=0), np.isin(kinds, start)))


def _with_needs(compiled: CompiledScene, choices: np.ndarray) -> np.ndarray:
    """Return choices, followed by the group members whose presence they imply."""
    presence = compiled.config.presence
    keys = presence.member_keys
    needed = set().union(*(presence.must(keys[i]) for i in choices if i < len(keys)))
    return np.array([*choices, *(i for i, key in enumerate(keys) if key in needed and i not in choices)], int)


def _favouring(compiled: CompiledScene, choices: np.ndarray) -> CompiledScene:
    """Return the scene with weights that favour these choices.

    If some members of a group are favoured, nearly every layout then has one of these members. The same holds for
    favoured kinds of start.
    """
    made = copied(Program, compiled.program)
    choices = _with_needs(compiled, choices)
    group, weight = made.group.numpy()[0].copy(), made.group_weight.numpy()[0].copy()
    members, kinds = choices[choices < len(weight)], choices[choices >= len(weight)] - len(weight)
    owner = np.repeat(np.arange(len(group)), group[:, 1])[members]
    weight[members] = _FAVOUR * np.add.reduceat(weight, group[:, 0])[owner]
    group[owner, 2] = np.maximum(group[owner, 2], 1)
    of_kinds = made.start_weight.numpy()[0].copy()
    of_kinds[kinds] = _FAVOUR * of_kinds.sum()
    fields = {"group": group, "group_weight": weight, "group_uniform": 0 * group[:, 0], "start_weight": of_kinds}
    fill_struct(Program, made, fields, compiled.device)
    return replace(compiled, program=made)


def _warn_of_fallbacks(compiled: CompiledScene, *probes: _Probe) -> None:
    """Warn if worlds often get a layout from the bank, and name remedies."""
    failed = sum(probe.failed for probe in probes)
    share = failed / sum(probe.made for probe in probes)
    if share <= _MOST_FALLBACKS or failed < _FEWEST_FAILED:
        return
    weights: dict[tuple[str, str], float] = {}
    for name, causes in (part for probe in probes for part in probe.generator.rejection_counts().items()):
        for cause, n in causes.items():
            weights[name, cause] = weights.get((name, cause), 0.0) + ended_restarts(cause, n, compiled.attempts)
    name, cause = max(weights, key=weights.__getitem__)
    config = compiled.config
    cures = [f"'restarts' above {config.restarts}"]
    if config.attempts != AUTO and Cause[cause.upper()] not in AT_ONCE:
        cures.append(f"'attempts: {AUTO}'")
    cures += [*of_starts(config, name, cause), f"a larger region for '{name}'"]
    cures += [f"a wider '{relation.summary}'" for relation in getattr(config.parts.get(name), "relations", ())]
    found = min(len(probe.found) for probe in probes)
    held = (found, config.bank) if found < config.bank else None
    if held is None:
        cures.append(f"a 'bank' above {config.bank}, which repeats itself less often")
    few = "" if held is None else f" No more layouts were found, so the bank holds {held[0]} of {held[1]}."
    text = (
        f"{config.where}: {share:.0%} of the worlds run out of restarts and get a layout from the bank, mostly because "
        f"of '{name}' ({cause}).{few} Try {', or '.join(cures)}."
    )
    warn(FallbackWarning(text, share, name, cause, held))
