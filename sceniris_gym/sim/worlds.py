"""`make_worlds`: Model and Data of many worlds, for your own loop."""

from collections.abc import Sequence

import mujoco_warp as mjw
import warp as wp

from sceniris_gym.errors import as_names, check_type
from sceniris_gym.layout.masks import as_count
from sceniris_gym.program.checks.simulation import put_simulated
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.draws import drawn_fields
from sceniris_gym.scene.field_table import check_field
from sceniris_gym.sim.budget import default_budget
from sceniris_gym.sim.model_fields import NAMED, widen, with_followers
from sceniris_gym.sim.variants import fields_of_variants


def make_worlds(
    compiled: CompiledScene,
    nworld: int,
    *,
    fields: str | Sequence[str] = (),
    nconmax: int | None = None,
    njmax: int | None = None,
) -> tuple[mjw.Model, mjw.Data]:
    """Return Model and Data of `compiled.sim_mjm`, on the device of the scene.

    A field of the Model has a row for each world if `fields` names it, if the scene randomizes it, if variants differ
    in it, or if it is derived from such a field.

    Args:
        compiled: The compiled scene.
        nworld: Number of worlds.
        fields: Names of fields that you will write per world, such as "body_mass". See `ResetRandomizer.model_field`.
        nconmax: Contacts per world. None leaves room for a busy scene. The number grows with the geoms at the
            bottom of each object. For an object with `orientation: stable`, or one that may fall, the bottom is the
            side with the most geoms. Of an object with variants, the variant with the most bottom geoms counts.
        njmax: Constraint rows per world. None leaves room for a busy scene.

    Raises:
        ArgumentTypeError: `compiled` is not a CompiledScene.
        ArgumentError: `nworld`, `nconmax` or `njmax` is not a positive integer, or steps do not read one of the fields.
        UnknownNameError: A field does not exist, or layouts depend on it.
        NotSupportedError: MuJoCo-Warp cannot simulate the model.
    """
    check_type(compiled, CompiledScene, "make_worlds: compiled")
    nworld, fields = as_count(nworld, "make_worlds: nworld"), as_names(fields, "make_worlds: fields")
    for name in fields:
        check_field(name, compiled.sim_mjm, "make_worlds")
    contacts, rows = default_budget(compiled.sim_mjm, compiled.scene)
    nconmax = contacts if nconmax is None else as_count(nconmax, "make_worlds: nconmax")
    njmax = rows if njmax is None else as_count(njmax, "make_worlds: njmax")
    drawn, shared = drawn_fields(compiled.scene.sim.draws), fields_of_variants() if compiled.config.variants else ()
    with wp.ScopedDevice(compiled.device):
        model = put_simulated(compiled.sim_mjm, compiled.config.where)
        for name in (*shared, *(each for source in (*drawn, *fields) for each in with_followers(source))):
            widen(model, name, nworld)
        data = mjw.make_data(compiled.sim_mjm, nworld, nconmax=nconmax, njmax=njmax)
    setattr(model, NAMED, tuple(fields))
    return model, data
