"""mjlab's entities with variants. Layouts have a body for each variant, but in mjlab each entity has a single body.

The geoms of this body differ between worlds. mjlab chooses the variant of each world once, when it builds the
simulation. At resets, `VariantRows` gives worlds other variants. It takes their model fields from mjlab's function for
building variants, so a world is simulated as if mjlab had chosen these variants.
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
_DERIVED = ("body_subtreemass", "body_invweight0")
"""Fields that mjlab recomputes for all bodies after an event has changed masses."""
_CONTACT = ("contype", "conaffinity", "condim", "priority", "solmix", "solref", "solimp", "friction", "margin", "gap")
_SHAPE = ("size", "pos", "quat", "rbound", "aabb")


def model_of_variants(env: Any, entities: Mapping[str, Any], where: str) -> mujoco.MjModel:
    """Return the model of an environment with a body 'entity/variant' for each variant of some entities.

    The original bodies of the entities stay, without geoms, so the rest of the model keeps its addresses in mjlab.

    Args:
        env: The environment.
        entities: mjlab's `VariantMetadata` of the entities by name.
        where: The beginning of error messages.

    Raises:
        NotSupportedError: A variant has several bodies.
    """
    spec, theirs = env.scene.spec.copy(), env.sim.mj_model
    for name, info in entities.items():
        root = spec.body(_root(env, name).name)
        root.explicitinertial, root.mass, root.inertia = True, 1.0, [1.0, 1.0, 1.0]
        assets = [a for a in (*spec.meshes, *spec.materials, *spec.textures) if a.name.startswith(f"{name}/")]
        for element in (*root.geoms, *assets):
            spec.delete(element)
        for member, source in zip(_members(name, info), info.variant_source_specs, strict=True):
            body = assemble.attach(spec, source.copy(), member, spec.worldbody.add_frame(), where)
            assemble.make_kind(spec, body, member, "free", where)
    nobject = len(spec.bodies)  # at most
    if not has_parking_ground(assemble.compile_spec(spec, where), nobject, where):
        add_parking_ground(spec, nobject)
    mjm = assemble.compile_spec(spec, where)
    members = {name: tuple(_members(name, info)) for name, info in entities.items()}
    check_variants(spec, mjm, members, where, jointed=False)
    env.sim.cfg.mujoco.apply(mjm)
    for name, info in entities.items():
        for member, given in zip(members[name], info.variant_slot_specs, strict=True):
            filled = [slot for slot, own in zip(info.slots, given, strict=True) if own is not None]
            slots = [theirs.geom(f"{name}/{slot.template_geom_name}").id for slot in filled]
            _touch_as_in_mjlab(mjm, mjm.body(member).id, theirs, _root(env, name).id, slots)
    return mjm


def _members(name: str, info: Any) -> list[str]:
    return [f"{name}/{variant}" for variant in info.variant_names]


def _root(env: Any, name: str) -> Any:
    return env.sim.mj_model.body(env.scene.entities[name].indexing.root_body_id)


def _touch_as_in_mjlab(mjm: mujoco.MjModel, body: int, theirs: mujoco.MjModel, root: int, slots: list[int]) -> None:
    """Copy mjlab's contact settings to all geoms of a variant, and mjlab's sizes and poses to its primitive geoms.

    In mjlab, these fields are the same in all worlds, whatever the variant.
    """
    (meshes, others), primitives = _geoms(mjm, body), _geoms(theirs, root)[1]
    for fields, own, sources in ((_CONTACT, meshes, slots), (_CONTACT + _SHAPE, others, primitives)):
        for field in fields:
            getattr(mjm, f"geom_{field}")[own] = getattr(theirs, f"geom_{field}")[sources]


def _geoms(mjm: mujoco.MjModel, body: int) -> tuple[list[int], list[int]]:
    """Return two lists of a body's geoms: the meshes (colliding meshes last, as in mjlab), and the primitives."""
    own = np.flatnonzero(mjm.geom_bodyid == body).tolist()
    meshes = [geom for geom in own if mjm.geom_type[geom] == MESH]
    meshes.sort(key=lambda geom: bool(mjm.geom_contype[geom] | mjm.geom_conaffinity[geom]))
    return meshes, [geom for geom in own if mjm.geom_type[geom] != MESH]


class VariantRows:
    """Writes the variants of layouts into mjlab's model, and into the default values of mjlab's domain randomization.

    Args:
        compiled: The scene. If it has no variants, the methods have no effect.
        env: The environment with the entities.
    """

    def __init__(self, compiled: CompiledScene, env: Any) -> None:
        self._sim, self._total, self._entities = env.sim, env.sim.mj_model.body_subtreemass[0], []
        for name, members in compiled.config.variants.items():
            info, root = env.scene.entities[name].variant_metadata, _root(env, name)
            every = _members(name, info)
            with wp.ScopedDevice(env.device):
                model = _VARIANTS.build_variant_model(
                    *(env.scene.spec, len(every), [(f"{name}/", replace(info, assignment=range))]),
                    configure_model=env.sim.cfg.mujoco.apply,
                ).wp_model
            geoms = np.flatnonzero(env.sim.mj_model.geom_bodyid == root.id)
            table = {}
            for field in _FIELDS:
                own = torch.as_tensor(geoms if field.startswith("geom") else [root.id], device=env.device)
                table[field] = own, wp.to_torch(getattr(model, field))[:, own].clone()
            mass = [compiled.mjm.body(member).subtreemass.item() - root.subtreemass.item() for member in every]
            numbers = [(every.index(member), compiled.slots.index(member)) for member in members]
            tensors = (torch.tensor(values, device=env.device) for values in (mass, numbers))
            self._entities.append((name, table, *tensors))

    def check(self) -> None:
        """Check that the model fields of the variants have mjlab's original values.

        Raises:
            SceneMismatchError: A startup event has changed a field.
        """
        for name, table, _, _ in self._entities:
            for field, (own, rows) in table.items():
                held, made = getattr(self._sim.model, field)[:, own], rows[self._sim.world_to_variant[name]]
                if field not in _DERIVED and not torch.equal(held, made):
                    raise SceneMismatchError(
                        f"PlaceLayouts: startup events should not change model.{field} of the entity '{name}', because "
                        "resets overwrite this field with values of the next variant. List such events after "
                        "PlaceLayouts, in mode 'reset'."
                    )

    def write(self, layouts: Layouts, env_ids: Tensor) -> None:
        """Write the variants of the environments `env_ids`. Other environments keep every bit."""
        if not self._entities:
            return
        present = layouts.present[env_ids]
        total = torch.full((len(env_ids),), self._total, dtype=torch.float32, device=env_ids.device)
        for name, table, mass, numbers in self._entities:
            chosen = numbers[present[:, numbers[:, 1]].argmax(dim=1), 0]
            self._sim.world_to_variant[name][env_ids] = chosen
            for field, (own, rows) in table.items():
                self._put(field, (env_ids[:, None], own), rows[chosen])
            total += mass[chosen]
        self._put("body_subtreemass", (env_ids, 0), total)

    def _put(self, field: str, at: tuple, values: Tensor) -> None:
        getattr(self._sim.model, field)[at] = values
        if field in self._sim.per_world_default_fields:
            self._sim.default_model_fields[field][at] = values
