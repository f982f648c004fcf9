"""Entities of mjlab with variants: layouts know a body for each variant, mjlab one for all, of another shape by world.

mjlab chooses variants once, when it is built. `VariantRows` writes what it would have written for others, by the same
function of mjlab, so that a world is simulated as if mjlab had chosen them.
"""

from __future__ import annotations

from collections.abc import Mapping
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


def entities_with_variants(env: Any) -> dict[str, Any]:
    """Return mjlab's metadata of the entities that have variants, by their names."""
    return {prefix.removesuffix("/"): info for prefix, info in env.scene.collect_variant_info()}


def model_of_variants(env: Any, entities: Mapping[str, Any], nobject: int, where: str) -> mujoco.MjModel:
    """Return the model of an environment in which each variant of some entities is a body, 'entity/variant'.

    Args:
        env: The environment.
        entities: The metadata of the entities by name.
        nobject: Number of objects of the scene, each variant being one.
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
        for variant, source in zip(info.variant_names, info.variant_source_specs, strict=True):
            member, child = f"{name}/{variant}", source.copy()
            for key in child.keys:
                child.delete(key)
            root = assemble.attach(spec, child, member, spec.worldbody.add_frame(), where)
            assemble.make_kind(spec, root, member, "free", where)
    mjm = assemble.compile_spec(spec, where)
    check_variants(spec, mjm, {name: tuple(_members(name, info)) for name, info in entities.items()}, where)
    if not has_parking_ground(mjm, nobject, where):
        add_parking_ground(spec, nobject)
        mjm = assemble.compile_spec(spec, where)
    env.sim.cfg.mujoco.apply(mjm)
    for name, info in entities.items():
        for i, member in enumerate(_members(name, info)):
            _touch_as_in_mjlab(mjm, mjm.body(member).id, env, name, info, i)
    return mjm


def _members(name: str, info: Any) -> list[str]:
    return [f"{name}/{variant}" for variant in info.variant_names]


def _root(env: Any, name: str) -> Any:
    return env.sim.mj_model.body(env.scene.entities[name].indexing.root_body_id)


def _geoms(mjm: mujoco.MjModel, body: int) -> np.ndarray:
    return np.flatnonzero(mjm.geom_bodyid == body)


def _touch_as_in_mjlab(mjm: mujoco.MjModel, body: int, env: Any, name: str, info: Any, variant: int) -> None:
    """Give the geoms of a variant what mjlab keeps the same in all worlds: contacts, and the shapes of primitives."""
    theirs, own = env.sim.mj_model, _geoms(mjm, body)
    touching = mjm.geom_contype[own] | mjm.geom_conaffinity[own] != 0
    meshes = own[np.lexsort((own, touching))]  # mjlab has those that touch behind the others
    meshes = meshes[mjm.geom_type[meshes] == MESH]
    filled = [s for s, given in zip(info.slots, info.variant_slot_specs[variant], strict=True) if given is not None]
    slots = [theirs.geom(f"{name}/{slot.template_geom_name}").id for slot in filled]
    solids, others = own[mjm.geom_type[own] != MESH], _geoms(theirs, _root(env, name).id)
    others = others[theirs.geom_type[others] != MESH]
    for fields, geoms, sources in ((_OF_WORLD, meshes, slots), (_OF_WORLD + _OF_SHAPE, solids, others)):
        for field in fields:
            getattr(mjm, f"geom_{field}")[geoms] = getattr(theirs, f"geom_{field}")[sources]


class VariantRows:
    """Writes the variants that layouts have into the model of mjlab, and the defaults that its `dr` starts from.

    Args:
        compiled: A scene in which objects have variants.
        env: The environment, whose entities they are.
    """

    def __init__(self, compiled: CompiledScene, env: Any) -> None:
        self._sim, theirs, full = env.sim, env.sim.mj_model, compiled.mjm
        infos = {name: entities_with_variants(env)[name] for name in compiled.config.variants}
        assigned = [
            (f"{name}/", replace(info, assignment=_in_turn(len(info.variant_names)))) for name, info in infos.items()
        ]
        nrow = max(len(info.variant_names) for info in infos.values())
        with wp.ScopedDevice(env.device):
            build, configure = _VARIANTS.build_variant_model, env.sim.cfg.mujoco.apply
            rows = build(env.scene.spec, nrow, assigned, configure_model=configure).wp_model
        self._total = torch.tensor(theirs.body_subtreemass[0], dtype=torch.float32, device=env.device)
        self._tables = []
        for name, members in compiled.config.variants.items():
            body, every = _root(env, name).id, _members(name, infos[name])
            elements = {"body": [body], "geom": _geoms(theirs, body).tolist()}
            table = {}
            for field in _FIELDS:
                own = torch.tensor(elements[field.partition("_")[0]], device=env.device)
                table[field] = own, wp.to_torch(getattr(rows, field))[:, own].clone()
            mass = full.body_subtreemass[[full.body(member).id for member in every]] - theirs.body_subtreemass[body]
            numbers = [[every.index(member), compiled.slots.index(member)] for member in members]
            number, column = torch.tensor(numbers, device=env.device).T
            self._tables.append(
                (name, number, column, table, torch.tensor(mass, dtype=torch.float32, device=env.device))
            )

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


def _in_turn(count: int) -> Any:
    """Return the assignment of mjlab that gives worlds all variants in turn."""
    return lambda nworld: [i % count for i in range(nworld)]
