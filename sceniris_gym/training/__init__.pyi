"""The public names of this module. Each is imported on first use."""

from .policy import Policy as Policy
from .policy import load_policy as load_policy

__all__: list[str]
