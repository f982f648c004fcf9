"""Device code that decides if two bodies are too near each other; it knows neither search nor layouts."""
