"""The reach stage of a reset, which follows placing: tiers `ik` and `clear`."""
