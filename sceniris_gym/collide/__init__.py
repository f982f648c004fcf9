"""Device code that tests whether two bodies are too close to each other, independent of the search and of layouts."""
