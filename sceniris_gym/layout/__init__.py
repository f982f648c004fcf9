"""Layouts, made on the device at every reset: generators, stored and prefetched layouts, and their ids."""
