"""What a scene is, on the host and once: from a scene file to a CompiledScene."""
