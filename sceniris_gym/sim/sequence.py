"""A launch sequence that is captured once and replayed from then on."""

from collections.abc import Callable

import warp as wp


class LaunchSequence:
    """Launches of fixed number and shapes, recorded into a graph at their first call.

    Recorded and direct launches run the same kernels on the same arrays, so they give the same bits. While the device
    is already capturing, the launches go into that capture. Works on CPU and CUDA devices.

    Args:
        launches: function without arguments and without host synchronisation; all it reads and writes lives in arrays
            that stay where they are
        device: the device of those arrays
        graph: record and replay; otherwise every call launches directly
    """

    def __init__(self, launches: Callable[[], None], device: wp.Device, *, graph: bool = True) -> None:
        self.launches, self.device, self.graph = launches, device, graph
        self._recorded: wp.Graph | None = None

    def __call__(self) -> None:
        """Run the launches on the device's current stream."""
        if not self.graph or self.device.is_capturing:
            with wp.ScopedDevice(self.device):
                self.launches()
            return
        if self._recorded is None:
            self._recorded = self._record()
        wp.capture_launch(self._recorded)

    def _record(self) -> wp.Graph:
        # a stream of its own: CUDA cannot capture the null stream, which is torch's current one by default
        stream = wp.Stream(self.device) if self.device.is_cuda else None
        with wp.ScopedDevice(self.device), wp.ScopedStream(stream), wp.ScopedCapture(self.device) as capture:
            self.launches()
        if capture.graph is None:
            raise RuntimeError(f"recording {self.launches} on {self.device} gave no graph")
        return capture.graph
