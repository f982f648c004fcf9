"""Checks of the section `start`: its names exist, and its objects can be held or placed as the kind of start needs."""

from sceniris_gym.config.absence import check_present
from sceniris_gym.config.member_names import object_of
from sceniris_gym.config.robot import StartConfig
from sceniris_gym.config.scene_words import SceneWords
from sceniris_gym.errors import SceneKeyError, check_names


def check_starts(scene: SceneWords, where: str) -> None:
    """Check the section `start`. Errors begin with `where`.

    Raises:
        SceneKeyError: An object cannot be held, or placed at the marker. An object or a marker may be absent.
        UnknownNameError: A name is not in the scene.
    """
    for i, start in enumerate(scene.start):
        at = f"{where}: start.{i}"
        if start.of is not None:
            check_names("object", [start.of], f"{at}.of", scene.named_objects)
            check_present(scene, start.of, f"{at}.of")
        for name in start.targets(scene.variants):
            _check_target(scene, start, name, at)
        for name, marker in start.place.items():
            _check_place(scene, name, marker, f"{at}.place")
        for key in start.joints:
            name, _, joint = key.rpartition("/")
            if not name or not joint:
                raise SceneKeyError(f"{at}.joints: '{key}' should be 'object/joint', as in 'cabinet/upper'.")
            check_names("object", [name], f"{at}.joints", scene.named_objects)
            if any(joint not in scene.objects[member].parts for member in scene.variants.get(name, ())):
                raise SceneKeyError(
                    f"{at}.joints: '{name}' has variants, whose joints differ. Name one of its 'parts', not '{joint}'."
                )


def _check_target(scene: SceneWords, start: StartConfig, name: str, where: str) -> None:
    """Check that an arm can start at the grasp or pre-grasp of an object."""
    if not scene.objects[name].reachable:
        raise SceneKeyError(f"{where}.of: object '{name}' needs the key 'reachable', because the arm starts at it.")
    if start.is_held and scene.objects[name].reachable == "path":
        raise SceneKeyError(
            f"{where}: '{name}' is held in the air, and its 'reachable: path' leads to a grasp where it lies. Write "
            "'reachable: clear', or leave out 'lift' and 'robot_joints'."
        )
    if start.is_held and scene.objects[name].kind != "free":
        raise SceneKeyError(
            f"{where}: '{name}' is not a free object, so it cannot be held in the air. Make its kind 'free', or leave "
            "out 'lift' and 'robot_joints'."
        )
    for other in scene.objects if start.is_held else ():
        if scene.presence.carrier(other) == name:
            raise SceneKeyError(
                f"{where}: '{object_of(other)}' stands on '{start.of}', and a held object cannot support others. Put "
                f"'{object_of(other)}' on another support, or leave out 'lift' and 'robot_joints'."
            )


def _check_place(scene: SceneWords, name: str, marker: str, where: str) -> None:
    """Check that a start can place an object at a marker."""
    check_names("object", [name], where, scene.named_objects)
    check_present(scene, name, where)
    markers = {scene.owners.get(other, other) for other, part in scene.objects.items() if part.kind == "marker"}
    check_names("marker", [marker], where, markers)
    if marker in scene.variants:
        raise SceneKeyError(f"{where}: marker '{marker}' should have one support and no variants, to be one place.")
    check_present(scene, marker, where, by=name)
    supports = [scene.objects[member].support for member in scene.variants.get(name, (name,))]
    is_known = scene.objects[marker].support in supports or scene.any_supports
    if scene.objects[marker].support is None or not is_known:
        raise SceneKeyError(f"{where}: '{name}' and its marker '{marker}' should have the same support.")
