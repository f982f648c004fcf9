"""The shipped tasks, a small file each, and the shipped scenes as YAML files."""
