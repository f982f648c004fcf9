"""The placement program, which the device runs: planned on the host, checked, and packed into flat arrays."""
