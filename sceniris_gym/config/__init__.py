"""The scene language: what a scene file may say, how it is read, and what errors say about it."""
