"""Placement without any check, as a baseline: what most environments do at a reset."""

from __future__ import annotations

from dataclasses import replace

import warp as wp

from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Program


def unchecked(compiled: CompiledScene) -> CompiledScene:
    """Return a CompiledScene that samples the same candidates but tests none of them for collisions.

    For placement without any check, its scene must not use `reachable`.
    """
    program = Program()
    for name in Program.vars:
        setattr(program, name, getattr(compiled.program, name))
    program.obj_pairnum = wp.zeros_like(compiled.program.obj_pairnum)
    program.obj_broadnum = wp.zeros_like(compiled.program.obj_broadnum)
    return replace(compiled, program=program)
