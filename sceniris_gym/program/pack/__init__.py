"""A Plan as the flat arrays of the device."""
