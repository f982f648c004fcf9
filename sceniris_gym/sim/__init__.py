"""Where layouts go: the batched simulation and the masked write into it."""
