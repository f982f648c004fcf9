"""Layouts of worlds: made on the device at every reset, prefetched, or stored. Also the ids of layouts."""
