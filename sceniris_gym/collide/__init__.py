"""Device code that tells whether two things are too near each other."""
