"""Modules that launches load, as `compile_missing` finds them, and as Warp loads them."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import warp as wp

from sceniris_gym.device import loading, sequence


def found(launches: Callable[[], None]) -> set[wp.Module]:
    """Return the modules that are compiled before these launches if the cache is empty. Nothing is launched."""
    modules: set[wp.Module] = set()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loading, "_is_kept", lambda *_: False)
        patch.setattr(sequence, "load_modules", lambda variants, _: modules.update(module for module, _ in variants))
        sequence.compile_missing(launches, wp.get_device("cpu"))
    return modules


def loaded(launches: Callable[[], None]) -> set[wp.Module]:
    """Make the launches, and return the modules that they load."""
    modules: set[wp.Module] = set()
    load = wp.Module.load

    def record(module: wp.Module, *args, **words):
        modules.add(module)
        return load(module, *args, **words)

    with pytest.MonkeyPatch.context() as patch, wp.ScopedDevice("cpu"):
        patch.setattr(wp.Module, "load", record)
        launches()
    return modules
