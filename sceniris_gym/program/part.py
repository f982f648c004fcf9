"""A placement program for only some objects of a scene. All other bodies keep their current poses."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from sceniris_gym.config.variants import with_variants
from sceniris_gym.errors import ArgumentError, as_names, check_names
from sceniris_gym.program.compiled import CompiledScene, upload_plan
from sceniris_gym.program.placed_object import COS_MAX_TILT_32
from sceniris_gym.program.standing import carriers_of, chain_below
from sceniris_gym.scene.support import is_static

_FAR = float(np.finfo(np.float32).max)
# Trials of a single object in a round, as a multiple of its average number of trials. Few worlds need more. See
# benchmarks/NOTES.md.
_ENOUGH = 16.0
# Cosine of the greatest lean of a free support: soft contacts let stacks lean by up to 1.6 degrees.
_LEANING = float(np.cos(np.radians(2.0)))


def chosen_objects(
    compiled: CompiledScene, objects: str | Sequence[str], where: str, present: Sequence[str] | None = None
) -> tuple[str, ...]:
    """Return the names of the chosen objects and of all their variants, in placement order.

    Args:
        compiled: The scene.
        objects: Name of one object, or names of several objects. An object stands for all of its variants.
        where: Name of the calling function, as the beginning of errors.
        present: Names of the objects that are present in at least one world, or None if all may be. An object that is
            absent from all worlds need not be named together with its support.

    Raises:
        ArgumentTypeError: `objects` has values that are not names.
        ArgumentError: `objects` is empty, or leaves out an object that stands on a named object or shares its heap.
        UnknownNameError: The scene does not place an object of this name.
    """
    config = compiled.config
    given = as_names(objects, f"{where}: objects")
    names = with_variants(given, config.variants)
    valid = [name for name in compiled.placed if name in config.objects]
    named = list(dict.fromkeys(config.owners.get(name, name) for name in valid))
    check_names("placed object", given, where, named)
    if not names:
        raise ArgumentError(f"{where}: objects should name at least one object. Valid: {', '.join(named)}.")
    for name in valid:
        carrier, support = config.presence.carrier(name), config.objects[name].support
        if support is not None and carrier in names and name not in names and (present is None or name in present):
            load = config.owners.get(name, name)
            raise ArgumentError(f"{where}: '{support.parent}' carries '{load}', which moves along. Also name '{load}'.")
    for heap in config.heaps.values():
        left = [name for name in heap.of if name not in names]
        if left and len(left) < len(heap.of):
            raise ArgumentError(f"{where}: a heap is placed as a whole. Also name {', '.join(left)}.")
    return tuple(name for name in valid if name in names)


def _given(carriers: Sequence[int | None], chosen: Sequence[int]) -> list[int]:
    """Return the numbers of objects that are not chosen, but carry a chosen object or stand on such a carrier.

    An object that stands on a chosen object is never returned, because it is also chosen or absent.
    """
    found = {carrier for number in chosen for carrier in chain_below(number, carriers)[1:]}
    for number, carrier in enumerate(carriers):  # carriers come before their loads
        if carrier in found and carrier not in chosen:
            found.add(number)
    return sorted(found.difference(chosen))


def part_of(compiled: CompiledScene, names: Sequence[str]) -> CompiledScene:
    """Return the scene with a program that only places the named objects. Every other body is an obstacle.

    The caller gives the poses of all other bodies for each layout. Joints or physics may have tilted a support. No
    object is placed on a support while it is tilted.

    Free objects that carry a named object, and all other objects on these carriers, keep their poses. These objects
    still come first in the program, because the test of standing needs them.

    Args:
        compiled: The scene.
        names: Names of the objects, as `chosen_objects` returns them.
    """
    plan = compiled.plan
    chosen = [i for i, o in enumerate(plan.objects) if o.name in names]
    given = _given(carriers_of(plan.objects), chosen)
    numbers, still = [*given, *chosen], is_static(plan.scene.mjm)
    objects = [plan.objects[i] for i in numbers]
    # Only a static support or one placed by the same program is sure to be level. Heaps draw no points on a support.
    firm = [o.support is None or o.support.owner in names or still[o.support.body] for o in objects]
    objects = [o if is_firm or o.heap else replace(o, tilts=True) for o, is_firm in zip(objects, firm, strict=True)]
    for i, o in enumerate(objects[: len(given)]):  # given objects keep their poses, so their reach is not tested
        objects[i] = replace(o, config=o.config.model_copy(update={"reachable": False}))
    made = upload_plan(replace(plan, objects=objects), compiled.device, starts=False)
    program, whole = made.program, compiled.program
    program.ngroup, program.ngiven = 0, len(given)  # the present group members are already drawn
    carriers = {plan.objects[i].name for i in given}
    leans = [o.support is not None and o.support.owner in carriers for o in objects]
    program.obj_upright = wp.array(np.where(leans, _LEANING, COS_MAX_TILT_32), dtype=float, device=compiled.device)
    program.attempts, program.restart_rate = whole.attempts, whole.restart_rate
    program.obj_effort = wp.array(whole.obj_effort.numpy()[numbers], dtype=float, device=compiled.device)
    if len(names) == 1 and (made.reaching is None or not made.reaching.staged):
        # A restart with a single object only adds trials, so a round takes more trials and fewer restarts.
        program.attempts = max(whole.attempts, math.ceil(_ENOUGH * float(program.obj_effort.numpy()[0])))
        program.restarts = math.ceil(whole.attempts * (whole.restarts + 1) / program.attempts) - 1
    for bounds in (program.bound_qpos, program.bound_mocap):  # other bodies may have any finite pose
        bounds.fill_(_FAR)
    program.quat_qposadr = wp.zeros(0, dtype=int, device=compiled.device)
    return replace(made, conditions=None)
