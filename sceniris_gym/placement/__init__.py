"""Device code that places one object in one world by the keys of a scene file. docs/language/ documents these keys."""
