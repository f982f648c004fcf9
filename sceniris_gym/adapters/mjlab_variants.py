"""Entities of mjlab with variants: layouts know a body for each variant, mjlab one for all, of another shape by world.

mjlab chooses variants once, when it is built. `VariantRows` writes what it would have written for others, by the same
function of mjlab, so that a world is simulated as if mjlab had chosen them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.errors import SceneMismatchError, import_extra
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene import assemble
from sceniris_gym.scene.parking import add_parking_ground, has_parking_ground
from sceniris_gym.scene.variants import MESH, check_variants

_VARIANTS: Any = import_extra("mjlab.entity.variants", "mjlab", "mjlab")
_FIELDS = ("geom_dataid", "geom_matid", *_VARIANTS.VARIANT_DEPENDENT_FIELDS)
_WORKED_OUT = ("body_subtreemass", "body_invweight0")
"""Fields that mjlab works out anew for all bodies when an event has changed some masses."""
_OF_WORLD = ("contype", "conaffinity", "condim", "priority", "solmix", "solref", "solimp", "friction", "margin", "gap")
_OF_SHAPE = ("size", "pos", "quat", "rbound", "aabb")


def model_of_variants(env: Any, entities: Mapping[str, Any], where: str) -> mujoco.MjModel:
    """Return the model of an environment in which each variant of some entities is a body, 'entity/variant'.

    Args:
        env: The environment.
        entities: mjlab's `VariantMetadata` of the entities by name.
        where: The beginning of errors.

    Raises:
        NotSupportedError: A variant has several bodies.
    """
    spec = env.scene.spec.copy()
    for name, info in entities.items():
        spec.delete(spec.body(_root(env, name).name))
        for element in (*spec.meshes, *spec.materials, *spec.textures):
            if element.name.startswith(f"{name}/"):
                spec.delete(element)
        for member, source in zip(_members(name, info), info.variant_source_specs, strict=True):
            child = source.copy()
            for key in child.keys:
                child.delete(key)
            root = assemble.attach(spec, child, member, spec.worldbody.add_frame(), where)
            assemble.make_kind(spec, root, member, "free", where)
    nobject = len(spec.bodies)  # at least
    if not has_parking_ground(assemble.compile_spec(spec, where), nobject, where):
        add_parking_ground(spec, nobject)
    mjm = assemble.compile_spec(spec, where)
    check_variants(spec, mjm, {name: tuple(_members(name, info)) for name, info in entities.items()}, where)
    env.sim.cfg.mujoco.apply(mjm)
    for name, info in entities.items():
        for member, given in zip(_members(name, info), info.variant_slot_specs, strict=True):
            filled = [slot for slot, own in zip(info.slots, given, strict=True) if own is not None]
            slots = [env.sim.mj_model.geom(f"{name}/{slot.template_geom_name}").id for slot in filled]
            _touch_as_in_mjlab(mjm, mjm.body(member).id, env.sim.mj_model, _root(env, name).id, slots)
    return mjm


def _members(name: str, info: Any) -> list[str]:
    return [f"{name}/{variant}" for variant in info.variant_names]


def _root(env: Any, name: str) -> Any:
    return env.sim.mj_model.body(env.scene.entities[name].indexing.root_body_id)


def _touch_as_in_mjlab(mjm: mujoco.MjModel, body: int, theirs: mujoco.MjModel, root: int, slots: list[int]) -> None:
    """Give the geoms of a variant what mjlab keeps the same in all worlds: contacts, and the shapes of primitives.

    Args:
        mjm: The model with a body for each variant, which is changed.
        body: The variant.
        theirs: mjlab's model.
        root: The body of all variants there.
        slots: Its geoms for the meshes of the variant, those that touch behind the others, as in mjlab.
    """
    meshes, solids = _geoms(mjm, body)
    touching = mjm.geom_contype[meshes] | mjm.geom_conaffinity[meshes] != 0
    meshes = meshes[np.argsort(touching, stable=True)]
    for fields, own, sources in ((_OF_WORLD, meshes, slots), (_OF_WORLD + _OF_SHAPE, solids, _geoms(theirs, root)[1])):
        for field in fields:
            getattr(mjm, f"geom_{field}")[own] = getattr(theirs, f"geom_{field}")[sources]


def _geoms(mjm: mujoco.MjModel, body: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the geoms of a body: meshes, and primitives."""
    return tuple(
        np.flatnonzero((mjm.geom_bodyid == body) & of) for of in (mjm.geom_type == MESH, mjm.geom_type != MESH)
    )


class VariantRows:
    """Writes the variants that layouts have into the model of mjlab, and the defaults that its `dr` starts from.

    Args:
        compiled: A scene in which objects have variants.
        env: The environment, whose entities they are.
    """

    def __init__(self, compiled: CompiledScene, env: Any) -> None:
        self._sim, theirs, variants = env.sim, env.sim.mj_model, compiled.config.variants
        infos = {name: env.scene.entities[name].variant_metadata for name in variants}
        assigned = [(f"{name}/", replace(info, assignment=_in_turn(info))) for name, info in infos.items()]
        nrow, configure = max(len(info.variant_names) for info in infos.values()), env.sim.cfg.mujoco.apply
        with wp.ScopedDevice(env.device):
            result = _VARIANTS.build_variant_model(env.scene.spec, nrow, assigned, configure_model=configure)
        self._total = torch.tensor(theirs.body_subtreemass[0], dtype=torch.float32, device=env.device)
        self._tables = []
        for name, info in infos.items():
            root, every, table = _root(env, name), _members(name, info), {}
            for field in _FIELDS:
                own = [root.id] if field.startswith("body") else np.concatenate(_geoms(theirs, root.id))
                at = torch.as_tensor(own, device=env.device)
                table[field] = at, wp.to_torch(getattr(result.wp_model, field))[:, at].clone()
            mass = [compiled.mjm.body(member).subtreemass.item() - root.subtreemass.item() for member in every]
            numbers = [(every.index(member), compiled.slots.index(member)) for member in variants[name]]
            number, column = torch.tensor(numbers, device=env.device).T
            self._tables.append((name, number, column, table, torch.tensor(mass, device=env.device)))

    def check(self) -> None:
        """Check that worlds have the variants that mjlab has chosen as it made them.

        Raises:
            SceneMismatchError: A startup event has changed one.
        """
        for name, _, _, table, _ in self._tables:
            for field, (own, rows) in table.items():
                held = getattr(self._sim.model, field)[:, own]
                if field not in _WORKED_OUT and not torch.equal(held, rows[self._sim.world_to_variant[name]]):
                    raise SceneMismatchError(
                        f"PlaceLayouts: startup events should leave model.{field} of the entity '{name}' alone: it has "
                        "variants, and a reset writes those of its layout. Let them change it in mode 'reset', listed "
                        "after PlaceLayouts."
                    )

    def write(self, layouts: Layouts, env_ids: Tensor) -> None:
        """Write the variants of the environments `env_ids`; the others keep every bit."""
        present, total = wp.to_torch(layouts.present)[env_ids], self._total
        for name, number, column, table, mass in self._tables:
            chosen = number[present[:, column].argmax(dim=1)]
            self._sim.world_to_variant[name][env_ids] = chosen
            for field, (own, rows) in table.items():
                self._put(field, (env_ids[:, None], own), rows[chosen])
            total = total + mass[chosen]
        self._put("body_subtreemass", (env_ids, 0), total)

    def _put(self, field: str, at: tuple, values: Tensor) -> None:
        getattr(self._sim.model, field)[at] = values
        if field in self._sim.per_world_default_fields:
            self._sim.default_model_fields[field][at] = values


def _in_turn(info: Any) -> Callable[[int], list[int]]:
    """Return the assignment of mjlab that gives worlds all variants of an entity in turn."""
    return lambda nworld: [i % len(info.variant_names) for i in range(nworld)]
