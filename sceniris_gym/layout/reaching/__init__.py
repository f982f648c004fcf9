"""The reach stage of a reset, after placing, for the tiers `ik` and `clear`."""
