"""The placement program of a scene: planned on the host, checked, and packed into flat arrays for the device."""
