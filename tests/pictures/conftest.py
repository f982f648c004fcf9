"""The small arm of the tests of the simulation."""

from tests.sim.conftest import small_scene

__all__ = ["small_scene"]
