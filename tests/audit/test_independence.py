"""The audit shares no code with what it judges, but for the reading of the scene file."""

import subprocess
import sys

# What the audit and the generator have in common: the words of a scene file and the numbers that they stand for, which
# tests/config/test_relations.py holds to literal ones. Where things are each of them works out by itself.
READING = {
    "scene",  # SceneConfig
    "scene_words",  # which it extends
    "objects",  # who stands where, and on what
    "relations",  # a relation's anchors, heading, half-angle and distances
    "orientation",  # the DrawnOrientation that an orientation means
    "groups",  # with heaps and stacks: which things fill what, and which stand on which
    "robot",  # which arm, what it holds or starts at, and its base and TCP
    "fields",
    "folders",  # whose files are variants
    "section",  # mistakes in a scene file, and files
    *("validation", "starts"),  # mistakes in names
    "loader",
    "bounds",  # of numbers in a scene file
    "randomize",  # of masses and the like, which move nothing
    "tier",  # the names of tiers
    *("variants", "member_names", "several_supports"),  # which objects others mean by one name
    *("presence", "absence"),  # which objects may be absent
}


def test_the_audit_imports_nothing_that_makes_layouts():
    """In a fresh process the whole audit is imported: config/, tiers, progress, files, and the table of layouts."""
    program = "import sys; from sceniris_gym.audit import auditor, reach; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    own = [name.removeprefix("sceniris_gym.").split(".") for name in loaded if name.startswith("sceniris_gym.")]
    assert {path[0] for path in own} == {*["errors", "files", "registration", "progress", "config", "scene", "audit"]}
    assert {path[1] for path in own if path[0] == "config" and len(path) > 1} == READING
    assert {path[1] for path in own if path[0] == "scene" and len(path) > 1} == {"layout_table"}
