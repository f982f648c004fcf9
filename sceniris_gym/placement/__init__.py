"""Device code that places one object in one world, according to the scene file's keys (see docs/language/)."""
