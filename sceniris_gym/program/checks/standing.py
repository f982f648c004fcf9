"""Checks that objects can stand: they collide with supports and do not fall, and supports do not give way."""

import functools
import itertools
from collections.abc import Callable

import mujoco
import numpy as np

from sceniris_gym.config.bounds import MAX_LEVELS
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.supports import COS_MAX_TILT
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.dropping import DROP_SECONDS, STILL, drop, held, moved, only, point
from sceniris_gym.program.loads import least_upright, wind_push
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.resting import check_weight, drawn_joints
from sceniris_gym.program.standing import Stance
from sceniris_gym.scene.draws import LOOSE, WEAK, Ends, at_ends
from sceniris_gym.scene.model import SceneModel

# Greatest angle [degrees] between gravity and the vertical: a friction of 0.02 holds objects there.
_TILT = 1.0
# Greatest sink [m] of an object into its support, and greatest yield [m] of a support under a load.
_GIVES = 5.0e-3
# How often the height of the support is measured while a load is simulated.
_LOOKS = 10
# Greatest height [m] between the geoms used for placing and the geoms that carry the object.
_DROP = 2.0e-3
# Ends of draws at which joints and supports give way the most. Both masses are tested, because either may be worse.
_HEAVY: dict[str, Ends] = {**WEAK, **LOOSE}
_LIGHT: dict[str, Ends] = {**_HEAVY, "body_mass": "least"}
# Joints that move a support up or down by less than this [m per m or rad] do not yield to a load.
_LEAST_LIFT = 1.0e-3
# Least friction of an object that may lean: a little above the tangent of `_TILT`.
_FRICTION = 0.02
_ANYWAY = "or write 'stands: false' if the object is meant to fall"


def check_standing(plan: Plan) -> None:
    """Check that each object that has to stand can stand on its support.

    Raises:
        SceneKeyError: Gravity does not point down, or contacts are off or too soft. An object falls through its
            support, slides off it, or is thrown off. The surface of a geom moves the object like a belt. The object
            would stand above or below the height where it is placed. Drawn joints move parts of the object below its
            foot. The object falls or rolls over, or `gravcomp` lifts it. Too many objects stand on each other.
            A joint of the support or of the object gives way.
    """
    config, draws = plan.scene.config, plan.scene.draws
    models = dict.fromkeys(at_ends(plan.scene.mjm, draws, **ends) for ends in ({}, _HEAVY, _LIGHT))
    apart = functools.cache(functools.partial(_apart, plan))  # a copy of a large model takes a quarter of a second
    for o, stance in zip(plan.objects, plan.stances, strict=True):
        if not stance.levels:
            continue
        assert o.config.support is not None
        where = f"{config.where}: {config.key(o.name)}.{o.config.support.word}"
        _check_gravity(plan.scene, o, where)
        if not stance.feet:
            raise SceneKeyError(
                f"{where}: '{o.name}' falls through '{o.config.support.parent}', as none of its geoms collides with "
                f"'{o.config.support.parent}'. Give both matching contact bits (contype, conaffinity), remove an "
                f"<exclude>, {_ANYWAY}."
            )
        if stance.is_belt:
            raise SceneKeyError(
                f"{where}: '{o.name}' does not stay on '{o.config.support.parent}': a geom of one of them has a "
                f"'surfacevel', which moves the object like a belt. Set 'surfacevel' to 0, {_ANYWAY}."
            )
        if (len(stance.levels) > 1 or stance.tilt) and stance.friction < _FRICTION:
            raise SceneKeyError(
                f"{where}: '{o.name}' slides off '{o.config.support.parent}', because the friction between them is "
                f"{stance.friction:.3g}, but should be at least {_FRICTION:g}. Raise the friction of either, {_ANYWAY}."
            )
        if round(hangs := max(f.hangs for f in stance.feet), 4) > 0.0:
            raise SceneKeyError(
                f"{where}: '{o.name}' might not stand on its foot: the drawn joints {drawn_joints(plan.scene, o)} "
                f"move parts of it up to {1e3 * hangs:.3g} mm below the foot. Narrow the joints' ranges, {_ANYWAY}."
            )
        if round(abs(gap := max((f.drop for f in stance.feet), key=abs)), 6) > _DROP:
            raise SceneKeyError(
                f"{where}: '{o.name}' would stand {1e3 * abs(gap):.3g} mm {'below' if gap > 0 else 'above'} the "
                f"height where it is placed, and the limit is {1e3 * _DROP:g} mm. Give the visible and the colliding "
                f"geoms of '{o.name}' the same lowest height, and the geoms of its support the same top height."
            )
        check_weight(plan.scene, o.bodies, where)
        best = max(stance.feet, key=lambda f: f.most)
        if best.most == -np.inf:
            raise SceneKeyError(
                f"{where}: '{o.name}' touches the cylinder '{o.config.support.parent}' with edges of its geoms, and "
                f"MuJoCo's contacts would throw it off. Replace the cylinder by a mesh, {_ANYWAY}."
            )
        if best.most <= 0.0:
            falls = f"falls over: its centre of mass is {-1e3 * best.most:.3g} mm outside of its foot"
            if best.law.tip:
                falls = "rolls over: its foot is curved, and its centre of mass too high or too far from the middle"
                falls += f" for '{o.config.support.parent}', which is not a fixed plane" if best.law.steady else ""
            advice = f"Correct its <inertial> or its geoms, give it 'orientation: stable', {_ANYWAY}."
            raise SceneKeyError(f"{where}: '{o.name}' {falls}. {advice}")
        if stance.depth > _GIVES:
            raise SceneKeyError(
                f"{where}: '{o.name}' sinks into its support by {1e3 * stance.depth:.3g} mm, which should be at most "
                f"{1e3 * _GIVES:g} mm. Give its geoms a harder 'solref' or 'solimp', make its weight more similar to "
                f"the weight of the support, {_ANYWAY}."
            )
        levels = len(stance.levels)
        if levels > MAX_LEVELS:
            raise SceneKeyError(
                f"{where}: {levels} free objects stand on each other, but a stack should have at most {MAX_LEVELS}. "
                "Put some of them on another support."
            )
        for mjm in models:
            _check_joints(plan, mjm, apart, o, stance.load, where)
            _check_own_joints(plan, mjm, o, stance, where)


def _check_gravity(scene: SceneModel, o: PlacedObject, where: str) -> None:
    """Reject a model whose contacts are off, or whose gravity and wind may pull too far away from straight down."""
    mjm, bits = scene.mjm, mujoco.mjtDisableBit
    pull, push = least_upright(scene), wind_push(scene, o)
    if np.hypot(*pull[:2]) + push > -pull[2] * np.tan(np.radians(_TILT)):
        drawn = "may be drawn as" if (scene.least.opt.gravity != scene.most.opt.gravity).any() else "is"
        wind = f" with a wind that pushes '{o.name}' by up to {push:.3g} N for each kg" if push else ""
        raise SceneKeyError(
            f"{where}: gravity {drawn} {pull.round(6).tolist()}{wind}, but should point within {_TILT:g} degree "
            f"of straight down (-z) for standing objects. Correct gravity or wind, {_ANYWAY}."
        )
    if mjm.opt.disableflags & (bits.mjDSBL_CONTACT | bits.mjDSBL_CONSTRAINT):
        raise SceneKeyError(f"{where}: the model's <flag> disables contact or constraint. Enable both, {_ANYWAY}.")


def _placed(plan: Plan) -> list[int]:
    """Return the root bodies of the free objects that the scene places."""
    return [x.bodies[0] for x in plan.objects if x.kind == ObjectKind.FREE]


def _apart(plan: Plan, mjm: mujoco.MjModel, support: int = -1) -> mujoco.MjModel:
    """Return a copy of a model where placed free objects are held and do not collide.

    Contacts are off, but not for a loose support, which may rest on other bodies and whose root is `support`.
    """
    bodies = np.isin(mjm.body_rootid, _placed(plan)) | (support < 0)
    model = held(mjm, (mjm.jnt_type == mujoco.mjtJoint.mjJNT_FREE) & bodies[mjm.jnt_bodyid], bodies)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT * (support < 0)
    return model


def _check_joints(
    plan: Plan, mjm: mujoco.MjModel, apart: Callable[..., mujoco.MjModel], o: PlacedObject, load: float, where: str
) -> None:
    """Reject a support that gives way under a load [kg].

    MuJoCo C simulates the support with the load at a corner of the box around the regions of `o`, once for each corner.
    `apart` is `_apart` of the plan.
    """
    assert o.ground is not None
    low, high = o.corners.min(axis=0), o.corners.max(axis=0)
    places = [np.array([x, y, low[2]]) for x in (low[0], high[0]) for y in (low[1], high[1])]
    joints = sorted({joint for at in places for joint in _yielding(mjm, plan.scene.home, o.ground, at)})
    root = int(mjm.body_rootid[o.ground])
    is_loose = mjm.body_dofnum[root] == 6 and root not in _placed(plan)
    if not joints and not is_loose:
        return
    model, data = apart(mjm, root) if is_loose else apart(mjm), mujoco.MjData(mjm)
    owner = next((x for x in plan.objects if o.support is not None and x.name == o.support.owner), o)
    for state, at in itertools.product(({}, *_states(owner)), places):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.ctrl[:] = plan.scene.home.qpos, plan.scene.home_ctrl
        data.qpos[list(state)] = list(state.values())
        mujoco.mj_forward(model, data)
        if data.xmat[o.ground][8] < COS_MAX_TILT:  # too tilted to be a support in this state
            continue
        start, force = point(data, o.ground, at), load * model.opt.gravity
        data.xfrc_applied[o.ground] = [*force, *np.cross(start - data.xipos[o.ground], force)]
        fall = 0.0
        for _ in range(_LOOKS):
            mujoco.mj_step(model, data, round(DROP_SECONDS / _LOOKS / model.opt.timestep))
            fall = max(fall, float((start - point(data, o.ground, at))[2]))
        if fall > _GIVES:
            names = " and ".join(f"'{mjm.joint(j).name}'" for j in joints)
            by, cure = f"too little holds joint {names}", "Give it frictionloss, stiffness, limits or an actuator"
            if is_loose:
                by = f"the scene does not place the free body '{mjm.body(root).name}'"
                cure = "Place the body as one of 'objects', or remove its free joint"
            raise SceneKeyError(
                f"{where}: its support gives way by {1e3 * fall:.3g} mm under {load:.3g} kg, because {by}. "
                f"{cure}, {_ANYWAY}."
            )


def _check_own_joints(plan: Plan, mjm: mujoco.MjModel, o: PlacedObject, stance: Stance, where: str) -> None:
    """Reject an object that stands in MuJoCo C if its joints are held, but moves if they are not."""
    _, *inner = np.flatnonzero(np.isin(mjm.jnt_bodyid, o.bodies)).tolist()
    if not inner:
        return
    loose = only(mjm, o)
    firm = held(loose, np.isin(np.arange(mjm.njnt), inner), np.zeros(mjm.nbody, bool))

    def moves(model: mujoco.MjModel, state: dict[int, float], i: int) -> float:
        return moved(*drop(model, plan.scene, o, i, stance.touch - stance.feet[i].bottom, state), np.zeros(3))

    # a reset makes position actuators hold the drawn joints, so only the home state is tested with actuators
    states = [{}] if np.isin(mjm.actuator_trnid[:, 0], inner).any() else _states(o) or [{}]
    for state, i in itertools.product(states, range(len(o.stable_poses))):
        if (far := moves(loose, state, i)) > STILL >= moves(firm, state, i):
            raise SceneKeyError(
                f"{where}: '{o.name}' moves by {1e3 * far:.3g} mm: its joints {[mjm.joint(j).name for j in inner]} "
                f"give way. Hold them by frictionloss, stiffness or actuator, make the object a robot with 'in_model', "
                f"{_ANYWAY}."
            )


def _states(o: PlacedObject) -> list[dict[int, float]]:
    """Return five states of the drawn joints (qpos by address), from low to high. Without drawn joints, return []."""
    drawn = [(r.qposadr, r.choice or np.linspace(r.low, r.high, 5)) for r in o.joint_ranges]
    return [{adr: values[(len(values) - 1) * i // 4] for adr, values in drawn} for i in range(5 if drawn else 0)]


def _yielding(mjm: mujoco.MjModel, home: mujoco.MjData, body: int, at: np.ndarray) -> set[int]:
    """Return the joints (no free joints) that move a point of a body up or down. `at` [m] is in the body's frame."""
    jacobian = np.zeros((3, mjm.nv))
    mujoco.mj_jac(mjm, home, jacobian, None, point(home, body, at), body)
    joints = mjm.dof_jntid[np.abs(jacobian[2]) > _LEAST_LIFT]
    return set(joints[mjm.jnt_type[joints] != mujoco.mjtJoint.mjJNT_FREE].tolist())
