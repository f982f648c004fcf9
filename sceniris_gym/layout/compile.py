"""`compile_scene`: the only way from host to device. Scenes that cannot be supported fail here, with a reason."""

from __future__ import annotations

import contextlib
import copyreg
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.config.messages import short
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.scene_words import AUTO
from sceniris_gym.device.kernel_log import start_warp
from sceniris_gym.device.launch_lock import launching
from sceniris_gym.errors import FallbackWarning, InfeasibleSceneError, SceneKeyError, UnknownNameError
from sceniris_gym.layout.attempts import find_attempts
from sceniris_gym.layout.blame import obstructions, recording
from sceniris_gym.layout.columns import BANKED
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Status
from sceniris_gym.layout.scene_cache import UNREADABLE, load_arrays, scene_key, store_arrays
from sceniris_gym.program.archive import from_arrays, to_arrays
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.program.device import Cause, Program, copied, fill_struct
from sceniris_gym.program.device_bank import Bank
from sceniris_gym.program.notices import from_words, noting, to_words, warn
from sceniris_gym.program.surfaces import UPRIGHT
from sceniris_gym.progress import tell
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel

# The probe makes layouts until the bank is full, in `_ROUNDS` at most; if one split has layouts and the other none yet,
# in `_MOST_ROUNDS`.
_ROUNDS = 8
_MOST_ROUNDS = 64
# A probe that has found nothing gives up after this many candidates. One that has found layouts, or that knows from the
# other split that there are some, goes on to `_MOST_DRAWN`. With the default words a round has 5,760 candidates.
_BUDGET = 200_000
_MOST_DRAWN = 20 * _BUDGET
# A scene gets a warning above this share of layouts from the bank, and this number: fewer say little of a small probe.
_MOST_FALLBACKS = 0.05
_FEWEST_FAILED = 3
# A kind of start that was drawn so often, and never made, is refused: its episodes would begin as those of other kinds.
_ENOUGH_TRIES = 8
# Objects on a support, from which on it is called too small for them.
_CROWD = 5
# Causes that only come up once all objects are placed.
_LATE = (Cause.NO_IK.name.lower(), Cause.BLOCKED.name.lower())
# Causes that end a layout without further attempts.
_AT_ONCE = (Cause.EMPTY, Cause.REGION, Cause.NO_IK, Cause.BLOCKED, Cause.UNSOUND)
# The entries of a file of the cache beside the scene.
_KEY, _WARNINGS = "key", "warnings"


@launching
def compile_scene(
    scene: str | Path | Mapping | SceneConfig | SceneModel, device: str | None = None, *, cache: bool = True
) -> CompiledScene:
    """Compile a scene for a device, prove that layouts of it can be made, and fill its bank of valid layouts.

    Where many worlds would get a layout from the bank, a FallbackWarning says how many, and what would help.

    Args:
        scene: A shipped scene's name, a path, a mapping, a SceneConfig, or a SceneModel.
        device: Warp's name of the device; None takes "cuda:0" if there is one, else "cpu".
        cache: Keep the result on disk and take it from there the next time, which is quicker and changes nothing else;
            see `scene_cache.cache_folder`.

    Raises:
        UnknownNameError: There is no such device.
        InfeasibleSceneError: No valid layout was found; the message says which object fails and why.
        SceneKeyError: No valid layout of a kind of `start` was found.
        ScenirisError: Something else is wrong with the scene; see `SceneConfig.load`, `build_model` and `upload_scene`.
    """
    start_warp()
    name = device_name(device)
    model = scene if isinstance(scene, SceneModel) else build_model(SceneConfig.load(scene))
    if not cache:
        return _compiled(model, name)
    key = scene_key(model, name)
    kept = _from_cache(key, model, name)
    if kept is not None:
        return kept
    with noting() as warned:
        compiled = _compiled(model, name)
    words = json.dumps([to_words(warning) for warning in warned])
    store_arrays(key, {**to_arrays(compiled), _KEY: np.array(key), _WARNINGS: np.array(words)})
    return compiled


copyreg.pickle(CompiledScene, lambda compiled: (compile_scene, (compiled.config, compiled.device)))


def device_name(device: Any, where: str = "compile_scene") -> str:
    """Return Warp's name of a device, given by name or as torch's or Warp's device; by default of its preferred one.

    Raises:
        UnknownNameError: There is no such device.
    """
    if device is None:
        return str(wp.get_preferred_device())
    try:
        return str(wp.get_device(str(device)))
    except (ValueError, RuntimeError):
        raise UnknownNameError("device", short(device).strip("'"), where, [d.alias for d in wp.get_devices()]) from None


def _compiled(model: SceneModel, device: str) -> CompiledScene:
    """Compile a scene without the cache."""
    compiled = upload_scene(model, device)
    if model.config.attempts == AUTO:
        compiled.program.attempts = find_attempts(compiled)
    return _with_bank(compiled)


def _from_cache(key: str, model: SceneModel, device: str) -> CompiledScene | None:
    """Return a compiled scene as it was stored, and repeat its warnings; None if it is not there."""
    arrays = load_arrays(key)
    with contextlib.suppress(*UNREADABLE):
        if arrays is not None and str(arrays[_KEY]) == key:
            compiled = from_arrays(model, device, arrays)
            for warning in [from_words(words) for words in json.loads(str(arrays[_WARNINGS]))]:
                warn(warning)
            return compiled
    return None


def _with_bank(compiled: CompiledScene) -> CompiledScene:
    """Return the scene with a bank for each split, made from streams of their own."""
    probed = _within_budget(compiled)
    train, evaluation = _Probe(probed, "train_bank"), _Probe(probed, "eval_bank")
    if not train.fill(_ROUNDS):
        raise _infeasible(probed, train.generator)
    if not evaluation.fill(_ROUNDS, _MOST_ROUNDS):  # layouts are rare, but there are some
        raise _infeasible(probed, evaluation.generator)
    tried, valid = train.starts + evaluation.starts
    for kind in np.flatnonzero((tried >= _ENOUGH_TRIES) & (valid == 0)):
        reason = f"should be possible, but none of its {tried[kind]} layouts was valid. Relax it, or raise 'restarts'."
        raise SceneKeyError(f"{compiled.config.where}: start.{kind}: {reason}")
    _warn_of_fallbacks(compiled, train, evaluation)
    columns = (np.stack(rows) for rows in zip(*train.found, *evaluation.found, strict=True))
    bank, program = Bank(), copied(Program, compiled.program)
    fill_struct(Bank, bank, dict(zip(BANKED, columns, strict=True)), compiled.device)
    bank.ntrain = len(train.found)
    # these two set how much is tried at once, and change no layout
    made, first = train.made + evaluation.made, train.first + evaluation.first
    program.restart_rate = (made - first + 0.5) / (made + 1.0)
    rejected = sum(probe.generator.layouts.rejections.numpy().sum(axis=1) for probe in (train, evaluation))
    program.obj_effort = wp.array(1.0 + rejected / made, dtype=float, device=compiled.device)
    return replace(compiled, program=program, bank=bank)


def _within_budget(compiled: CompiledScene) -> CompiledScene:
    """Return the scene with as many restarts for the probe as its budget has room for.

    The budget is a number of candidates and no time, so that a scene compiles everywhere or nowhere.
    """
    restarts = max(_BUDGET // (_probed_worlds(compiled) * compiled.attempts) - 1, 0)
    program = copied(Program, compiled.program)
    program.restarts = min(restarts, compiled.config.restarts)
    return replace(compiled, program=program)


def _probed_worlds(compiled: CompiledScene) -> int:
    """Return the number of worlds of the probe."""
    return min(compiled.config.bank, max(_BUDGET // compiled.attempts, 1))


class _Probe:
    """Makes layouts for one split's bank, records rejected candidates, and counts worlds that ran out of restarts."""

    def __init__(self, compiled: CompiledScene, split: str) -> None:
        self.size = compiled.config.bank
        self.generator = recording(LayoutGenerator(compiled, _probed_worlds(compiled), seed=0, split=split))
        self.found: list[tuple[np.ndarray, ...]] = []
        self.made = self.failed = self.first = 0
        self.starts = np.zeros((2, len(compiled.config.start)), int)  # worlds of each kind of start, and valid ones

    def fill(self, rounds: int, most: int = 0) -> bool:
        """Make layouts until the bank is full, for `rounds`, or `most` for a first one; return if there are any."""
        layouts, nworld = self.generator.layouts, self.generator.nworld
        rounds, most = (-(-number * self.size // nworld) for number in (rounds, most))
        done = drawn = 0
        while len(self.found) < self.size and done < (rounds if self.found else max(rounds, most)):
            if drawn > (_MOST_DRAWN if self.found or most > rounds else _BUDGET):
                break
            self.generator.generate()
            drawn += int(layouts.attempts.numpy().sum(dtype=np.int64))
            valid = layouts.status.numpy() == Status.VALID
            rows = [getattr(layouts, name).numpy()[valid] for name in BANKED]
            self.found += zip(*rows, strict=True)
            of_kind = layouts.start.numpy() == np.arange(self.starts.shape[1])[:, None]
            self.starts += [of_kind.sum(axis=1), (of_kind & valid).sum(axis=1)]
            self.made += nworld
            self.first += int(layouts.first_pass_valid.numpy().sum())
            self.failed += int(nworld - valid.sum())
            done += 1
            tell(self.generator.split.replace("_", " "), min(len(self.found), self.size), self.size)
        self.found = self.found[: self.size]
        return bool(self.found)


def _warn_of_fallbacks(compiled: CompiledScene, *probes: _Probe) -> None:
    """Warn of a scene whose worlds often get a layout from the bank, with the remedies."""
    failed = sum(probe.failed for probe in probes)
    share = failed / sum(probe.made for probe in probes)
    if share <= _MOST_FALLBACKS or failed < _FEWEST_FAILED:
        return
    # A restart takes as many rejections as there are attempts, but a single one if its cause ends a layout at once.
    weights = {
        (name, cause): n if Cause[cause.upper()] in _AT_ONCE else n / compiled.attempts
        for probe in probes
        for name, causes in probe.generator.rejection_counts().items()
        for cause, n in causes.items()
    }
    name, cause = max(weights, key=weights.__getitem__)
    config = compiled.config
    cures = [f"'restarts' above {config.restarts}"]
    if config.attempts != AUTO and Cause[cause.upper()] not in _AT_ONCE:
        cures.append(f"'attempts: {AUTO}'")
    cures.append(f"a larger region for '{name}'")
    found = min(len(probe.found) for probe in probes)
    held = (found, config.bank) if found < config.bank else None
    if held is None:
        cures.append(f"a 'bank' above {config.bank}, which repeats itself less often")
    warn(FallbackWarning(config.where, share, name, cause, cures, held))


def _infeasible(compiled: CompiledScene, probe: LayoutGenerator) -> InfeasibleSceneError:
    """Return the error that blames the last object ever tried: all before it could be placed, and stages come last."""
    counts = probe.rejection_counts()
    late = {name: {c: n for c, n in causes.items() if c in _LATE} for name, causes in counts.items()}
    tried = [(name, causes) for found in (counts, late) for name, causes in found.items() if any(causes.values())]
    name, causes = tried[-1]
    cause, part = max(causes, key=causes.__getitem__), compiled.config.parts.get(name)
    leaning = _leaning_support(compiled, probe, name) if cause == Cause.EMPTY.name.lower() else None
    orientation = None if leaning is None else compiled.config.objects[leaning.split("/")[0]].drawn_orientation.kind
    obstruction = obstructions(probe, name).get(name) if causes.get(Cause.COLLISION.name.lower()) else None
    return InfeasibleSceneError(
        compiled.config.where,
        name,
        cause,
        counts,
        leaning,
        orientation if orientation in ("any", "stable") else None,
        obstruction,
        None if part is None else part.joined_to,
        _room(compiled, name) if cause == Cause.COLLISION.name.lower() else None,
    )


def _room(compiled: CompiledScene, name: str) -> str | None:
    """Return the advice for a support that is full before all its objects are placed; None where that is not the case.

    Equal objects that are placed at random, one after another, fill a share of a large area that does not depend on its
    size (random sequential adsorption, Feder 1980), so the area that they need grows with their number. Those that were
    placed are counted in the luckiest of many worlds, and twice the area is what most worlds need.
    """
    (one,) = (o for o in compiled.plan.objects if o.name == name)
    crowd = [o.name for o in compiled.plan.objects if o.support is not None and o.support == one.support]
    placed = crowd.index(name) if name in crowd else 0
    if placed < _CROWD:
        return None
    area = sum(surface.outline.area for surface in one.surfaces[0])
    assert one.config.support is not None
    return (
        f"The {area:.3g} m2 of '{one.config.support.parent}' were full after {placed} of its {len(crowd)} objects; "
        f"about {2.0 * area * len(crowd) / placed:.2g} m2 would do."
    )


def _leaning_support(compiled: CompiledScene, probe: LayoutGenerator, name: str) -> str | None:
    """Return the name of an object's support, if that leans in most worlds as they were left."""
    ground = int(compiled.program.obj_ground.numpy()[compiled.placed.index(name)])
    part = compiled.config.parts.get(name)
    if ground < 0 or part is None or part.support is None:
        return None
    x, y = probe.layouts.view.body_quat.numpy()[:, ground, 1:3].T
    leans = 1.0 - 2.0 * (x * x + y * y) < UPRIGHT  # the z component of the body's z axis
    return part.support.parent if leans.mean() > 0.5 else None
