# Warp compiles the source of its kernels and functions; their values are of its own types, not of Python's.
from typing import Any, TypeVar, dataclass_transform

_Struct = TypeVar("_Struct")

get_suggested_block_size: Any

# Fields are the arguments of a struct's constructor. Without arguments, all fields are zero.
@dataclass_transform()
def struct(c: type[_Struct]) -> type[_Struct]: ...
def __getattr__(name: str) -> Any: ...
