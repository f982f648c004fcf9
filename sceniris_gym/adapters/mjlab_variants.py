"""Entities of mjlab with variants: layouts know a body for each variant, mjlab one for all, of another shape by world.

mjlab chooses variants once, when it is built. `VariantRows` writes what it would have written for others, by the same
function of mjlab, so that a world is simulated as if mjlab had chosen them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import mujoco
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
"""Fields that mjlab works out anew for all bodies when an event has changed some masses."""
_CONTACT = ("contype", "conaffinity", "condim", "priority", "solmix", "solref", "solimp", "friction", "margin", "gap")
_SHAPE = ("size", "pos", "quat", "rbound", "aabb")


def model_of_variants(env: Any, entities: Mapping[str, Any], where: str) -> mujoco.MjModel:
    """Return the model of an environment in which each variant of some entities is a body, 'entity/variant'.

    The entities' own bodies stay, without geoms, so that all else in the model has the addresses that it has in mjlab.

    Args:
        env: The environment.
        entities: Mjlab's `VariantMetadata` of the entities by name.
        where: The beginning of errors.

    Raises:
        NotSupportedError: A variant has several bodies.
    """
    spec, theirs = env.scene.spec.copy(), env.sim.mj_model
    for name, info in entities.items():
        root = spec.body(_root(env, name).name)
        root.explicitinertial, root.mass, root.inertia = True, 1.0, [1.0, 1.0, 1.0]
        for element in (*root.geoms, *spec.meshes, *spec.materials, *spec.textures):
            if element.name.startswith(f"{name}/"):
                spec.delete(element)
        for member, source in zip(_members(name, info), info.variant_source_specs, strict=True):
            child = source.copy()
            for key in child.keys:
                child.delete(key)
            body = assemble.attach(spec, child, member, spec.worldbody.add_frame(), where)
            assemble.make_kind(spec, body, member, "free", where)
    nobject = len(spec.bodies)  # at most
    if not has_parking_ground(assemble.compile_spec(spec, where), nobject, where):
        add_parking_ground(spec, nobject)
    mjm = assemble.compile_spec(spec, where)
    members = {name: tuple(_members(name, info)) for name, info in entities.items()}
    check_variants(spec, mjm, members, where)
    env.sim.cfg.mujoco.apply(mjm)
    for name in entities:
        slots = _geoms(theirs, _root(env, name).id)
        for member in members[name]:
            for (is_mesh, touches), own in _geoms(mjm, mjm.body(member).id).items():
                for field in _CONTACT if is_mesh else _CONTACT + _SHAPE:  # which mjlab has the same in all worlds
                    values = getattr(theirs, f"geom_{field}")[slots[is_mesh, touches][: len(own)]]
                    getattr(mjm, f"geom_{field}")[own] = values
    return mjm


def _members(name: str, info: Any) -> list[str]:
    return [f"{name}/{variant}" for variant in info.variant_names]


def _root(env: Any, name: str) -> Any:
    return env.sim.mj_model.body(env.scene.entities[name].indexing.root_body_id)


def _geoms(mjm: mujoco.MjModel, body: int) -> dict[tuple[bool, bool], list[int]]:
    """Return the geoms of a body by whether they are meshes and whether they touch: mjlab keeps the order of each."""
    found = defaultdict(list)
    for geom in (i for i in range(mjm.ngeom) if mjm.geom_bodyid[i] == body):
        touches = bool(mjm.geom_contype[geom] | mjm.geom_conaffinity[geom])
        found[bool(mjm.geom_type[geom] == MESH), touches].append(geom)
    return found


class VariantRows:
    """Writes the variants that layouts have into the model of mjlab, and the defaults that its `dr` starts from.

    Args:
        compiled: A scene in which objects have variants.
        env: The environment, whose entities they are.
    """

    def __init__(self, compiled: CompiledScene, env: Any) -> None:
        self._sim, theirs, variants = env.sim, env.sim.mj_model, compiled.config.variants
        infos = {name: env.scene.entities[name].variant_metadata for name in variants}
        nrow = max(len(info.variant_names) for info in infos.values())
        with wp.ScopedDevice(env.device):
            model = _VARIANTS.build_variant_model(
                env.scene.spec,
                nrow,
                [
                    (
                        f"{name}/",
                        replace(info, assignment=lambda n, m=len(info.variant_names): [i % m for i in range(n)]),
                    )
                    for name, info in infos.items()
                ],
                configure_model=env.sim.cfg.mujoco.apply,
            ).wp_model
        self._rows = {field: wp.to_torch(getattr(model, field)).clone() for field in _FIELDS}
        self._total = torch.tensor(theirs.body_subtreemass[0], dtype=torch.float32, device=env.device)
        self._entities = []
        for name, info in infos.items():
            root, every = _root(env, name), _members(name, info)
            parts = {"body": [root.id], "geom": sum(_geoms(theirs, root.id).values(), [])}
            mass = [compiled.mjm.body(member).subtreemass.item() - root.subtreemass.item() for member in every]
            numbers = [(every.index(member), compiled.slots.index(member)) for member in variants[name]]
            tensors = [torch.tensor(values, device=env.device) for values in (*parts.values(), mass, numbers)]
            self._entities.append((name, dict(zip(parts, tensors)), *tensors[2:]))

    def check(self) -> None:
        """Check that worlds have the variants that mjlab has chosen as it made them.

        Raises:
            SceneMismatchError: A startup event has changed one.
        """
        every = torch.arange(self._sim.num_envs, device=self._total.device)
        for name, parts, _, _ in self._entities:
            for field, at, values in self._values(parts, every, self._sim.world_to_variant[name]):
                if field not in _DERIVED and not torch.equal(getattr(self._sim.model, field)[at], values):
                    raise SceneMismatchError(
                        f"PlaceLayouts: startup events should leave model.{field} of the entity '{name}' alone: it has "
                        "variants, and a reset writes those of its layout. Let them change it in mode 'reset', listed "
                        "after PlaceLayouts."
                    )

    def write(self, layouts: Layouts, env_ids: Tensor) -> None:
        """Write the variants of the environments `env_ids`; the others keep every bit."""
        present, total = wp.to_torch(layouts.present)[env_ids], self._total
        for name, parts, mass, numbers in self._entities:
            chosen = numbers[present[:, numbers[:, 1]].argmax(dim=1), 0]
            self._sim.world_to_variant[name][env_ids] = chosen
            for field, at, values in self._values(parts, env_ids, chosen):
                self._put(field, at, values)
            total = total + mass[chosen]
        self._put("body_subtreemass", (env_ids, 0), total)

    def _values(self, parts: dict[str, Tensor], env_ids: Tensor, chosen: Tensor) -> Iterator[tuple[str, tuple, Tensor]]:
        """Yield the fields of an entity's variants, their places in the model, and what belongs there."""
        for field, rows in self._rows.items():
            own = parts[field[:4]]
            yield field, (env_ids[:, None], own), rows[chosen[:, None], own]

    def _put(self, field: str, at: tuple, values: Tensor) -> None:
        getattr(self._sim.model, field)[at] = values
        if field in self._sim.per_world_default_fields:
            self._sim.default_model_fields[field][at] = values
