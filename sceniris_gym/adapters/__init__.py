"""Translation for training libraries, each behind an extra: `sb3` and `rsl-rl`."""
