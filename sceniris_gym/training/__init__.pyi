"""The public names of this module. Each is imported on first use."""

from .runner import Policy as Policy
from .runner import load_policy as load_policy

__all__: list[str]
