"""Extent of the measurements on each kind of device."""

from __future__ import annotations

import pytest
import warp as wp

from benchmarks.paper.extent import LARGEST, PRESSURE, SIZES, Extent


@pytest.mark.parametrize("quick", [False, True])
def test_a_cpu_is_spared_the_pressure_test(quick: bool):
    """And says why; --quick stops at 1,024."""
    extent = Extent.of("cpu", quick)
    assert extent.largest == (1024 if quick else LARGEST) in SIZES
    assert extent.reason
    assert extent.within(PRESSURE) == extent.largest
    assert extent.within(4) == 4
    assert extent.rounds >= 5


@pytest.mark.parametrize("quick", [False, True])
def test_a_gpu_goes_all_the_way(quick: bool, monkeypatch: pytest.MonkeyPatch):
    """Unless it is to be quick."""

    class Gpu:
        is_cuda = True

    monkeypatch.setattr(wp, "get_device", lambda _: Gpu())
    assert Extent.of("cuda:0", quick).largest == (LARGEST if quick else PRESSURE)
