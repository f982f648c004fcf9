"""The shipped tasks, one file per task, and the shipped scenes as YAML files."""
