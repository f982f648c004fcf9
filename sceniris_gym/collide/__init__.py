"""Device code that tests whether two bodies are too close to each other. It does not depend on the search."""
