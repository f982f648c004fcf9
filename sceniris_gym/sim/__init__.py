"""Where layouts go: batched simulation, the masked write, and the randomizer for anybody's own loop."""
