"""The `new-task` command: writes a scene file and a task to start from."""

import os
from keyword import iskeyword
from pathlib import Path
from shlex import quote

from sceniris_gym.config.loader import shipped
from sceniris_gym.errors import ArgumentError, check_names
from sceniris_gym.files import check_new, write_text
from sceniris_gym.importers.models.first_scene import first_scene, flow


def new_task(name: str, folder: Path, robot: str | None = None, target: str | None = None) -> dict[str, str]:
    """Write NAME.yaml and NAME.py, and return their paths and the commands to try next.

    Args:
        name: Name of both files, a module name in lower case. The class of the task has the same name in CamelCase.
        folder: Folder of both files.
        robot: Name of a shipped arm, or its MJCF or URDF file, instead of the arm of the first scene. A file's arm gets
            the `tcp` and the keyframe that `init` finds.
        target: The same for the object to grasp.

    Raises:
        ArgumentError: The name cannot be a module's, or a file with this name exists.
        UnknownNameError: The arm or the object is neither a file nor an asset of this package.
        OutputError: A file cannot be written.
    """
    if not name.isidentifier() or name != name.lower() or iskeyword(name):
        raise ArgumentError(f"new-task: NAME should be a module name in lower case, such as pick_can, got {name}.")
    title, files = name.title().replace("_", ""), [folder / f"{name}.yaml", folder / f"{name}.py"]
    for file in files:
        check_new(file, "new-task", "Give another NAME, or another folder by --out.")
    texts = [Path(__file__).with_name(f"first_task{file.suffix}.txt").read_text() for file in files]
    for option, usual, own in (("robot", "panda", robot), ("target", "orange", target)):
        path = own or usual
        if Path(path).is_file():
            found, file = first_scene(Path(path)).words() if option == "robot" else {}, os.path.relpath(path, folder)
            words = {"asset": file, "tcp": found.get("robot", {}).get("tcp"), "keyframe": found.get("home")}
            path = flow({word: value for word, value in words.items() if value})[1:-1].removeprefix("asset: ")
        else:
            check_names("file or asset", [path], f"new-task: --{option}", shipped("assets", ".xml"))
        texts[0] = texts[0].replace(f"asset: {usual}", f"asset: {path}")
    for file, text in zip(files, texts, strict=True):
        write_text(file, text.replace("first_task", name).replace("FirstTask", title))
    there = "" if folder == Path() else f"cd {quote(str(folder))} && "
    tried = {"check": f"{there}sceniris-gym check {name}.yaml", "train": f"{there}sceniris-gym train {name}:{title}-v0"}
    return {"scene": str(files[0]), "task": str(files[1]), **tried}
