"""Device code that tests whether two bodies are closer to each other than their least allowed distance."""
