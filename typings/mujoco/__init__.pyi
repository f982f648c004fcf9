# MuJoCo's names come out of compiled modules, which a type checker cannot read.
from typing import Any

def __getattr__(name: str) -> Any: ...
