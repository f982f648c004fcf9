"""Cooperation of the lanes of a thread block. On a CPU, a block has one lane."""

import warp as wp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
return __syncthreads_or(value);
#else
return value;
#endif
""")
def block_any(value: int) -> int:
    """Return non-zero on every lane of the block if `value` is non-zero on any lane."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
__syncthreads();
#endif
""")
def block_sync():
    """Wait for all lanes of the block. After this barrier, each lane sees the earlier writes of the others."""
    ...
