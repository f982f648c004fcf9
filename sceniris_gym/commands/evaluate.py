"""The `evaluate` command: evaluates a trained policy on unseen layouts."""

import warnings
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from shlex import quote
from typing import Any

from sceniris_gym.commands.answer import OK, verdict
from sceniris_gym.commands.options import Evaluation, replay_command
from sceniris_gym.errors import ArgumentError, ScenirisWarning
from sceniris_gym.files import as_json, check_picture, write_text
from sceniris_gym.scene.build import build_model
from sceniris_gym.training.judging import judge, judges_of
from sceniris_gym.training.runner import Policy
from sceniris_gym.training.settings import CONFIG, MODEL, read_config, read_parts, share, without_layouts
from sceniris_gym.training.task_scenes import hashes_of, scene_of, spec_of
from sceniris_gym.training.video import COLUMNS, PICTURES, filming


def evaluate(options: Evaluation) -> dict[str, Any]:
    """Evaluate the policy of a run on valid layouts and on unfiltered layouts, which are placed without checks.

    A ScenirisWarning reports that the scene or the source code of the task changed since the training.

    Args:
        options: The options. `task` is as `spec_of` takes it, or "" for the task that the folder names. That task
            should not be a MODULE:ID, because importing the module would execute its code. Without `min_success`, there
            is no verdict.

    Returns:
        The findings of `judge` for "valid" and for "unfiltered", without the result on each layout.

    Raises:
        ArgumentError: The folder holds no run. Or `task` is "" and the folder names a MODULE:ID. Or the checkpoint
            holds more than weights and `trust` is False.
        ScenirisError: The task is unknown, or its scene cannot be compiled.
    """
    run, failed, video = options.run, options.failed, options.video
    check_picture(video, ".mp4")
    named, settings = read_config(run)
    if ":" in named and not options.task:
        raise ArgumentError(f"{run / CONFIG}: its task is Python code. If you trust this code, give --task {named}.")
    task = options.task or named
    scene = build_model(scene_of(task, reachable=True))
    trained = {part: values.get("hash") for part, values in read_parts(run).items()}
    now = hashes_of(task, scene)
    changed = [part for part in now if trained.get(part) not in (None, now[part])]
    if changed:
        hashes = " and ".join(f"the {part} (hash {trained[part]}, now {now[part]})" for part in changed)
        warnings.warn(ScenirisWarning(f"{run}: {hashes} changed since the training. Train again."), stacklevel=2)
    shown = {} if video is None else {"render_mode": "rgb_array", "render_config": PICTURES}
    found = {}
    for name, env in judges_of(task, options.layouts, options.device, **shown).items():
        with filming(video, env.unwrapped) if video and name == "valid" else nullcontext(lambda _: None) as film:
            policy = Policy(run, task, settings, env, trust=options.trust)
            found[name] = judge(policy, env, task, options.layouts, film)
    if options.out is not None:
        write_text(options.out, as_json(found))
    least = options.min_success
    more: dict[str, Any] = {} if least is None else {OK: found["valid"]["success"] >= least}
    if failed is not None:
        each = found["valid"]["each"]
        ids = [name for name, success in zip(each["id"], each["success"], strict=True) if not success]
        write_text(failed, "".join(f"{name}\n" for name in ids))
        # `view` cannot play a policy that sees images
        played = "" if env.unwrapped.image_config is not None else f" --policy {quote(str(run / MODEL))}"
        where = task if ":" in task else spec_of(task).id
        view = f"sceniris-gym view --env {where}{played} --layout {quote(str(failed))} # extra viewer"
        own = scene.config.where if Path(scene.config.where).is_file() else None
        more |= {"view": view if ids else None, "replay": replay_command(str(failed), own) if ids else None}
    return more | without_layouts(found)


def report(found: Mapping[str, Any], options: Evaluation) -> str:
    """Return the success rates as text, one line per kind of layouts, the files, and commands to show the failures."""
    lines = [f"{n}: {share(found[n])} of {found[n]['layouts']:,} layouts" for n in ("valid", "unfiltered")]
    if OK in found:
        lines[0] = verdict(found, lines[0])
    layouts, success = found["valid"]["layouts"], found["valid"]["success"]
    counts = (
        (options.out, f"{layouts + found['unfiltered']['layouts']:,} layouts"),
        (options.failed, f"{layouts - round(success * layouts):,} ids"),
        (options.video, f"{min(COLUMNS**2, layouts)} worlds"),
    )
    if wrote := [f"{file} ({count})" for file, count in counts if file is not None]:
        lines.append(f"wrote {', '.join(wrote)}")
    if "view" in found:
        lines += [found["replay"], found["view"]] if found["view"] else ["All valid layouts ended in success."]
    return "\n".join(lines)
