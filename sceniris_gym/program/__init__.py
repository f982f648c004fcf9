"""What the device runs: the placement program, planned on the host and packed into flat arrays."""
