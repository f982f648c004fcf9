"""Device code for the words of a scene file, each for one object in one world: the twin of docs/language/."""
