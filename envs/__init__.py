"""The shipped tasks, one small file each, and the shipped scenes as YAML."""
