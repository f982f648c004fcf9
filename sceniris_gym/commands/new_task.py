"""The `new-task` command: writes a scene file and a task to start from."""

import os
from keyword import iskeyword
from pathlib import Path
from shlex import quote

from sceniris_gym.errors import ArgumentError
from sceniris_gym.files import check_new, write_text

_TEMPLATE = Path(__file__).with_name("first_task")


def new_task(name: str, folder: Path, robot: str | None = None, target: str | None = None) -> dict[str, str]:
    """Write NAME.yaml and NAME.py, and return their paths and the commands to try next.

    Args:
        name: Name of both files, a module name in lower case. The class of the task has the same name in CamelCase.
        folder: Folder of both files.
        robot: Name of a shipped arm, or its MJCF or URDF file, instead of the arm of the first scene.
        target: The same for the object to grasp.

    Raises:
        ArgumentError: The name cannot be a module's, or a file with this name exists.
        OutputError: A file cannot be written.
    """
    if not name.isidentifier() or name != name.lower() or iskeyword(name):
        raise ArgumentError(f"new-task: NAME should be a module name in lower case, such as pick_can, got {name}.")
    title, files = name.title().replace("_", ""), [folder / f"{name}.yaml", folder / f"{name}.py"]
    for file in files:
        check_new(file, "new-task", "Give another NAME, or another folder by --out.")
    for file in files:
        text = _TEMPLATE.with_suffix(f"{file.suffix}.txt").read_text()
        for shipped, own in (("panda", robot), ("orange", target)):
            if own is not None:
                path = os.path.relpath(own, folder) if Path(own).is_file() else own
                text = text.replace(f"asset: {shipped}", f"asset: {path}")
        write_text(file, text.replace("first_task", name).replace("FirstTask", title))
    there = "" if folder == Path() else f"cd {quote(str(folder))} && "
    tried, scene = f"{there}sceniris-gym train {name}:{title}-v0", quote(str(files[0]))
    shown = {"check": f"sceniris-gym check {scene}", "show layouts": f"sceniris-gym view {scene}"}
    return {"scene": str(files[0]), "task": str(files[1]), **shown, "train": tried}
