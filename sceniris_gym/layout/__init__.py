"""How layouts are made, on the device and at every reset."""
