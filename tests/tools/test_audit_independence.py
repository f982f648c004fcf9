"""The audit shares no code with what it judges."""

import subprocess
import sys


def test_the_audit_imports_nothing_that_makes_layouts():
    """In a fresh process the whole audit is imported: the generator, its supports and its pieces are not."""
    program = """
import sys
import sceniris_gym.tools.audit.auditor
made_by = ("layout", "scene.pieces", "scene.supports", "scene.program", "scene.world", "scene.boxes", "sim", "vector")
shared = [name for name in sys.modules if name.startswith(tuple(f"sceniris_gym.{part}" for part in made_by))]
assert not shared, shared
"""
    subprocess.run([sys.executable, "-c", program], check=True)
