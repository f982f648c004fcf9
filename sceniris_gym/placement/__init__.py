"""Device code for the words of a scene file, for one object in one world. docs/language/ documents these words."""
