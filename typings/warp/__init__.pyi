# Warp compiles the source of its kernels and functions; their values are of its own types, not of Python's.
from typing import Any

def __getattr__(name: str) -> Any: ...
