"""The scene language: the words of a scene file, how the file is read, and its error messages."""
