"""Finds, reads and merges scene files before they are validated, and resolves the paths in them."""

import re
from collections.abc import Mapping
from contextlib import suppress
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.constructor import DuplicateKeyError
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, SequenceNode

from sceniris_gym.config.fields import short
from sceniris_gym.config.member_names import object_of
from sceniris_gym.errors import (
    ArgumentTypeError,
    SceneFileError,
    SceneKeyError,
    ScenirisError,
    UnknownNameError,
    check_names,
    in_a_cycle,
)
from sceniris_gym.files import no_file

SHIPPED_NAME = re.compile(r"[A-Za-z0-9_-]+")  # any other text, such as 'my/scene.yaml', is a path

# The longest dotted key of a scene has five parts.
_MOST_KEYS = 16

OF_VARIANTS = VARIANTS, HOLDOUT, TAGS = "variants", "holdout", "tags"
"""Words of an object with variants."""
# Groups of exclusive keys: at most one may be given. When scenes are merged, a later key replaces an earlier key.
SUPPORT_WORDS = ("on", "inside", "in")
REGION_FORMS = ("box", "fraction", "polygon", "points")
JOINT_FORMS = ("fraction", "range", "choice", "value", "noise", "noise_norm")
DRAW_FORMS = ("scale", "add", "abs", "choice")
ORIENTATION_FORMS = ("yaw", "any", "stable", "face_to", "with")
ROBOT_FORMS = ("asset", "in_model")
ROBOT_FILES = ("asset", "map")
MOST_VALUES = 1_000_000
"""Maximum number of values in a scene file. A scene of 10,000 objects has a tenth of it."""


class RawScene(NamedTuple):
    """A scene as written: its mapping `data`, merged into its base scenes, and its source `where`, for messages."""

    data: dict
    where: str
    name: str


def shipped(package: str, suffix: str) -> dict[str, Path]:
    """Return the shipped files of a sub-package that end in `suffix`, by file name without the suffix."""
    folder = Path(str(resources.files(f"sceniris_gym.{package}")))
    return {path.stem: path for path in sorted(folder.glob(f"*{suffix}"))}


def read_scene(scene: str | Path | Mapping, files: list[Path] | None = None) -> RawScene:
    """Read a scene and merge it into its `base`, the scene that it is based on, which may have a `base` too.

    Args:
        scene: The name of a shipped scene, the path of a YAML file, or a mapping of the same form. Paths in a file are
            relative to its folder, and paths in a mapping to the working directory.
        files: A list. The files of the scene and of all its base scenes are appended to this list.
    """
    files = [] if files is None else files
    if isinstance(scene, Mapping):
        return _with_base(dict(scene), where="scene", name="scene", folder=Path.cwd(), seen=files)
    if not isinstance(scene, str | Path):
        raise ArgumentTypeError(
            f"scene should be the name of a shipped scene, the path of a YAML file, or a mapping, got {type(scene)}."
        )
    return _read_file(_find(scene, where="scene", folder=Path.cwd()), files)


def scene_files(scene: str | Path) -> list[Path]:
    """Return the files of a scene and of its base scenes. If one of them cannot be read, the rest is left out."""
    found: list[Path] = []
    with suppress(ScenirisError):  # a wrong file is reported later, when the scene is read
        read_scene(scene, found)
    return found


def merge(base: Mapping, child: Mapping, path: tuple[str, ...] = ()) -> dict:
    """Return `base` updated with the keys of `child`, recursively.

    If a key of `child` excludes a key of `base`, as `on` excludes `in`, the key of `base` is removed.
    """
    merged = dict(base)
    group = _one_of(path)
    if any(key in child for key in group):
        merged = {key: value for key, value in merged.items() if key not in group}
    for key, value in child.items():
        below = merged.get(key)
        both = isinstance(value, Mapping) and isinstance(below, Mapping)
        merged[key] = merge(below, value, (*path, str(key))) if both else value
    return merged


def override(scene: Mapping, overrides: Mapping[str, Any], where: str) -> dict:
    """Return a scene with overrides by dotted keys such as `objects.apple.clearance`, applied in their order.

    Dotted keys only reach into existing objects and groups. Give a new object or group as a whole.
    """
    if not isinstance(overrides, Mapping):
        raise ArgumentTypeError(f"overrides should be a mapping of dotted keys to values, got {type(overrides)}.")
    changed = dict(scene)
    for dotted, value in overrides.items():
        keys = dotted.split(".") if isinstance(dotted, str) else []
        if not (keys and all(keys)):
            raise SceneKeyError(f"overrides: {dotted!r} should be a dotted key such as 'objects.apple.clearance'.")
        if len(keys) > 2 and keys[0] in ("objects", "groups", "robots"):
            _check_there(changed.get(keys[0]) or {}, keys, where)
        if len(keys) > _MOST_KEYS:
            raise SceneKeyError(f"overrides: {short(dotted)}: should have {_MOST_KEYS} keys at most, has {len(keys)}.")
        nested = value
        for key in reversed(keys):  # pyrefly: ignore[non-convergent-recursion]
            nested = {key: nested}
        changed = merge(changed, nested)
    return changed


def _check_there(parts: Any, keys: list[str], where: str) -> None:
    name, where = keys[1], f"{where}: overrides: {'.'.join(keys)}"
    if not isinstance(parts, Mapping):
        return
    if name not in parts and object_of(name) not in parts:  # a variant is named 'object/variant'
        raise UnknownNameError(keys[0].removesuffix("s"), name, where, parts)
    known = parts[name].get(VARIANTS) if isinstance(parts.get(name), Mapping) else None
    if keys[2] == VARIANTS and len(keys) > 4 and isinstance(known, Mapping) and keys[3] not in known:
        raise UnknownNameError("variant", keys[3], where, map(str, known))


def _one_of(path: tuple[str, ...]) -> tuple[str, ...]:
    match path:
        case ("objects", name, variants, _, *rest) if variants == VARIANTS:
            return _one_of(("objects", name, *rest))
        case ("objects", _):
            return SUPPORT_WORDS
        case ("objects", _, "region") | ("robot", "region") | ("robots", _, "region"):
            return REGION_FORMS
        case ("objects", _, "orientation") | ("robot", "orientation") | ("robots", _, "orientation"):
            return ORIENTATION_FORMS
        case ("robot",) | ("robots", _):
            return ROBOT_FORMS
        case ("objects", _, "joints", _) | ("robot", "joints", _) | ("robots", _, "joints", _):
            return JOINT_FORMS
        case (*_, "randomize", _) | (*_, "randomize", _, _, _):
            return DRAW_FORMS
    return ()


def _find(scene: str | Path, where: str, folder: Path) -> Path:
    if isinstance(scene, str) and SHIPPED_NAME.fullmatch(scene):
        scenes = shipped("envs", ".yaml")
        check_names("shipped scene", [scene], where, scenes)
        return scenes[scene]
    path = user_path(scene, folder, where)
    if not path.is_file():
        raise SceneFileError(
            f"{where}: '{path}': {no_file(path, 'scene file')}. Give the path of a YAML file, or the name of a "
            f"shipped scene: {', '.join(shipped('envs', '.yaml'))}."
        )
    return path


def _read_file(path: Path, seen: list[Path]) -> RawScene:
    path = path.resolve()
    if path in seen:
        cycle = [str(p) for p in seen[seen.index(path) :]]
        raise in_a_cycle(str(seen[0]), cycle, "scenes are based on each other")
    seen.append(path)
    return _with_base(_read_yaml(path), where=str(path), name=path.stem, folder=path.parent, seen=seen)


def _with_base(data: dict, where: str, name: str, folder: Path, seen: list[Path]) -> RawScene:
    data = _resolve_paths(data, folder, where)
    base = data.pop("base", None)
    if base is None:
        return RawScene(data, where, name)
    if not isinstance(base, str | Path):
        raise SceneKeyError(f"{where}: base: {base!r} should be the name of a shipped scene or the path of a file.")
    below = _read_file(_find(base, where=f"{where}: base", folder=folder), seen)
    return RawScene(merge(below.data, data), f"{where} (base: {below.where})", name)


def _read_yaml(path: Path) -> dict:
    yaml = YAML(typ="safe", pure=True)  # the pure loader reads YAML 1.2, where `on` is text
    try:
        text = path.read_text(encoding="utf-8")
        if expanded_size(text) > MOST_VALUES:
            raise SceneFileError(
                f"{path}: has more than {MOST_VALUES} values after its aliases and merges are expanded. Write "
                "fewer values."
            )
        data = yaml.load(text)
    except MarkedYAMLError as error:
        line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
        problem = f"this is not YAML: {error.problem or error.context}."
        if isinstance(error, DuplicateKeyError):
            problem = f"{str(error.problem).split(' with value')[0]}: every key should be given only once."
        raise SceneFileError(f"{path}{line}: {problem}") from None
    except (YAMLError, ValueError) as error:  # ValueError: wrong bytes or dates, or too many digits
        raise SceneFileError(f"{path}: this is not YAML: {str(error).splitlines()[0]}.") from None
    except RecursionError:
        raise SceneFileError(f"{path}: lists or mappings are nested too deeply. Use fewer levels.") from None
    except OSError as error:
        raise SceneFileError(f"{path}: the file cannot be read: {error.strerror}.") from None
    if not isinstance(data, dict):
        found = "nothing" if data is None else f"a {type(data).__name__}"
        wanted = "a scene should be a mapping with keys such as 'objects'"
        cure = "For a model or a problem file, `sceniris-gym init` writes one."
        raise SceneFileError(f"{path}: {wanted}, found {found}. {cure}")
    return data


def _resolve_paths(data: dict, folder: Path, where: str) -> dict:
    """Return the scene with absolute paths. They stay valid when the scene is merged into a base in another folder."""

    def resolved(part: Any, *keys: str) -> Any:
        found = {key: part[key] for key in keys if key in part} if isinstance(part, Mapping) else {}
        for key, value in found.items():
            found[key] = [path(each, key) for each in value] if isinstance(value, list) else path(value, key)
        if isinstance(part, Mapping) and isinstance(part.get(VARIANTS), Mapping):
            found[VARIANTS] = {name: resolved(words, *keys) for name, words in part[VARIANTS].items()}
        return {**part, **found} if found else part

    def path(value: Any, key: str) -> Any:
        is_name = key == "asset" and SHIPPED_NAME.fullmatch(str(value))
        return (
            str(user_path(value, folder, f"{where}: {key}")) if isinstance(value, str | Path) and not is_name else value
        )

    data = dict(resolved(data, "model"))
    if "robot" in data:
        data["robot"] = resolved(data["robot"], *ROBOT_FILES)
    for section, keys in (("robots", ROBOT_FILES), ("heaps", ("rows",)), ("objects", ("asset",))):
        if isinstance(data.get(section), Mapping):
            data[section] = {name: resolved(part, *keys) for name, part in data[section].items()}
    return data


def expanded_size(text: str) -> int:
    """Return the number of values in a YAML text with its aliases expanded, or 0 if the text has no anchors.

    If there are more than `MOST_VALUES`, or a value contains itself, `MOST_VALUES` + 1 is returned.

    Raises:
        YAMLError: The text is not YAML.
    """
    if "&" not in text:
        return 0
    root = YAML(typ="safe", pure=True).compose(text)
    return 0 if root is None else _size(root, {})


def _size(node: Node, known: dict[int, int]) -> int:
    if id(node) in known:
        return known[id(node)]
    known[id(node)] = MOST_VALUES + 1  # until the node is counted: an alias of the node inside itself would never end
    if isinstance(node, MappingNode):
        parts = [part for pair in node.value for part in pair]
    else:
        parts = node.value if isinstance(node, SequenceNode) else []
    known[id(node)] = min(1 + sum(_size(part, known) for part in parts), MOST_VALUES + 1)
    return known[id(node)]


def user_path(text: str | Path, folder: Path, where: str) -> Path:
    """Return a path with `~` expanded. Relative paths are below `folder`.

    Raises:
        SceneFileError: The text is not a path, its `~user` does not exist, or the file system rejects it.
    """
    try:
        path = folder / Path(text).expanduser()
        path.is_file()
    except (RuntimeError, ValueError, OSError, TypeError) as error:
        why = "there is no such user" if isinstance(error, RuntimeError) else getattr(error, "strerror", None) or error
        raise SceneFileError(
            f"{where}: {short(str(text))} is not a path: {str(why).lower()}. Give the path of a file."
        ) from None
    return path
