"""Every field of mujoco_warp's Data: what a reset does to it, judged by plain MuJoCo and by a twin that never was ill.

The table FIELDS names all of them. A field that it does not know, of a newer mujoco_warp, fails the first test: decide
what a reset does to it, then add it to its class.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.versions import OLD, since_4

EVERYTHING = Path(__file__).parents[1] / "data" / "everything.xml"
NWORLD = 3

RESET = "as mj_resetDataKeyframe leaves it"
LAYOUT = "from the layout; the pose of the keyframe is only the start of what is drawn"
AT_REST = "0, whatever the keyframe says: a layout is at rest, and an episode starts now"
HELD = "controls that hold the layout, also in the past; those of the keyframe where they hold no pose"
DERIVED = "computed from the state before anything reads it"
FIXED = "made with the data and never written"  # so are the poses of bodies and geoms that cannot move
LIST = "contacts of reset worlds leave the list"
KEPT = "of all worlds together; the next collision pass starts it anew"

FIELDS: dict[str, str] = {
    RESET: """
        plastic qacc_warmstart qfrc_applied xfrc_applied eq_active qacc act_dot userdata sensordata tree_asleep energy
        solver_niter ne nf nl nefc ntree_awake nbody_awake nv_awake tree_awake body_awake body_awake_ind dof_awake_ind
        M flex_hessian_valid overflow""",
    LAYOUT: "qpos mocap_pos mocap_quat",
    AT_REST: "time qvel",
    HELD: "ctrl act history",
    DERIVED: """
        nisland nidof xpos xquat xmat xipos ximat xanchor xaxis geom_xpos geom_xmat site_xpos site_xmat cam_xpos
        cam_xmat light_xpos light_xdir subtree_com cdof cinert flexvert_xpos flexvert_hessian flexedge_hessian
        flexedge_J flexedge_length ten_wrapadr ten_wrapnum ten_J ten_length wrap_obj wrap_xpos actuator_length
        moment_rownnz moment_rowadr moment_colind actuator_moment crb qLD qLDiagInv flexedge_velocity ten_velocity
        actuator_velocity cvel cdof_dot qfrc_bias qfrc_spring qfrc_damper qfrc_gravcomp qfrc_fluid qfrc_adhesion
        qfrc_passive subtree_linvel subtree_angmom qH qHDiagInv qLU actuator_force qfrc_actuator qfrc_smooth
        qacc_smooth qfrc_constraint qfrc_inverse cacc cfrc_int cfrc_ext efm_c efm_diag efm_fluid efm_ca efm_K_val
        qHLD efm_ts efm_as dof_frictionadr tree_island dof_island island_dofadr island_idofadr island_nv island_nefc
        island_ne island_nf island_iefcadr map_dof2idof map_idof2dof map_efc2iefc map_iefc2efc dof_islandid
        efc_islandid ncdof dof_cdof cdof_dof cM cqLD crhs cx cJ cMa cqfrc_smooth cqacc_smooth cqacc_warmstart cqacc
        cqfrc_constraint flex_aabb_min flex_aabb_max flexnode_xpos face_xpos face_quat flex_rod_chain_ok
        flex_rodhinge_g flex_rodhinge_Wk flex_rodhinge_Wd flex_rodedge_ktheta flex_rodedge_grad flex_rodedge_frc
        flex_rodedge_tridiag flex_rod_end_torque flex_rod_chain_valid flex_rod_ref_ok flex_rod_frame0_loc
        flex_rod_frame0_ref flex_rod_tail_loc flex_rodhinge_om0 efc.type efc.id efc.jtdaj_adr efc.jtdaj_nrow
        efc.jtdaj_nblock efc.J_rownnz efc.J_rowadr efc.J_colind efc.J efc.pos efc.margin efc.D efc.vel efc.aref
        efc.frictionloss efc.force efc.state efc.island efc.Ma efc.Jqvel""",
    FIXED: "cdof_tri_row cdof_tri_col nworld naconmax naccdmax njmax nvmax nvmax_pad njmax_pad njmax_nnz",
    LIST: """
        nacon contact.dist contact.pos contact.frame contact.includemargin contact.friction contact.solref
        contact.solreffriction contact.solimp contact.dim contact.geom contact.flex contact.elem contact.vert
        contact.efc_address contact.worldid contact.type contact.geomcollisionid contact.adhesion contact.surfacevel""",
    KEPT: "ncollision",
}
CLASSES = {name: kind for kind, names in FIELDS.items() for name in names.split()}


def names_of(kind: str) -> list[str]:
    """List the fields of a class."""
    return FIELDS[kind].split()


def field(d: mjw.Data, name: str) -> wp.array:
    """Return a field, also one of `contact` or `efc`."""
    part, _, inner = name.rpartition(".")
    return getattr(getattr(d, part) if part else d, inner)


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the scene of a model that has every kind of state."""
    if OLD:
        pytest.skip("MuJoCo before 4.0 cannot read all of the model")
    return compile_scene({"model": str(EVERYTHING)}, "cpu")


@pytest.fixture
def make(compiled):
    """Return a function that makes a randomizer whose only layout is the home keyframe."""
    mjm = compiled.mjm
    key = mjm.key("home")
    poses = (key.qpos[None], key.mpos.reshape(1, -1, 3), key.mquat.reshape(1, -1, 4))
    rows = LayoutTable.from_states(*(p.astype(np.float32) for p in poses), present=np.ones((1, 0), bool))

    def build(needs: tuple[str, ...] = ()) -> ResetRandomizer:
        with wp.ScopedDevice("cpu"):
            model, data = mjw.put_model(mjm), mjw.make_data(mjm, NWORLD, nconmax=32, njmax=128)
        return ResetRandomizer(compiled, model, data, layout_source=StoredLayouts(compiled, rows, NWORLD), needs=needs)

    return build


@pytest.fixture
def home(compiled) -> mujoco.MjData:
    """Return plain MuJoCo's data after `mj_resetDataKeyframe`."""
    data = mujoco.MjData(compiled.mjm)
    data.qpos[:], data.qvel[:], data.userdata[:], data.xfrc_applied[:], data.eq_active[:] = 7.0, 7.0, 7.0, 7.0, 1
    mujoco.mj_resetDataKeyframe(compiled.mjm, data, compiled.mjm.key("home").id)
    return data


def spoil(array: wp.array, rng: np.random.Generator, columns: np.ndarray | slice = slice(None)) -> None:
    """Overwrite an array, or some columns: numbers with large or no numbers, flags with their opposites."""
    values = array.numpy().copy()
    part = values[:, columns] if values.ndim > 1 else values
    if part.dtype == bool:
        part = ~part
    elif part.dtype.kind == "f":
        part = rng.choice([np.nan, 7.0, -1e9], part.shape).astype(part.dtype)
    else:
        part = part + 5
    if values.ndim > 1:
        values[:, columns] = part
    array.assign(values if values.ndim > 1 else part)


@since_4("Data has other fields")
def test_every_field_of_data_has_its_class():
    """The table names every field of Data, Contact and Constraint once, and nothing else."""
    found = {f.name for f in dataclasses.fields(mjw.Data)} - {"contact", "efc"}
    for part, kind in (("contact", mjw.Contact), ("efc", mjw.Constraint)):
        found |= {f"{part}.{f.name}" for f in dataclasses.fields(kind)}
    unknown, gone = sorted(found - set(CLASSES)), sorted(set(CLASSES) - found)
    assert not unknown, f"mujoco_warp has new fields {unknown}: say in FIELDS what a reset does to each, and test it."
    assert not gone, f"mujoco_warp has no fields {gone} any more: take them out of FIELDS."
    assert sum(len(names.split()) for names in FIELDS.values()) == len(CLASSES), "a field has two classes"
    state = {name for name in CLASSES if hasattr(mjw.State, name.upper())}
    assert set(ResetRandomizer.STATE_FIELDS) == state | {"qacc_warmstart", "tree_asleep"}, (
        "what is promised is MuJoCo's integration state"
    )


def test_a_reset_state_is_that_of_mujoco(make, home):
    """From whatever was there before: every field of the state is what `mj_resetDataKeyframe` makes it."""
    randomizer, rng = make(), np.random.default_rng(0)
    d = randomizer.data
    for kind in (RESET, LAYOUT, AT_REST, HELD):
        for name in names_of(kind):
            spoil(field(d, name), rng)
    randomizer.reset()
    for kind in (RESET, LAYOUT, HELD):
        for name in names_of(kind):
            if name in ("history", "solver_niter", "overflow", "energy"):
                continue
            expected = np.broadcast_to(np.asarray(getattr(home, name)), field(d, name).numpy().shape)
            np.testing.assert_allclose(field(d, name).numpy(), expected, rtol=1e-6, err_msg=name)
    for name in ("time", "qvel", "solver_niter", "overflow", "energy"):
        assert not field(d, name).numpy().any(), name


def test_histories_are_those_of_mujoco_but_for_the_controls(make, home, compiled):
    """Clocks, cursors and samples of sensors are as MuJoCo clears them; samples of controls hold the pose."""
    randomizer = make()
    spoil(randomizer.data.history, np.random.default_rng(1))
    randomizer.reset()
    mjm, expected = compiled.mjm, home.history.copy()
    for i in range(mjm.nu):
        adr, n = mjm.actuator_historyadr[i], mjm.actuator_history[i, 0]
        assert n == 0 or not expected[adr + 2 + n : adr + 2 + 2 * n].any()
        expected[adr + 2 + n : adr + 2 + 2 * n] = home.ctrl[i]
    np.testing.assert_allclose(randomizer.data.history.numpy(), np.tile(expected, (NWORLD, 1)), rtol=1e-5, atol=1e-7)


def test_what_is_in_space_belongs_to_the_reset_state(make, home, compiled):
    """Positions and orientations in space are those that `mj_kinematics` finds in the keyframe."""
    randomizer = make()
    randomizer.reset()
    mujoco.mj_kinematics(compiled.mjm, home)
    for name in ("xpos", "xquat", "xmat", "xipos", "ximat", "xanchor", "xaxis", "geom_xpos", "geom_xmat", "site_xpos"):
        found = field(randomizer.data, name).numpy()
        expected = np.asarray(getattr(home, name)).reshape(found.shape[1:])
        for world in range(NWORLD):
            np.testing.assert_allclose(found[world], expected, atol=1e-6, err_msg=name)


def test_nothing_of_before_is_left(make):
    """With every derived number replaced by NaN, a reset world steps to the same bits as one that was always sound."""
    sick, sound = make(), make()
    for randomizer in (sick, sound):
        randomizer.reset()
        for _ in range(5):
            mjw.step(randomizer.model, randomizer.data)
    rng, mjm = np.random.default_rng(2), sick.compiled.mjm
    moves = (mjm.body_weldid != 0) | (mjm.body_mocapid[mjm.body_rootid] >= 0)
    columns = {"xpos": moves, "xquat": moves, "geom_xpos": moves[mjm.geom_bodyid], "geom_xmat": moves[mjm.geom_bodyid]}
    for kind in (RESET, LAYOUT, AT_REST, HELD, DERIVED, LIST):
        for name in names_of(kind):
            array = field(sick.data, name)
            if array.numpy().dtype.kind == "f":
                spoil(array, rng, columns.get(name, slice(None)))
    for randomizer in (sick, sound):
        randomizer.reset()
        for _ in range(10):
            mjw.step(randomizer.model, randomizer.data)
    for name in (*ResetRandomizer.STATE_FIELDS, "sensordata", "qacc"):
        np.testing.assert_array_equal(field(sick.data, name).numpy(), field(sound.data, name).numpy(), err_msg=name)


@pytest.mark.parametrize("needs", [(), ("velocity", "contacts")])
def test_the_state_of_other_worlds_keeps_its_bits(make, needs):
    """All that is promised of a world that is not reset, and the fields that are of all worlds together."""
    randomizer, rng = make(needs), np.random.default_rng(3)
    randomizer.reset()
    d = randomizer.data
    for _ in range(3):
        mjw.step(randomizer.model, d)
    for name in ResetRandomizer.STATE_FIELDS:
        array = field(d, name)
        if array.numpy().dtype.kind == "f":
            array.assign(rng.uniform(0.1, 0.2, array.numpy().shape).astype(np.float32))
    kept = [*ResetRandomizer.STATE_FIELDS, *names_of(RESET), *names_of(LAYOUT), *names_of(AT_REST), *names_of(HELD)]
    before = {name: field(d, name).numpy().copy() for name in kept}
    fixed = {name: getattr(d, name) for name in names_of(FIXED)}
    fixed = {name: value.numpy().copy() if isinstance(value, wp.array) else value for name, value in fixed.items()}
    randomizer.reset(np.array([True, False, True]))
    for name, values in before.items():
        np.testing.assert_array_equal(field(d, name).numpy()[1], values[1], err_msg=name)
    for name, value in fixed.items():
        now = getattr(d, name)
        np.testing.assert_array_equal(now.numpy() if isinstance(now, wp.array) else now, value, err_msg=name)


@pytest.mark.parametrize("needs", [(), ("sensors",)])
def test_other_worlds_go_on_as_if_nothing_had_been_reset(make, needs):
    """In a bare loop they step to the same bits as in a batch without resets, delayed sensors and controls included."""
    disturbed, quiet = make(needs), make()
    for randomizer in (disturbed, quiet):
        randomizer.reset()
    for i, mask in enumerate(([True, False, False], [False, False, True], [True, False, True])):
        for randomizer in (disturbed, quiet):
            randomizer.data.ctrl.assign(randomizer.data.ctrl.numpy() + np.float32(0.05 * i))
            for _ in range(4):
                mjw.step(randomizer.model, randomizer.data)
        for name in (*ResetRandomizer.STATE_FIELDS, "sensordata"):
            found, expected = (field(r.data, name).numpy()[1] for r in (disturbed, quiet))
            np.testing.assert_array_equal(found, expected, err_msg=name)
        disturbed.reset(np.array(mask))
        for name in ResetRandomizer.STATE_FIELDS:
            if name != "history" or not needs:
                found, expected = (field(r.data, name).numpy()[1] for r in (disturbed, quiet))
                np.testing.assert_array_equal(found, expected, err_msg=name)


def test_the_list_of_contacts_is_empty_after_a_reset_of_all(make):
    """And holds those of the other worlds after a reset of some; `ncollision` is of the last collision pass."""
    randomizer = make()
    randomizer.reset()
    d = randomizer.data
    for _ in range(5):
        mjw.step(randomizer.model, d)
    collisions = int(d.ncollision.numpy()[0])
    count = int(d.nacon.numpy()[0])
    assert count > 0
    randomizer.reset(np.array([True, False, False]))
    assert (d.contact.worldid.numpy()[: int(d.nacon.numpy()[0])] != 0).all()
    assert int(d.nacon.numpy()[0]) == count * 2 // 3
    randomizer.reset()
    assert int(d.nacon.numpy()[0]) == 0
    assert int(d.ncollision.numpy()[0]) == collisions
