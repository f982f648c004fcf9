"""The placement program for the device: planned on the host, checked, and packed into flat arrays."""
