"""What the lanes of a thread block do together. On a CPU a block is one lane."""

import warp as wp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
return __syncthreads_or(value);
#else
return value;
#endif
""")
def block_any(value: int) -> int:
    """Non-zero on every lane of the block if `value` is non-zero on any."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
__syncthreads();
#endif
""")
def block_sync():
    """A barrier: what any lane wrote before is visible to all lanes of the block after."""
    ...
