"""The stages `ik` and `clear`, which follow placing."""
