"""Adapters for training libraries, each with its own extra: `sb3` and `rsl-rl`."""
